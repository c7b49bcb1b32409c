"""JSON Schema of a kind of file for editors.

Markdown tables of its keys, and new files that never overwrite an existing one.
"""

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from anser.config.errors import describe_value, format_number, os_error_reason, problem_error
from anser.config.tables import Table
from anser.files import write_file

_DIALECT = "http://json-schema.org/draft-07/schema#"
"""What editors of TOML know."""
_COLUMNS = ("key", "unit", "default", "what it is", "range")


def json_schema(model: type[Table], title: str) -> dict[str, Any]:
    """JSON Schema (draft 7, without references) of the files that a model validates.

    It holds what can be said key by key; what is asked between keys the model alone checks.

    Parameters
    ----------
    model
        Of the whole file.
    title
        What such a file is called.
    """
    found = _for_editors(_described(model))
    del found["description"]  # written for those who read the code
    return {"$schema": _DIALECT, "title": title, **found}


def key_tables(model: type[Table]) -> str:
    """Tables of all keys of a file, one for each of its tables, in Markdown: unit, default, meaning, range."""
    return "\n".join(_sections(_described(model), "", is_list=False))


def _described(model: type[Table]) -> dict[str, Any]:
    """Schema of pydantic without references, titles and null, which TOML has not; of each key `expected` and `unit`."""
    whole = model.model_json_schema()
    return _plain(whole, whole.get("$defs", {}))


def _plain(node: Any, known: Mapping[str, Any]) -> Any:
    if isinstance(node, list):
        return [_plain(one, known) for one in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        words = known[name].get("description", "")
        node = {**known[name], "words": words, **{key: value for key, value in node.items() if key != "$ref"}}
    found = {key: value for key, value in node.items() if key not in ("title", "$defs", "properties")}
    if "properties" in node:
        found["properties"] = {key: _plain(value, known) for key, value in node["properties"].items()}
    options = [one for one in found.pop("anyOf", []) if one != {"type": "null"}]
    if len(options) == 1:
        found = {**options[0], **found}
        return _plain(found, known)
    if options:
        found["anyOf"] = _plain(options, known)
    if "prefixItems" in found:
        found["items"] = found.pop("prefixItems")[0]  # all of them are alike
    if "items" in found:
        found["items"] = _plain(found["items"], known)
    if found.get("default") is None or isinstance(found["default"], dict):
        found.pop("default", None)
    return found


def _for_editors(node: Any) -> Any:
    """The schema with what a key expects in its description, where editors show it."""
    if isinstance(node, list):
        return [_for_editors(one) for one in node]
    if not isinstance(node, dict):
        return node
    found = {key: value for key, value in node.items() if key not in ("words", "expected", "unit", "properties")}
    if "properties" in node:
        found["properties"] = {key: _for_editors(value) for key, value in node["properties"].items()}
    for key in ("anyOf", "items"):
        if key in found:
            found[key] = _for_editors(found[key])
    if "expected" in node:
        found["description"] = f"{node['description']}: {node['expected']}"
    return found


def _sections(node: Mapping[str, Any], path: str, *, is_list: bool) -> Iterator[str]:
    """Lines of the section of a table, and of those within it."""
    inner = {key: _table_in(value) for key, value in node["properties"].items()}
    if path:
        yield f"## `{f'[[{path}]]' if is_list else f'[{path}]'}`\n"
        yield f"{node.get('words') or node['description']}\n"
    rows = [(key, value) for key, value in node["properties"].items() if inner[key] is None]
    if rows:
        yield f"| {' | '.join(_COLUMNS)} |\n|{'---|' * len(_COLUMNS)}"
        required = node.get("required", ())
        yield from (f"| {' | '.join(_row(key, value, key in required))} |" for key, value in rows)
        yield ""
    for key, table in inner.items():
        if table is not None:
            within = f"{path}.{key}".removeprefix(".")
            yield from _sections(table, within, is_list=node["properties"][key].get("type") == "array")


def _table_in(node: Mapping[str, Any]) -> dict[str, Any] | None:
    """The table that a key holds, or a list of them; None where it holds a value."""
    places = [node, node.get("items"), *node.get("anyOf", ())]
    found = next((one for one in places if isinstance(one, dict) and "properties" in one), None)
    return None if found is None else {"words": node["description"], **found}


def _row(key: str, node: Mapping[str, Any], required: bool) -> list[str]:
    """Cells of a key: its name, unit, default, what it is and its range."""
    unit, span = str(node.get("unit", "")), str(node["expected"])
    if unit:
        span = span.removesuffix(f" {unit}")
    cells = [f"`{key}`", unit, _default(node, required), node["description"], span.removeprefix("a number ")]
    return [cell.replace("|", "\\|") for cell in cells]


def _default(node: Mapping[str, Any], required: bool) -> str:
    if required:
        return "required"
    value = node.get("default")
    if value is None:
        return "none"
    if isinstance(value, list) and value and len(set(value)) == 1:
        value = value[0]  # one for all axes
    if isinstance(value, list):
        return f"`[{', '.join(describe_value(one) for one in value)}]`"
    return f"`{format_number(value) if isinstance(value, float) else describe_value(value)}`"


def write_schema(path: Path, name: str, model: type[Table], title: str) -> None:
    """Write a model's JSON Schema beside `path`, unless it exists; raises as `write_new_file`."""
    target = path.with_name(name)
    if not target.exists():
        write_new_file(target, schema_text(model, title))


def schema_text(model: type[Table], title: str) -> str:
    """The JSON Schema of the files that a model validates, as a file holds it."""
    return json.dumps(json_schema(model, title), indent=1) + "\n"


def write_new_file(path: str | os.PathLike[str], text: str) -> Path:
    """Write text to a new file.

    Raises
    ------
    ScenarioError
        If something of this name is there already (it is left alone), or the file cannot be written.
    """
    target = Path(path)
    try:
        write_file(target, text)
    except FileExistsError:
        raise problem_error(
            str(target), "a name that is taken", "the name of a new file; nothing was written"
        ) from None
    except FileNotFoundError:
        raise problem_error(
            str(target), "a folder that does not exist", "the name of a file in a folder that does"
        ) from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be written ({os_error_reason(error)})"
        raise problem_error(str(target), arrived, "the name of a file that can be written") from None
    return target
