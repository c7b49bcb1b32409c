"""Reading and replacing values of a scenario by key path, such as ``aircraft[1].start.speed_m_s``."""

import difflib
import re
from collections.abc import Iterable
from typing import Any, get_args

from anser.config.errors import ScenarioError, describe_value, format_value, problem_error
from anser.config.tables import Table

_PATH = re.compile(r"\w+(?:\[[^\[\]]+\])*(?:\.\w+(?:\[[^\[\]]+\])*)*", re.ASCII)
_STEP = re.compile(r"(\w+)|\[([^\[\]]+)\]", re.ASCII)
_READABLE = (
    'keys with dots between them, and items of a list in brackets, by number from 0 or by name: "wind.speed_m_s", '
    '"aircraft[0].start.speed_m_s", "goal[boat-north].course_deg"'
)


class _ItemKey(str):
    """Step of a key path in brackets: the index or the name of a list item."""

    __slots__ = ()


def replace_values(scenario: Table, changes: tuple[tuple[object, object], ...]) -> dict[str, Any]:
    """Return a scenario's values, with changes, as nested dictionaries like those of a file.

    `changes` are pairs (key path, value), applied in order. The result lacks keys that the file omits. The values are
    not validated, and an unknown key raises no error. Raises ScenarioError if a path is malformed, names a missing list
    item, takes a list for a table or a table for a list, or continues beyond a plain value.
    """
    values = scenario.model_dump(mode="json", exclude_unset=True)
    for path, value in changes:
        if not isinstance(path, str) or not _PATH.fullmatch(path):
            raise problem_error("", f"{describe_value(path)} as a path", _READABLE)
        _put(values, path, to_file_value(value))
    return values


def value_at(scenario: Table, path: str) -> Any:
    """Return the value at a key path, or its default if the file omits the key; a table becomes a dictionary.

    The value is None for an omitted optional table, and for the required keys of such a table. Raises ScenarioError if
    the path is malformed or unknown.
    """
    if not _PATH.fullmatch(path):
        raise problem_error("", f"{describe_value(path)} as a path", _READABLE)
    node: Any = scenario
    path_so_far = ""
    for step in _steps(path):
        node = _as_container(node)
        step_key = _resolve_step(node, step, path_so_far)
        path_so_far = _extend_path(path_so_far, step)
        if isinstance(step_key, str) and step_key not in node:
            expected = f"one of the keys {', '.join(node)}"
            raise problem_error("", f"the unknown key {describe_value(step_key)}", expected, path_so_far)
        node = node[step_key]
    return _as_values(node)


def _as_values(node: Any) -> Any:
    """Return `node` in plain values, tables as dictionaries; None for a table class (it replaces an omitted table)."""
    if isinstance(node, type):
        return None
    if isinstance(node, Table):
        return node.model_dump(mode="json")
    return [_as_values(item) for item in node] if isinstance(node, list | tuple) else to_file_value(node)


def _as_container(node: Any) -> Any:
    """Return a table, or a table class (for an omitted table), as a dictionary with defaults, and a tuple as a list."""
    if isinstance(node, Table):
        return {
            key: _value_or_table(getattr(node, key), field.annotation) for key, field in type(node).model_fields.items()
        }
    if isinstance(node, type) and issubclass(node, Table):
        return {
            key: _value_or_table(None if field.is_required() else field.get_default(), field.annotation)
            for key, field in node.model_fields.items()
        }
    return list(node) if isinstance(node, tuple) else node


def _value_or_table(value: Any, annotation: Any) -> Any:
    """Return the value of a key; if it is None and `annotation` contains a table class, return the class instead."""
    if value is not None:
        return value
    options = get_args(annotation)
    return next((option for option in options if isinstance(option, type) and issubclass(option, Table)), None)


def indexed_path(scenario: Table, path: str) -> str:
    """Return a key path with list items by index instead of name: ``aircraft[0].start`` for ``aircraft[north].start``.

    Raises ScenarioError if a list item is unknown or a step does not fit; an unknown last key is kept.
    """
    node: Any = scenario
    indexed = ""
    for step in _steps(path):
        node = _as_container(node)
        step_key = _resolve_step(node, step, indexed)
        indexed = f"{indexed}[{step_key}]" if isinstance(step_key, int) else f"{indexed}.{step_key}".removeprefix(".")
        node = node.get(step_key) if isinstance(node, dict) else node[step_key]
    return indexed


