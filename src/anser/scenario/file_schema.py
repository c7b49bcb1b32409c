"""What the schema of a kind of file says, for others: a JSON Schema for editors, tables of its keys for people."""

from collections.abc import Iterator, Mapping
from typing import Any

from anser.scenario.errors import plain, show
from anser.scenario.schema_base import Table

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
        return f"`[{', '.join(show(one) for one in value)}]`"
    return f"`{plain(value) if isinstance(value, float) else show(value)}`"
