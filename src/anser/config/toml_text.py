"""TOML text of files in UTF-8: reading within size and depth limits, parsing, and the line of each problem."""

import ast
import contextlib
import dataclasses
import difflib
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from anser.config.errors import Problem, ScenarioError, describe_value, os_error_reason, problem_error
from anser.files import MIB, read_file

DEPTH_MAX: Final = 32
"""Parts of a dotted key, and lists and tables within each other; files of anser have up to six."""

_BASIC = r'"(?:[^"\\\n]|\\.)*+"'
_LITERAL = r"'[^'\n]*+'"
KEY_PART: Final = rf"(?:[A-Za-z0-9_-]++|{_BASIC}|{_LITERAL})"
DOTTED_KEY: Final = rf"{KEY_PART}(?:[ \t]*+\.[ \t]*+{KEY_PART})*+"
_TOKEN = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5}|\Z)'
    r"|'''(?:[^']|'(?!''))*+(?:'{3,5}|\Z)"
    rf"|\#[^\n]*+|(?P<key>{DOTTED_KEY})|(?P<open>[\[{{])|(?P<close>[\]}}])|(?P<line>\n)"
    r"""|[^"'#\[\]{}\nA-Za-z0-9_-]++|.""",
    re.DOTALL,
)


def excessive_depth(text: str) -> int | None:
    """Position of the first key, list or table deeper than `DEPTH_MAX`; None if there is none."""
    depth = 0
    for token in _TOKEN.finditer(text):
        match token.lastgroup:
            case "key" if token.end() - token.start() > 2 * DEPTH_MAX and len(key_parts(token[0])) > DEPTH_MAX:
                return token.start()
            case "open":
                depth += 1
                if depth > DEPTH_MAX:
                    return token.start()
            case "close":
                depth = max(depth - 1, 0)
            case _:
                pass
    return None


def end_of_value(text: str, start: int) -> int:
    """Position of the end of the line on which the value that begins at `start` ends, in a valid text."""
    depth = 0
    for token in _TOKEN.finditer(text, start):
        match token.lastgroup:
            case "open":
                depth += 1
            case "close":
                depth -= 1
            case "line" if depth == 0:
                return token.start()
            case _:
                pass
    return len(text)


def key_parts(dotted: str) -> list[str]:
    """Parts of a dotted key, as the text has them."""
    return re.findall(KEY_PART, dotted)


SIZE_MAX = 8 * MIB
"""Size of the largest scenario, study or aircraft file that is read."""
_TOML_PLACE = re.compile(r"^(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)$")
_NAMESPACE = re.compile(r"(?<=declare )\(.*\)(?= twice)|(?<=namespace )\(.*\)")
_DECIMAL_COMMA = re.compile(r"=\s*([+-]?\d+),(\d+)")
_BARE_UNIT = re.compile(r"=\s*([+-]?[\d.]+)\s*[A-Za-z][A-Za-z/^0-9]*\s*(?:#.*)?$")
_HEADER = re.compile(rf"[ \t]*(\[\[?)[ \t]*({DOTTED_KEY})[ \t]*\]")
_ENTRY = re.compile(rf"[ \t]*({DOTTED_KEY})[ \t]*=")


def read_text(path: str | os.PathLike[str], what: str = "scenario", size_max: int = SIZE_MAX) -> str:
    """Text of a file (a scenario, or what else it is); raises ScenarioError if it is larger or cannot be read."""
    source = os.fspath(path)
    a_file = f"{'an' if what[0] in 'aeiou' else 'a'} {what} file"
    try:
        content = read_file(Path(path), size_max)
    except FileNotFoundError:
        raise problem_error(
            source, "no file of this name", f"the path of {a_file}{_similar_file_hint(Path(path))}"
        ) from None
    except IsADirectoryError:
        raise problem_error(source, "a folder", f"the path of {a_file}{_run_folder_hint(Path(path))}") from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be read ({os_error_reason(error)})"
        raise problem_error(source, arrived, f"{a_file} that can be read") from None
    try:
        return content.decode("utf-8-sig")  # editors under Windows put a mark in front
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        arrived = f"bytes that are not UTF-8 (in line {line})"
        raise problem_error(source, arrived, "a text file in UTF-8") from None


