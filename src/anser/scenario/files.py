"""Scenario files: loading, conversion to another format version, and the starter file with its JSON Schema."""

import os
import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

from anser.config.errors import Problem, ScenarioError, format_number
from anser.config.file_schema import write_new_file, write_schema
from anser.config.toml_text import attach_line_numbers, parse_toml, read_text
from anser.scenario.schema import Scenario, validate
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_tables import DEFAULT_PLANNERS, FORMAT
from anser.scenario.unused_keys import unused_key_problems

_HEADER = re.compile(r"\[{1,2}\s*([A-Za-z0-9_-]+)[^\]]*\]")


def load(path: str | os.PathLike[str]) -> Scenario:
    """Read and validate a scenario file (TOML, UTF-8).

    Raises ScenarioError if the file, or a file named in it, cannot be read or is not valid, or if keys have no effect.
    """
    return loads(read_text(path), os.fspath(path))


def as_scenario(scenario: Scenario | str | os.PathLike[str]) -> Scenario:
    """Return a scenario unchanged, or load it with `load` from a path; raises TypeError for any other type."""
    if isinstance(scenario, Scenario):
        return scenario
    if isinstance(scenario, str | os.PathLike):
        return load(scenario)
    raise TypeError(f"scenario: arrived {type(scenario).__name__}; expected a scenario, or the path of its file")


def loads(text: str, source: str = "<string>") -> Scenario:
    """Validate the text (TOML) of a scenario.

    `source` names the text in messages; if it is a file's path, relative paths of aircraft files, soundings and wind
    fields start from the file's folder. Raises ScenarioError if the text is not TOML, is not a valid scenario, or has
    keys without effect.
    """
    values = parse_scenario(text, source)
    with attach_line_numbers(text, source):
        return from_values(values, source)


def from_values(values: dict[str, Any], source: str = "<values>") -> Scenario:
    """Validate a scenario given as nested dictionaries and lists.

    `source` names the scenario in messages; if it is a file's path, relative paths start from the file's folder. Raises
    ScenarioError if the scenario is not valid, or has keys without effect.
    """
    scenario = validate(values, source)
    problems = unused_key_problems(scenario)
    if problems:
        raise ScenarioError(source, problems)
    return scenario


def parse_scenario(text: str, source: str) -> dict[str, Any]:
    """Parse TOML into nested dictionaries, not validated; raises ScenarioError with the line if it is not TOML."""
    return parse_toml(text, source, _duplicate_table_hint)


def _duplicate_table_hint(line: str) -> str:
    """Return the right header, such as [[goal]], for the line of a table that is declared twice; empty if unknown."""
    header = _HEADER.match(line)
    table = header[1] if header is not None else ""
    for model, introduction in ((Scenario, "; a scenario has "), (Aircraft, "; an aircraft has ")):
        if table in model.model_fields:
            extra = model.model_fields[table].json_schema_extra
            expected = str(extra["expected"]) if isinstance(extra, dict) else ""
            return introduction + expected if "[[" in expected or "[aircraft." in expected else ""
    return ""


_FORMAT = re.compile(r"^(\s*format\s*=\s*)\d+", re.MULTILINE)
_FLEET = re.compile(r"^[ \t]*\[[ \t]*fleet[ \t]*\][^\n]*(?:\n|$)", re.MULTILINE)


def convert(text: str, source: str = "<string>", target_format: int = FORMAT) -> str:
    """Return a scenario's text (TOML) in the file format `target_format`; comments stay, and the flight is the same.

    If the text omits the planner, the planner is written into the text. Raises ScenarioError if the text is not a valid
    scenario, or if its format line or table [fleet] cannot be edited in place.
    """
    scenario = loads(text, source)
    if scenario.format == target_format:
        return text
    converted = _FORMAT.sub(rf"\g<1>{target_format}", text, count=1)
    if "planner" not in scenario.fleet.model_fields_set:
        line = (
            f'planner = "{scenario.fleet.planner}"  # format {scenario.format} meant it; default of format '
            f"{target_format}: "
        )
        line += f'"{DEFAULT_PLANNERS[target_format]}"\n'
        converted = _FLEET.sub(lambda match: match[0].rstrip("\n") + "\n" + line, converted, count=1)
    values = scenario.model_dump(exclude={"format"})
    try:
        is_equivalent = loads(converted, source).model_dump(exclude={"format"}) == values
    except (ScenarioError, tomllib.TOMLDecodeError):
        is_equivalent = False
    if not is_equivalent:
        expected = f'a line "format = {scenario.format}" and a table [fleet], both written out, which can be changed'
        raise ScenarioError(
            source, [Problem("", f"a file of format {format_number(float(scenario.format))}", expected)]
        )
    return converted


SCENARIO_SCHEMA = "anser-scenario.schema.json"
"""File name of the JSON Schema next to a scenario; the first line of the starter scenario refers to the schema."""


def starter_scenario() -> str:
    """Return the text (TOML) of the starter scenario: two aircraft, two drifting buoys, every key with a comment."""
    return files("anser.scenario").joinpath("starter.toml").read_text(encoding="utf-8")


def write_starter(path: str | os.PathLike[str]) -> Path:
    """Write the starter scenario to a new file with its JSON Schema for editors next to it; return the scenario's path.

    An existing schema stays; raises ScenarioError if the file exists already or cannot be written.
    """
    target = write_new_file(path, starter_scenario())
    write_schema(target, SCENARIO_SCHEMA, Scenario, "anser scenario")
    return target
