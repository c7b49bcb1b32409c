"""Documents of the live page, confined to one folder and saved with the comments of their file.

A document is a scenario as nested dictionaries and lists, as in a scenario file (TOML).
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any, TypeGuard

from anser.config.errors import Problem, ScenarioError, describe_value
from anser.config.toml_text import read_text
from anser.files import write_file
from anser.scenario.files import from_values, parse_scenario
from anser.scenario.schema import Scenario

AIRCRAFT_MAX = 20
"""Greatest number of aircraft on the page; larger fleets are planned by `anser plan`."""
_SUFFIX = ".toml"


@dataclass(frozen=True)
class DocumentFolder:
    """The folder in which the page reads and writes scenario files."""

    path: Path
    # user-defined parts (table `[parts]`) of the scenario that the server was started with; other parts are refused
    parts: Mapping[str, Any] | None = None
    # entry `wind.field` of this scenario: the only file outside the folder to which a document may refer
    wind_field: Any = None

    def names(self) -> list[str]:
        """Return the names of the scenario files in the folder, sorted; links to files outside are left out."""
        return sorted(entry.name for entry in self.path.glob(f"*{_SUFFIX}") if self._is_inside(entry))

    def read(self, name: str) -> tuple[str, dict[str, Any]]:
        """Return the text and the values of a scenario file in the folder; the values are not validated.

        Raises ScenarioError if the folder has no such scenario file, if the text is not TOML, or if a value has a type
        that no key of a scenario takes.
        """
        path = self._file(name)
        text = read_text(path)
        values = parse_scenario(text, name)
        expected = "a text, a finite number, true, false, a list or a table"
        problems = [Problem(key_path, describe_value(value), expected) for key_path, value in _foreign_values(values)]
        if problems:
            raise ScenarioError(name, problems)
        return text, values

    def scenario(self, values: dict[str, Any]) -> Scenario:
        """Validate a document and return its scenario.

        Raises ScenarioError if the document is not valid, has more than 20 aircraft, refers to a file outside the
        folder, or has user-defined parts that differ from `parts`.
        """
        problems = list(self._confinement_problems(values))
        if problems:
            raise ScenarioError("", problems)
        # validation names the file for relative paths of aircraft files
        return from_values(values, str(self.path / "document.toml"))

    def text(self, values: dict[str, Any], base: str | None) -> str:
        """Return a document as TOML, with comments and layout of the file `base` in the folder, if the file exists."""
        return merge_into_toml(self.read(base)[0] if base is not None and self._exists(base) else "", values)

    def save(self, name: str, values: dict[str, Any], base: str | None, overwrite: bool) -> None:
        """Write a document to the file `name` of the folder, with comments and layout of the file `base`, if any.

        Raises FileExistsError if the file exists and `overwrite` is False. Raises ScenarioError if the folder cannot
        have a file of this name, or if the document is not a valid scenario.
        """
        path = self._file(name)
        self.scenario(values)
        write_file(path, self.text(values, base), overwrite=overwrite)

    def _file(self, name: str) -> Path:
        """Return the path of a file in the folder, existing or not; raises ScenarioError for an unsuitable name."""
        is_plain = Path(name).name == name and name.isprintable() and not name.startswith(".")
        if not is_plain or not name.endswith(_SUFFIX) or not self._is_inside(self.path / name):
            expected = f"the name of a file in the folder {self.path.name}, such as mine{_SUFFIX}"
            raise ScenarioError("", [Problem("", f"the file name {describe_value(name)}", expected)])
        return self.path / name

    def _exists(self, name: str) -> bool:
        return self._file(name).is_file()

    def _is_inside(self, path: Path) -> bool:
        """Return whether a path lies in the folder after symbolic links are followed; False if unreadable."""
        try:
            return path.resolve().is_relative_to(self.path.resolve())
        except (OSError, ValueError, RuntimeError):
            return False

    def _confinement_problems(self, values: dict[str, Any]) -> Iterator[Problem]:
        if values.get("parts") is not None and values["parts"] != self.parts:
            expected = "the parts of the file that anser live was started with: the page does not import other code"
            yield Problem("parts", "other user-defined parts", expected)
        fleet = values.get("aircraft")
        if isinstance(fleet, list) and len(fleet) > AIRCRAFT_MAX:
            yield Problem("aircraft", f"{len(fleet)} aircraft", f"at most {AIRCRAFT_MAX} on the live page")
        wind = values.get("wind")
        field = wind.get("field") if isinstance(wind, dict) else None
        for key_path, text in _entries(values):
            is_file = key_path.rpartition(".")[2] in ("airframe", "sounding", "field") or key_path == "wind.field.path"
            is_first_field = key_path.startswith("wind.field") and field == self.wind_field
            if isinstance(text, str) and is_file and not is_first_field and not self._is_inside(self.path / text):
                yield Problem(key_path, describe_value(text), f"a file in the folder {self.path.name}")


def _entries(value: Any, key_path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield key path and value of each entry of a document, tables and lists included, depth first."""
    if key_path:
        yield key_path, value
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _entries(entry, f"{key_path}.{key}".removeprefix("."))
    elif isinstance(value, list):
        for k, entry in enumerate(value):
            yield from _entries(entry, f"{key_path}[{k}]")


