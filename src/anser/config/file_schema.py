"""JSON Schema of files for editors, Markdown tables of keys, and new files without overwriting."""

import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from anser.config.errors import describe_value, format_value, os_error_reason, problem_error, quoted_list
from anser.config.tables import Table
from anser.files import write_file

_DIALECT = "http://json-schema.org/draft-07/schema#"
"""Dialect of JSON Schema that TOML editors support."""
_COLUMNS = ("key", "unit", "default", "what it is", "range")


def json_schema(model: type[Table], title: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 7, without references) of the files that a model validates, entitled `title`.

    The schema does not check contradictions between keys; only the model does.
    """
    schema = _for_editors(_described(model))
    del schema["description"]  # addressed to readers of the code
    return {"$schema": _DIALECT, "title": title, **schema}


def key_tables(model: type[Table]) -> str:
    """Return Markdown tables of a file's keys: a section per TOML table, with unit, default, meaning and range."""
    return "\n".join(_sections(_described(model), "", is_list=False))


def _described(model: type[Table]) -> dict[str, Any]:
    """Return Pydantic's schema of a model with references resolved, without titles and null (which TOML lacks)."""
    whole = model.model_json_schema()
    return _plain(whole, whole.get("$defs", {}))


def _plain(node: Any, definitions: Mapping[str, Any]) -> Any:
    if isinstance(node, list):
        return [_plain(item, definitions) for item in node]
    if not isinstance(node, dict):
        return node
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        description = definitions[name].get("description", "")
        node = {
            **definitions[name],
            "words": description,
            **{key: value for key, value in node.items() if key != "$ref"},
        }
    plain = {key: value for key, value in node.items() if key not in ("title", "$defs", "properties")}
    if "properties" in node:
        plain["properties"] = {key: _plain(value, definitions) for key, value in node["properties"].items()}
    options = [item for item in plain.pop("anyOf", []) if item != {"type": "null"}]
    if len(options) == 1:
        plain = {**options[0], **plain}
        return _plain(plain, definitions)
    if options:
        plain["anyOf"] = _plain(options, definitions)
    if "prefixItems" in plain:
        plain["items"] = plain.pop("prefixItems")[0]  # all items have the same schema
    if "items" in plain:
        plain["items"] = _plain(plain["items"], definitions)
    if "enum" in plain and "description" in plain:
        plain.setdefault("expected", quoted_list(plain["enum"], " or "))
    if plain.get("default") is None or isinstance(plain["default"], dict):
        plain.pop("default", None)
    return plain


def _for_editors(node: Any) -> Any:
    """Return the schema with each key's text `expected` appended to its description, which editors show."""
    if isinstance(node, list):
        return [_for_editors(item) for item in node]
    if not isinstance(node, dict):
        return node
    schema = {key: value for key, value in node.items() if key not in ("words", "expected", "unit", "properties")}
    if "properties" in node:
        schema["properties"] = {key: _for_editors(value) for key, value in node["properties"].items()}
    for key in ("anyOf", "items"):
        if key in schema:
            schema[key] = _for_editors(schema[key])
    if "expected" in node:
        schema["description"] = f"{node['description']}: {node['expected']}"
    return schema


def _sections(node: Mapping[str, Any], path: str, *, is_list: bool) -> Iterator[str]:
    """Yield the Markdown of a table with schema `node` and of its inner tables; `path` is empty for a whole file."""
    inner = {key: _table_in(value) for key, value in node["properties"].items()}
    if path:
        yield f"## `{f'[[{path}]]' if is_list else f'[{path}]'}`\n"
        yield f"{node.get('words') or node['description']}\n"
    keys = [(key, value) for key, value in node["properties"].items() if inner[key] is None]
    if keys:
        yield f"| {' | '.join(_COLUMNS)} |\n|{'---|' * len(_COLUMNS)}"
        required = node.get("required", ())
        yield from (f"| {' | '.join(_row(key, value, key in required))} |" for key, value in keys)
        yield ""
    for key, table in inner.items():
        if table is not None:
            inner_path = f"{path}.{key}".removeprefix(".")
            yield from _sections(table, inner_path, is_list=node["properties"][key].get("type") == "array")


def _table_in(node: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the schema of a table, or of the items of a list of tables; None for a plain value."""
    nodes = [node, node.get("items"), *node.get("anyOf", ())]
    table_node = next(
        (candidate for candidate in nodes if isinstance(candidate, dict) and "properties" in candidate), None
    )
    return None if table_node is None else {"words": node["description"], **table_node}


def _row(key: str, node: Mapping[str, Any], required: bool) -> list[str]:
    """Return the cells of a key's row in the table of keys, in the order of `_COLUMNS`."""
    unit, span = str(node.get("unit", "")), str(node["expected"])
    if unit:
        span = span.removesuffix(f" {unit}")
    span = re.sub("^a number (?!of )", "", span)
    cells = [f"`{key}`", unit, _default(node, required), node["description"], span]
    return [cell.replace("|", "\\|") for cell in cells]


def _default(node: Mapping[str, Any], required: bool) -> str:
    if required:
        return "required"
    value = node.get("default")
    if value is None:
        return "none"
    if isinstance(value, list) and value and len(set(value)) == 1:
        value = value[0]  # equal for all axes
    if isinstance(value, list):
        return f"`[{', '.join(describe_value(item) for item in value)}]`"
    return f"`{format_value(value)}`"


def write_schema(path: Path, name: str, model: type[Table], title: str) -> Path:
    """Write a model's JSON Schema as file `name` beside `path`, unless the file exists; return the path of the schema.

    Raises ScenarioError if the schema cannot be written.
    """
    target = path.with_name(name)
    if not target.exists():
        write_new_file(target, schema_text(model, title))
    return target


def schema_text(model: type[Table], title: str) -> str:
    """Return the text of `json_schema`: JSON with an indent of 1 and a final line break."""
    return json.dumps(json_schema(model, title), indent=1) + "\n"


def write_new_file(path: str | os.PathLike[str], text: str) -> Path:
    """Write text to a new file; return its path.

    Raises ScenarioError if the file exists or cannot be written; an existing file stays unchanged.
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
