"""TOML text in UTF-8: reading within size and depth limits, parsing, and line numbers of problems."""

import ast
import contextlib
import dataclasses
import difflib
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from anser.config.errors import Problem, ScenarioError, describe_value, os_error_reason, problem_error
from anser.config.shipped_files import shipped_files
from anser.files import MIB, read_file

DEPTH_MAX: Final = 32
"""Greatest number of parts of a dotted key, and greatest depth of nested lists and tables; anser files need six."""

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
    """Return the index of the first character at which a key, list or table is deeper than `DEPTH_MAX`, or None."""
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
    """Return the index of the line break after a value that starts at `start` in valid TOML, or the text's length."""
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
    """Split a dotted key into its parts; quoted parts keep their quotes."""
    return re.findall(KEY_PART, dotted)


SIZE_MAX = 8 * MIB
"""Greatest size of a text file, bytes, and greatest length of a TOML text, characters."""
_TOML_PLACE = re.compile(r"^(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)$")
_NAMESPACE = re.compile(r"(?<=declare )\(.*\)(?= twice)|(?<=namespace )\(.*\)")
_DECIMAL_COMMA = re.compile(r"=\s*([+-]?\d+),(\d+)")
_BARE_UNIT = re.compile(r"=\s*([+-]?[\d.]+)\s*[A-Za-z][A-Za-z/^0-9]*\s*(?:#.*)?$")
_HEADER = re.compile(rf"[ \t]*(\[\[?)[ \t]*({DOTTED_KEY})[ \t]*\]")
_ENTRY = re.compile(rf"[ \t]*({DOTTED_KEY})[ \t]*=")


def read_text(path: str | os.PathLike[str], kind: str = "scenario", size_max: int = SIZE_MAX) -> str:
    """Return the text of a UTF-8 file; raises ScenarioError if the file is unreadable or larger than `size_max` bytes.

    `kind` names the kind of file in messages.
    """
    source = os.fspath(path)
    a_file = f"{'an' if kind[0] in 'aeiou' else 'a'} {kind} file"
    try:
        content = read_file(Path(path), size_max)
    except FileNotFoundError:
        raise problem_error(
            source, "no file of this name", f"the path of {a_file}{_similar_file_hint(Path(path), kind)}"
        ) from None
    except IsADirectoryError:
        raise problem_error(source, "a folder", f"the path of {a_file}{_run_folder_hint(Path(path))}") from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be read ({os_error_reason(error)})"
        raise problem_error(source, arrived, f"{a_file} that can be read") from None
    try:
        return content.decode("utf-8-sig")  # Windows editors write a byte-order mark
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        arrived = f"bytes that are not UTF-8 (in line {line})"
        raise problem_error(source, arrived, "a text file in UTF-8") from None


def parse_toml(text: str, source: str, hint: Callable[[str], str] | None = None) -> dict[str, Any]:
    """Parse TOML into nested dictionaries; raises ScenarioError for invalid text, with the line of a syntax error.

    `source` names the text in messages; `hint` returns a correction for an invalid line, or an empty text.
    """
    # Parsing a larger or deeper text could take gigabytes of memory.
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
        # integers with too many digits, or lists nested beyond Python's limit
        reason = "too deeply nested" if isinstance(error, RecursionError) else str(error)
        raise problem_error(source, f"text that cannot be read ({reason})", "TOML") from None


@contextlib.contextmanager
def attach_line_numbers(text: str, source: str) -> Iterator[None]:
    """Add line numbers in `text` to the problems of a ScenarioError that the `with` block raises.

    The error's source must be `source`; errors of referenced files pass unchanged.
    """
    try:
        yield
    except ScenarioError as error:
        if error.source != source:  # error in a referenced file
            raise
        raise ScenarioError(source, number_lines(error.problems, text)) from None


def number_lines(problems: Iterable[Problem], text: str, keys: Mapping[str, str] | None = None) -> list[Problem]:
    """Return the problems, each with the number of the line of a TOML text that has the problem's key (`path`).

    For a path that the text does not contain, `keys` gives the key to look up in its place.
    """
    lines, places = _lines_of(text), keys or {}
    return [
        dataclasses.replace(problem, line=_line_at(places.get(problem.path, problem.path), lines))
        for problem in problems
    ]


@contextlib.contextmanager
def named_by(source: str, key: str, name: str) -> Iterator[None]:
    """Attribute a ScenarioError of the `with` block to the key that refers to the file with the error.

    `key` is the key path in the file `source`, and `name` is the key's value, the file with the error. An error whose
    first problem already has a key path or position passes unchanged.
    """
    try:
        yield
    except ScenarioError as error:
        problem = error.problems[0]
        if problem.path:
            raise
        raise problem_error(source, f"{describe_value(name)}, {problem.arrived}", problem.expected, key) from None