def _foreign_values(values: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield key path and value of entries that no scenario key takes: dates, infinite and NaN numbers, None."""
    for key_path, value in _entries(values):
        if not isinstance(value, dict | list | str | int | float) or (
            isinstance(value, float) and not math.isfinite(value)
        ):
            yield key_path, value


def merge_into_toml(text: str, values: dict[str, Any]) -> str:
    """Return `text` (TOML) with the values of a document; unchanged values keep comments, order and number formats.

    Raises ValueError if a scenario file cannot contain a value.
    """
    import tomlkit

    for key_path, value in _foreign_values(values):
        raise ValueError(f"{key_path} is {value}, which has no form in a scenario file; expected the key left out")
    document = tomlkit.parse(text)
    _update_table(document, values)
    merged = tomlkit.dumps(document)
    if parse_scenario(merged, "the merged text") != values:
        raise ValueError("the document could not be written into the text of the file that was opened")
    return merged


def _is_table_list(value: Any) -> TypeGuard[list[dict[str, Any]]]:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)


def _update_table(table: Any, values: Mapping[str, Any]) -> None:
    """Change a table of a parsed TOML document in place, so that the table has exactly the given values."""
    import tomlkit
    from tomlkit.items import AoT

    for key in [key for key in table if key not in values]:
        table.remove(key)
    for key, value in values.items():
        present = table.get(key)
        if isinstance(value, dict) and isinstance(present, dict):
            _update_table(present, value)
        elif _is_table_list(value) and isinstance(present, AoT):
            _update_table_list(present, value)
        elif key not in table and _is_table_list(value) and isinstance(table, tomlkit.TOMLDocument):
            tables = tomlkit.aot()
            for entry in value:
                tables.append(_new_table(entry))
            table.append(key, tables)
        elif key not in table and isinstance(value, dict) and isinstance(table, tomlkit.TOMLDocument):
            table.append(key, _new_table(value))
        elif key not in table or not _is_same(present, value):
            table[key] = _inline(value)


def _is_same(present: Any, value: Any) -> bool:
    """Return whether `present`, an item of a parsed TOML document, equals a plain value; true and 1 differ."""
    plain = present.unwrap() if hasattr(present, "unwrap") else present
    return plain == value and isinstance(plain, bool) == isinstance(value, bool)


def _update_table_list(tables: Any, values: list[dict[str, Any]]) -> None:
    """Change a list of tables of a parsed TOML document in place; tables that stay keep their comments."""
    former, present = ([_identity(table) for table in rows] for rows in (tables.unwrap(), values))
    changes = SequenceMatcher(None, former, present, autojunk=False).get_opcodes()
    for kind, begin, end, value_begin, value_end in reversed(changes):  # from the end: the numbers before it stay
        for n in reversed(range(max(end - begin, value_end - value_begin))):
            k, j = begin + n, value_begin + n
            is_named = k >= end or j >= value_end or isinstance(former[k], str) or isinstance(present[j], str)
            if kind == "equal" or not is_named:
                _update_table(tables[k], values[j])
                continue
            if k < end:
                del tables[k]
            if j < value_end:
                tables.insert(min(k, end), _new_table(values[j]))


def _identity(value: Any) -> Any:
    """Return the name of a table or, if the table has no name, the content in a form that can be hashed."""
    if isinstance(value, dict):
        name = value.get("name")
        if isinstance(name, str):
            return name
        return frozenset((key, _identity(entry)) for key, entry in value.items())
    return tuple(map(_identity, value)) if isinstance(value, list) else value


def _new_table(values: Mapping[str, Any]) -> Any:
    import tomlkit

    table = tomlkit.table()
    for key, value in values.items():
        table.append(key, _inline(value))
    table.add(tomlkit.nl())
    return table


def _inline(value: Any) -> Any:
    """Return a value as a TOML item of one line; dictionaries become inline tables."""
    import tomlkit

    if isinstance(value, dict):
        table = tomlkit.inline_table()
        for key, entry in value.items():
            table.append(key, _inline(entry))
        return table
    if isinstance(value, list):
        items = tomlkit.array()
        for entry in value:
            items.append(_inline(entry))
        return items
    return value
