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
from anser.scenario.schema import DEFAULT_PLANNERS, FORMAT, Scenario, validate
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.unused_keys import unused_key_problems

_HEADER = re.compile(r"\[{1,2}\s*([A-Za-z0-9_-]+)[^\]]*\]")


def load(path: str | os.PathLike[str]) -> Scenario:
    """Read and validate a scenario file.

    Parameters
    ----------
    path
        A TOML file, UTF-8.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is no valid scenario; the message says where and what would be right.
    """
    return loads(read_text(path), os.fspath(path))


def as_scenario(given: Scenario | str | os.PathLike[str]) -> Scenario:
    """A scenario as it is, or read from its file.

    Raises
    ------
    ScenarioError
        As of `load`.
    TypeError
        It is neither a scenario nor a path.
    """
    if isinstance(given, Scenario):
        return given
    if isinstance(given, str | os.PathLike):
        return load(given)
    raise TypeError(f"scenario: arrived {type(given).__name__}; expected a scenario, or the path of its file")


def loads(text: str, source: str = "<string>") -> Scenario:
    """Validate the text of a scenario.

    Parameters
    ----------
    text
        TOML.
    source
        What to call it in messages; a path of the scenario's file: paths in it are seen from there.

    Raises
    ------
    ScenarioError
        If it is no TOML, no valid scenario, or one with keys that have no effect.
    """
    values = parse_scenario(text, source)
    with attach_line_numbers(text, source):
        scenario = validate(values, source)
        problems = unused_key_problems(scenario)
        if problems:
            raise ScenarioError(source, problems)
        return scenario


def parse_scenario(text: str, source: str) -> dict[str, Any]:
    """Values of a text in TOML; raises ScenarioError, with the line, if it is none."""
    return parse_toml(text, source, _duplicate_table_hint)


def _duplicate_table_hint(line: str) -> str:
    """What a line that declares a table again should probably be; nothing where nobody can tell."""
    header = _HEADER.match(line)
    table = header[1] if header is not None else ""
    for model, before in ((Scenario, "; a scenario has "), (Aircraft, "; an aircraft has ")):
        if table in model.model_fields:
            extra = model.model_fields[table].json_schema_extra
            words = str(extra["expected"]) if isinstance(extra, dict) else ""
            return before + words if "[[" in words or "[aircraft." in words else ""
    return ""


_FORMAT = re.compile(r"^(\s*format\s*=\s*)\d+", re.MULTILINE)
_FLEET = re.compile(r"^[ \t]*\[[ \t]*fleet[ \t]*\][^\n]*(?:\n|$)", re.MULTILINE)


def convert(text: str, source: str = "<string>", target_format: int = FORMAT) -> str:
    """The text of a scenario in another format; its comments stay, and it flies as it did.

    Parameters
    ----------
    text
        TOML of a valid scenario.
    source
        What to call it in messages.
    to
        The format wanted.

    Raises
    ------
    ScenarioError
        It is no valid scenario, or so written that its format or its table of the fleet is not found.
    """
    scenario = loads(text, source)
    if scenario.format == target_format:
        return text
    converted = _FORMAT.sub(rf"\g<1>{target_format}", text, count=1)
    if "planner" not in scenario.fleet.model_fields_set:
        line = (
            f'planner = "{scenario.fleet.planner}"  # format {scenario.format} meant it; default of '
            f"format {target_format}: "
        )
        line += f'"{DEFAULT_PLANNERS[target_format]}"\n'
        converted = _FLEET.sub(lambda found: found[0].rstrip("\n") + "\n" + line, converted, count=1)
    wanted = scenario.model_dump(exclude={"format"})
    try:
        same = loads(converted, source).model_dump(exclude={"format"}) == wanted
    except (ScenarioError, tomllib.TOMLDecodeError):
        same = False
    if not same:
        expected = f'a line "format = {scenario.format}" and a table [fleet], both written out, which can be changed'
        raise ScenarioError(
            source, [Problem("", f"a file of format {format_number(float(scenario.format))}", expected)]
        )
    return converted


SCENARIO_SCHEMA = "anser-scenario.schema.json"
"""Name of the JSON Schema beside a scenario, as the first line of the starter has it."""


def starter_scenario() -> str:
    """Text (TOML) of the starter scenario: two aircraft, two drifting buoys, every key commented; a valid one."""
    return files("anser.scenario").joinpath("starter.toml").read_text(encoding="utf-8")


def write_starter(path: str | os.PathLike[str]) -> Path:
    """Write the starter scenario to a new file, and its schema for editors beside it; return the scenario's path.

    A schema that is there already is left alone.

    Raises
    ------
    ScenarioError
        If something of this name is there already (it is left alone), or the file cannot be written.
    """
    target = write_new_file(path, starter_scenario())
    write_schema(target, SCENARIO_SCHEMA, Scenario, "anser scenario")
    return target
