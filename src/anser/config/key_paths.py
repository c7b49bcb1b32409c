"""Changing values of a scenario by path, as its file would hold them; the result is validated by who asks for it."""

import difflib
import re
from typing import Any

from anser.config.errors import describe_value, format_number, problem_error
from anser.config.tables import Table

_PATH = re.compile(r"\w+(?:\[[^\[\]]+\])*(?:\.\w+(?:\[[^\[\]]+\])*)*", re.ASCII)
_STEP = re.compile(r"(\w+)|\[([^\[\]]+)\]", re.ASCII)
_READABLE = (
    'keys with dots between them, and items of a list in brackets, by number from 0 or by name: "wind.speed_m_s", '
    '"aircraft[0].start.speed_m_s", "goal[boat-north].course_deg"'
)


class _ItemKey(str):
    """What stands in the brackets of a path."""

    __slots__ = ()


def replace_values(scenario: Table, changes: tuple[tuple[object, object], ...]) -> dict[str, Any]:
    """Values of a scenario that were written out, others put in their places one after the other.

    Parameters
    ----------
    changes
        Paths and values.

    Returns
    -------
    As the file would hold them; not validated.

    Raises
    ------
    ScenarioError
        If a path does not lead to a place of the scenario. (A key that no table has is found by the validation.)
    """
    values = scenario.model_dump(mode="json", exclude_unset=True)
    for path, value in changes:
        if not isinstance(path, str) or not _PATH.fullmatch(path):
            raise problem_error("", f"{describe_value(path)} as a path", _READABLE)
        _put(values, path, to_file_value(value))
    return values


def value_at(scenario: Table, path: str) -> Any:
    """What stands at a place of a scenario, defaults included; raises ScenarioError where there is none."""
    if not _PATH.fullmatch(path):
        raise problem_error("", f"{describe_value(path)} as a path", _READABLE)
    place: Any = scenario.model_dump(mode="json")
    path_so_far = ""
    for key, item in _STEP.findall(path):
        step = key or _ItemKey(item)
        where = _resolve_step(place, step, path_so_far)
        path_so_far = _extend_path(path_so_far, step)
        if isinstance(where, str) and where not in place:
            raise problem_error(
                "", f"the unknown key {describe_value(where)}", f"one of the keys {', '.join(place)}", path_so_far
            )
        place = place[where]
    return place


def indexed_path(scenario: Table, path: str) -> str:
    """Write a path with the number of each item instead of its name, as messages do: ``aircraft[0].start``.

    Raises ScenarioError if it leads nowhere.
    """
    place: Any = scenario.model_dump(mode="json")
    numbered = ""
    for key, item in _STEP.findall(path):
        where = _resolve_step(place, key or _ItemKey(item), numbered)
        numbered = f"{numbered}[{where}]" if isinstance(where, int) else f"{numbered}.{where}".removeprefix(".")
        place = place.get(where) if isinstance(place, dict) else place[where]
    return numbered


def to_file_value(value: object) -> object:
    """Write a value as a file would hold it: tables as dictionaries, numbers of array libraries as plain ones."""
    if isinstance(value, Table):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, dict):
        return {key: to_file_value(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [to_file_value(one) for one in value]
    item = getattr(value, "item", None)
    return item() if getattr(value, "shape", None) == () and callable(item) else value


def _put(values: dict[str, Any], path: str, value: object) -> None:
    steps = [key or _ItemKey(item) for key, item in _STEP.findall(path)]
    place: Any = values
    path_so_far = ""
    for step, after in zip(steps, [*steps[1:], None], strict=True):
        where = _resolve_step(place, step, path_so_far)
        path_so_far = _extend_path(path_so_far, step)
        if after is None:
            place[where] = value
            return
        if isinstance(where, str) and place.get(where) is None:
            if isinstance(after, _ItemKey):
                raise problem_error(
                    "", f"an item, [{after}], of a list that is not written out", "the whole list", path_so_far
                )
            place[where] = {}  # a table that was left out
        place = place[where]


def _extend_path(path_so_far: str, step: str) -> str:
    """A path and one step more."""
    return f"{path_so_far}[{step}]" if isinstance(step, _ItemKey) else f"{path_so_far}.{step}".removeprefix(".")


def _resolve_step(place: object, step: str, path_so_far: str) -> str | int:
    """The key or the index of a step in what it leads into."""
    if isinstance(step, _ItemKey):
        if isinstance(place, list):
            return _index(place, step, path_so_far)
        raise problem_error("", f"an item, [{step}], of what is no list", "a path without it", path_so_far)
    if isinstance(place, dict):
        return step
    if isinstance(place, list):
        raise problem_error("", f'the key "{step}" of a list', _describe_items(place, path_so_far), path_so_far)
    text = format_number(place) if isinstance(place, float) else describe_value(place)
    raise problem_error("", f'the key "{step}" of {text}, which is no table', "a path that ends here", path_so_far)


def _index(items: list[Any], step: _ItemKey, path_so_far: str) -> int:
    if step.isdecimal():
        if int(step) < len(items):
            return int(step)
        raise problem_error(
            "", f"the item [{step}] of a list of {len(items)}", _describe_items(items, path_so_far), path_so_far
        )
    name = step.removeprefix('"').removesuffix('"')
    names = _names(items)
    if name in names:
        return names.index(name)
    near = difflib.get_close_matches(name, [one for one in names if one is not None], n=1)
    guess = f'perhaps "{near[0]}"; ' if near else ""
    raise problem_error(
        "",
        f"the name {describe_value(name)}, which no item has",
        guess + _describe_items(items, path_so_far),
        path_so_far,
    )


def _names(items: list[Any]) -> list[str | None]:
    return [one.get("name") if isinstance(one, dict) else None for one in items]


def _describe_items(items: list[Any], path_so_far: str) -> str:
    """Say how an item of a list is named."""
    if not items:
        return "the whole list, which is empty"
    last = len(items) - 1
    numbers = f"{path_so_far}[0]" if last == 0 else f"{path_so_far}[0] to {path_so_far}[{last}]"
    names = [f"{path_so_far}[{name}]" for name in _names(items) if name is not None]
    return f"{numbers}, or by name {', '.join(names)}" if names else numbers