def parse_toml(text: str, source: str, hint: Callable[[str], str] | None = None) -> dict[str, Any]:
    """Values of a text in TOML; raises ScenarioError, with the line, if it is none.

    `hint` says what a line that declares a table wrongly should probably be; nothing where it cannot tell. What is
    too large or too deep is refused before it is parsed, which could take gigabytes.
    """
    if len(text) > SIZE_MAX:
        raise problem_error(source, f"{len(text):,} characters", f"a text of at most {SIZE_MAX:,}")
    if (deep := excessive_depth(text)) is not None:
        arrived = f"a key, list or table of more than {DEPTH_MAX} levels"
        raise problem_error(source, arrived, "fewer", f"line {text.count(chr(10), 0, deep) + 1}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(source, [_syntax_problem(text, str(error), hint)]) from None
    except (ValueError, RecursionError) as error:
        # whole numbers too long for Python, lists within lists beyond its depth
        reason = "too deeply nested" if isinstance(error, RecursionError) else str(error)
        raise problem_error(source, f"text that cannot be read ({reason})", "TOML") from None


@contextlib.contextmanager
def attach_line_numbers(text: str, source: str) -> Iterator[None]:
    """Give each problem that is found in the values of a text the line of its key."""
    try:
        yield
    except ScenarioError as error:
        if error.source != source:  # of another file that this one names
            raise
        lines = _lines_of(text)
        problems = [dataclasses.replace(one, line=_line_at(one.path, lines)) for one in error.problems]
        raise ScenarioError(source, problems) from None


def _lines_of(text: str) -> dict[str, int]:
    """Line, from 1, of each key and table of a valid text, by its path as messages write it.

    What stands within a list or a table on one line has the line where that begins.
    """
    found: dict[str, int] = {}
    last: dict[str, int] = {}
    table, at, line = "", 0, 1
    while at < len(text):
        header, entry = _HEADER.match(text, at), _ENTRY.match(text, at)
        end = text.find("\n", at) if entry is None else end_of_value(text, entry.end())
        end = len(text) if end < 0 else end
        if header is not None:
            *outer, name = _names(header[2])
            table = ""
            for one in outer:
                table = _join_keys(table, one)
                table += f"[{last[table]}]" if table in last else ""
            table = _join_keys(table, name)
            if header[1] == "[[":
                last[table] = last.get(table, -1) + 1
                found.setdefault(table, line)
                table += f"[{last[table]}]"
            found[table] = line
        elif entry is not None:
            path = table
            for name in _names(entry[1]):
                path = _join_keys(path, name)
                found.setdefault(path, line)
        line += text.count("\n", at, end + 1)
        at = end + 1
    return found


def _names(dotted: str) -> list[str]:
    """Keys of a dotted one, as messages write them."""
    bare = [one.strip("\"'") for one in key_parts(dotted)]
    return [one if re.fullmatch("[A-Za-z0-9_-]+", one) else json.dumps(one) for one in bare]


def _join_keys(table: str, name: str) -> str:
    return f"{table}.{name}".removeprefix(".")


def _line_at(path: str, lines: dict[str, int]) -> int | None:
    """Line of a key, or of the innermost table or list around it that stands in the file."""
    while path and path not in lines:
        path = path[: max(path.rfind("."), path.rfind("["), 0)]
    return lines.get(path)


def _run_folder_hint(folder: Path) -> str:
    """How a folder is read that holds a run; nothing where it holds none."""
    if not (folder / "flight.nc").is_file():
        return ""
    return (
        f"; a run is read by anser.load_flight({describe_value(str(folder))}), or anser report and anser "
        f"figures {folder}"
    )


def _similar_file_hint(path: Path) -> str:
    """Name the file that was probably meant instead of a missing one; nothing where there is none."""
    shipped = Path("scenarios", path.name).with_suffix(".toml")
    if path.parent == Path() and shipped.is_file():
        return f", perhaps {describe_value(str(shipped))}"
    try:
        there = [entry.name for entry in path.parent.iterdir() if entry.suffix == ".toml"]
    except OSError:
        return ""
    near = difflib.get_close_matches(path.name, there, n=1)
    return f", perhaps {describe_value(str(path.with_name(near[0])))}" if near else ""


def _syntax_problem(text: str, message: str, hint: Callable[[str], str] | None) -> Problem:
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
    number = _BARE_UNIT.search(arrived)
    if comma is not None:
        more = f"; with a decimal point, {comma[1]}.{comma[2]}"
    elif number is not None:
        more = f"; {number[1]} alone, in the unit that the key's name ends with"
    else:
        more = hint(arrived) if hint is not None else ""
    return Problem(f"line {line}, column {column}", describe_value(arrived), f"valid TOML: {what}{more}")


def _in_brackets(found: re.Match[str]) -> str:
    """Write a table's name, which the TOML library shows as a tuple of Python, as the file has it."""
    return f"[{'.'.join(ast.literal_eval(found[0]))}]"