def repeated_paths(scenario: Table, paths: Iterable[str]) -> tuple[str, str] | None:
    """Return the first two of `paths` with the same key, such as one by index and one by name; None if all keys differ.

    Paths that are not in the scenario are skipped.
    """
    former: dict[str, str] = {}
    for path in paths:
        try:
            place = indexed_path(scenario, path)
        except ScenarioError:
            continue
        if place in former:
            return former[place], path
        former[place] = path
    return None


def to_file_value(value: object) -> object:
    """Convert a value for a file: a table becomes a dictionary of its set keys, an array scalar a plain number."""
    if isinstance(value, Table):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, dict):
        return {key: to_file_value(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [to_file_value(entry) for entry in value]
    item = getattr(value, "item", None)
    return item() if getattr(value, "shape", None) == () and callable(item) else value


def _put(values: dict[str, Any], path: str, value: object) -> None:
    steps = _steps(path)
    node: Any = values
    path_so_far = ""
    for step, next_step in zip(steps, [*steps[1:], None], strict=True):
        step_key = _resolve_step(node, step, path_so_far)
        path_so_far = _extend_path(path_so_far, step)
        if next_step is None:
            node[step_key] = value
            return
        if isinstance(step_key, str) and node.get(step_key) is None:
            if isinstance(next_step, _ItemKey):
                arrived = f"an item, [{next_step}], of a list that is not written out"
                raise problem_error("", arrived, "the whole list", path_so_far)
            node[step_key] = {}  # an omitted optional table
        node = node[step_key]


def _steps(path: str) -> list[str]:
    return [key or _ItemKey(item) for key, item in _STEP.findall(path)]


def _extend_path(path_so_far: str, step: str) -> str:
    """Append a key, or an item in brackets, to a key path."""
    return f"{path_so_far}[{step}]" if isinstance(step, _ItemKey) else f"{path_so_far}.{step}".removeprefix(".")


def _resolve_step(node: object, step: str, path_so_far: str) -> str | int:
    """Return the key or list index of a step within `node`; raises ScenarioError if the step does not fit `node`."""
    if isinstance(step, _ItemKey):
        if isinstance(node, list):
            return _index(node, step, path_so_far)
        raise problem_error("", f"an item, [{step}], of what is no list", "a path without it", path_so_far)
    if isinstance(node, dict):
        return step
    if isinstance(node, list):
        raise problem_error("", f'the key "{step}" of a list', _describe_items(node, path_so_far), path_so_far)
    arrived = f'the key "{step}" of {format_value(node)}, which is no table'
    raise problem_error("", arrived, "a path that ends here", path_so_far)


def _index(items: list[Any], step: _ItemKey, path_so_far: str) -> int:
    if step.isdecimal():
        if int(step) < len(items):
            return int(step)
        arrived = f"the item [{step}] of a list of {len(items)}"
        raise problem_error("", arrived, _describe_items(items, path_so_far), path_so_far)
    name = step.removeprefix('"').removesuffix('"')
    names = _names(items)
    if name in names:
        return names.index(name)
    matches = difflib.get_close_matches(name, [item_name for item_name in names if item_name is not None], n=1)
    guess = f'perhaps "{matches[0]}"; ' if matches else ""
    arrived = f"the name {describe_value(name)}, which no item has"
    raise problem_error("", arrived, guess + _describe_items(items, path_so_far), path_so_far)


def _names(items: list[Any]) -> list[str | None]:
    return [item.get("name") if isinstance(item, dict) else getattr(item, "name", None) for item in items]


def _describe_items(items: list[Any], path_so_far: str) -> str:
    """Return a text with the valid key paths of a list's items, by index and by name."""
    if not items:
        return "the whole list, which is empty"
    last_index = len(items) - 1
    numbers = f"{path_so_far}[0]" if last_index == 0 else f"{path_so_far}[0] to {path_so_far}[{last_index}]"
    names = [f"{path_so_far}[{name}]" for name in _names(items) if name is not None]
    return f"{numbers}, or by name {', '.join(names)}" if names else numbers
