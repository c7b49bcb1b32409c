"""Text of files in TOML, UTF-8: read, parsed, and what is wrong with it told with its line."""

import ast
import difflib
import os
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from anser.scenario.errors import Problem, ScenarioError, reason_of, refused, show

_TOML_PLACE = re.compile(r"^(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)$")
_NAMESPACE = re.compile(r"(?<=declare )\(.*\)(?= twice)|(?<=namespace )\(.*\)")
_DECIMAL_COMMA = re.compile(r"=\s*([+-]?\d+),(\d+)")


def read_text(path: str | os.PathLike[str], what: str = "scenario") -> str:
    """Text of a file (a scenario, or what else it is); raises ScenarioError if it cannot be read."""
    source = os.fspath(path)
    a_file = f"{'an' if what[0] in 'aeiou' else 'a'} {what} file"
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise refused(source, "no file of this name", f"the path of {a_file}{_near(Path(path))}") from None
    except IsADirectoryError:
        raise refused(source, "a folder", f"the path of {a_file}") from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be read ({reason_of(error)})"
        raise refused(source, arrived, f"{a_file} that can be read") from None
    try:
        return content.decode("utf-8-sig")  # editors under Windows put a mark in front
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        arrived = f"bytes that are not UTF-8 (in line {line})"
        raise refused(source, arrived, "a text file in UTF-8") from None


def values_of(text: str, source: str, way_out: Callable[[str], str] | None = None) -> dict[str, Any]:
    """Values of a text in TOML; raises ScenarioError, with the line, if it is none.

    `way_out` says what a line that declares a table wrongly should probably be; nothing where it cannot tell.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(source, [_syntax_problem(text, str(error), way_out)]) from None
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


def _syntax_problem(text: str, message: str, way_out: Callable[[str], str] | None) -> Problem:
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
    comma = _DECIMAL_COMMA.search(arrived)
    if comma is not None:
        more = f"; with a decimal point, {comma[1]}.{comma[2]}"
    else:
        more = way_out(arrived) if way_out is not None else ""
    return Problem(f"line {line}, column {column}", show(arrived), f"valid TOML: {what}{more}")


def _in_brackets(found: re.Match[str]) -> str:
    """Write a table's name, which the TOML library shows as a tuple of Python, as the file has it."""
    return f"[{'.'.join(ast.literal_eval(found[0]))}]"