def _lines_of(text: str) -> dict[str, int]:
    """Return the first line (from 1) of each key and table of valid TOML, by key path as in messages."""
    line_numbers: dict[str, int] = {}
    for path, line in _keys_of(text):
        line_numbers.setdefault(path, line)
    return line_numbers


def _keys_of(text: str) -> Iterator[tuple[str, int]]:
    """Yield the key path and line of each key and table of valid TOML, except keys inside an inline table or a list."""
    last_item: dict[str, int] = {}
    table, at, line = "", 0, 1
    while at < len(text):
        header, entry = _HEADER.match(text, at), _ENTRY.match(text, at)
        end = text.find("\n", at) if entry is None else end_of_value(text, entry.end())
        end = len(text) if end < 0 else end
        if header is not None:
            *outer, name = _names(header[2])
            table = ""
            for part in outer:
                table = _join_keys(table, part)
                table += f"[{last_item[table]}]" if table in last_item else ""
            table = _join_keys(table, name)
            if header[1] == "[[":
                last_item[table] = last_item.get(table, -1) + 1
                yield table, line
                table += f"[{last_item[table]}]"
            yield table, line
        elif entry is not None:
            path = table
            for name in _names(entry[1]):
                path = _join_keys(path, name)
                yield path, line
        line += text.count("\n", at, end + 1)
        at = end + 1


def _names(dotted: str) -> list[str]:
    """Split a dotted key into parts as in messages: a part has quotes only if its characters need quotes."""
    unquoted = [part.strip("\"'") for part in key_parts(dotted)]
    return [part if re.fullmatch("[A-Za-z0-9_-]+", part) else json.dumps(part) for part in unquoted]


def _join_keys(table: str, name: str) -> str:
    return f"{table}.{name}".removeprefix(".")


def _line_at(path: str, lines: dict[str, int]) -> int | None:
    """Return the line of a key path, or of the innermost table around a path that `lines` lacks; None if unknown."""
    while path and path not in lines:
        path = path[: max(path.rfind("."), path.rfind("["), 0)]
    return lines.get(path)


def _run_folder_hint(folder: Path) -> str:
    """Return advice on how to read a folder with the results of a flight; empty for another folder."""
    if not (folder / "flight.nc").is_file():
        return ""
    return (
        f"; a run is read by anser.load_flight({describe_value(str(folder))}), or anser report and anser "
        f"figures {folder}"
    )


def _similar_file_hint(path: Path, kind: str) -> str:
    """Suggest a shipped file of the same name, or a file of similar name and equal suffix; empty if there is none."""
    suffix = path.suffix if kind in ("sounding", "table") else ".toml"
    if suffix == ".toml" and path.parent == Path():
        shipped = Path("scenarios", path.name).with_suffix(suffix)
        if shipped.is_file():
            return f", perhaps {describe_value(str(shipped))}"
        if path.stem in shipped_files():
            return f"; a copy of the shipped one is written by anser new {path.stem}.toml --from {path.stem}"
    try:
        stems = [entry.stem for entry in path.parent.iterdir() if entry.suffix == suffix]
    except OSError:
        return ""
    matches = difflib.get_close_matches(path.stem, stems, n=1)
    return f", perhaps {describe_value(str(path.with_name(matches[0] + suffix)))}" if matches else ""


def _syntax_problem(text: str, message: str, hint: Callable[[str], str] | None) -> Problem:
    """Return the problem of a syntax error in `text`, from the parser's `message`; for `hint` see `parse_toml`."""
    position = _TOML_PLACE.match(message)
    if position is None:
        return Problem("", "text that is not TOML", message)
    reason = _NAMESPACE.sub(_in_brackets, position["what"])
    if position["line"] is None:
        return Problem(f"line {len(text.splitlines())}, at the end", "the end of the file", f"valid TOML: {reason}")
    line, column = int(position["line"]), int(position["column"])
    lines = text.replace("\r\n", "\n").split("\n")
    arrived = lines[line - 1].strip()
    if reason == "Cannot overwrite a value":
        keys = list(_keys_of("\n".join(lines[:line])))
        first = next(number for path, number in keys if path == keys[-1][0])
        if first < line:
            expected = f"the key {keys[-1][0]} once: line {first} has it too"
            return Problem(f"line {line}, column {column}", describe_value(arrived), expected)
    comma = _DECIMAL_COMMA.search(arrived)
    number = _BARE_UNIT.search(arrived)
    if comma is not None:
        suggestion = f"; with a decimal point, {comma[1]}.{comma[2]}"
    elif number is not None:
        suggestion = f"; {number[1]} alone, in the unit that the key's name ends with"
    else:
        suggestion = hint(arrived) if hint is not None else ""
    return Problem(f"line {line}, column {column}", describe_value(arrived), f"valid TOML: {reason}{suggestion}")


def _in_brackets(match: re.Match[str]) -> str:
    """Return a table name that tomllib reports as a Python tuple, ('a', 'b'), in the form [a.b]."""
    return f"[{'.'.join(ast.literal_eval(match[0]))}]"
