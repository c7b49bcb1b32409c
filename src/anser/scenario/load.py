"""Reading scenarios: from a file, from text, from values; everything wrong with one is told in one message."""

import ast
import difflib
import os
import re
import tomllib
from pathlib import Path
from typing import Any

from anser.scenario.errors import Problem, ScenarioError, reason_of, refused, show
from anser.scenario.schema import Scenario, validate
from anser.scenario.schema_aircraft import Aircraft

_TOML_PLACE = re.compile(r"^(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)$")

_NAMESPACE = re.compile(r"(?<=declare )\(.*\)(?= twice)|(?<=namespace )\(.*\)")
_HEADER = re.compile(r"\[{1,2}\s*([A-Za-z0-9_-]+)[^\]]*\]")
_DECIMAL_COMMA = re.compile(r"=\s*([+-]?\d+),(\d+)")


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


def read_text(path: str | os.PathLike[str], what: str = "scenario") -> str:
    """Text of a file (a scenario, or what else it is); raises ScenarioError if it cannot be read."""
    source = os.fspath(path)
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise refused(source, "no file of this name", f"the path of a {what} file{_near(Path(path))}") from None
    except IsADirectoryError:
        raise refused(source, "a folder", f"the path of a {what} file") from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be read ({reason_of(error)})"
        raise refused(source, arrived, f"a {what} file that can be read") from None
    try:
        return content.decode("utf-8-sig")  # editors under Windows put a mark in front
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        arrived = f"bytes that are not UTF-8 (in line {line})"
        raise refused(source, arrived, "a text file in UTF-8") from None


def loads(text: str, source: str = "<string>") -> Scenario:
    """Validate the text of a scenario.

    Parameters
    ----------
    text
        TOML.
    source
        What to call it in messages.

    Raises
    ------
    ScenarioError
        If it is no TOML or no valid scenario.
    """
    return validate(parsed(text, source), source)


def parsed(text: str, source: str) -> dict[str, Any]:
    """Values of a text in TOML; raises ScenarioError, with the line, if it is none."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(source, [_syntax_problem(text, str(error))]) from None
    except (ValueError, RecursionError) as error:
        # whole numbers too long for Python, lists within lists beyond its depth
        reason = "too deeply nested" if isinstance(error, RecursionError) else str(error)
        raise refused(source, f"text that cannot be read ({reason})", "TOML") from None


def _near(path: Path) -> str:
    """Name the file beside a missing one that was probably meant; nothing where there is none."""
    try:
        there = [entry.name for entry in path.parent.iterdir() if entry.suffix == ".toml"]
    except OSError:
        return ""
    near = difflib.get_close_matches(path.name, there, n=1)
    return f", perhaps {show(str(path.with_name(near[0])))}" if near else ""


def _syntax_problem(text: str, message: str) -> Problem:
    """Say where TOML ended to be TOML, and show that line."""
    place = _TOML_PLACE.match(message)
    if place is None:
        return Problem("", "text that is not TOML", message)
    what = _NAMESPACE.sub(_in_brackets, place["what"])
    if place["line"] is None:
        return Problem(f"line {len(text.splitlines())}, at the end", "the end of the file", f"valid TOML: {what}")
    line, column = int(place["line"]), int(place["column"])
    lines = text.replace("\r\n", "\n").split("\n")
    arrived = lines[line - 1].strip()
    return Problem(f"line {line}, column {column}", show(arrived), f"valid TOML: {what}{_way_out(arrived)}")


def _in_brackets(found: re.Match[str]) -> str:
    """Write a table's name, which the TOML library shows as a tuple of Python, as the file has it."""
    return f"[{'.'.join(ast.literal_eval(found[0]))}]"


def _way_out(line: str) -> str:
    """What a line that is no TOML, or declares a table again, should probably be; nothing where nobody can tell."""
    comma = _DECIMAL_COMMA.search(line)
    if comma is not None:
        return f"; with a decimal point, {comma[1]}.{comma[2]}"
    header = _HEADER.match(line)
    table = header[1] if header is not None else ""
    for model, before in ((Scenario, "; a scenario has "), (Aircraft, "; an aircraft has ")):
        if table in model.model_fields:
            extra = model.model_fields[table].json_schema_extra
            words = str(extra["expected"]) if isinstance(extra, dict) else ""
            return before + words if "[[" in words or "[aircraft." in words else ""
    return ""
