"""Reading scenarios: from a file, from text, from values; everything wrong with one is told in one message."""

import os
import re
from typing import Any

from anser.scenario.errors import ScenarioError
from anser.scenario.no_effect import no_effect_problems
from anser.scenario.schema import Scenario, validate
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.toml_text import read_text, telling_lines, values_of

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
    values = parsed(text, source)
    with telling_lines(text, source):
        scenario = validate(values, source)
        problems = no_effect_problems(scenario)
        if problems:
            raise ScenarioError(source, problems)
        return scenario


def parsed(text: str, source: str) -> dict[str, Any]:
    """Values of a text in TOML; raises ScenarioError, with the line, if it is none."""
    return values_of(text, source, _way_out)


def _way_out(line: str) -> str:
    """What a line that declares a table again should probably be; nothing where nobody can tell."""
    header = _HEADER.match(line)
    table = header[1] if header is not None else ""
    for model, before in ((Scenario, "; a scenario has "), (Aircraft, "; an aircraft has ")):
        if table in model.model_fields:
            extra = model.model_fields[table].json_schema_extra
            words = str(extra["expected"]) if isinstance(extra, dict) else ""
            return before + words if "[[" in words or "[aircraft." in words else ""
    return ""
