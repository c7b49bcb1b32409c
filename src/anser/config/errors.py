"""Error messages for invalid files, and the kinds of file (scenario, study, aircraft).

A message gives the key, the value that arrived and the values expected; a file's kind follows from its tables.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

_TEXT_MAX = 80
_BITS_MAX = 256


@dataclass(frozen=True)
class Problem:
    """One problem in a scenario, study or aircraft file."""

    #: Key, such as ``aircraft[1].start.speed_m_s`` (items from 0), or position (``line 3, column 7``); empty for the
    #: whole file.
    path: str
    arrived: str  #: Description of the value in the file.
    expected: str  #: Description of a valid value.
    subject: str = ""  #: Aircraft or goal with the problem, such as ``aircraft "north"``; empty if unnamed.
    #: Line of the key, from 1; if the file lacks the key, line of the innermost table around it; None if unknown.
    line: int | None = field(default=None, compare=False)

    def __str__(self) -> str:
        subject = f" ({self.subject})" if self.subject else ""
        line = "" if self.line is None else f"line {self.line}, "
        position = f"{line}{self.path}{subject}: " if self.path else ""
        return f"{position}arrived {self.arrived}; expected {self.expected}"


class ScenarioError(ValueError):
    """Error of an invalid file; ``str()`` is the message: a line that names the file, then a line for each problem.

    `source` is the file name, or another name for the origin of the values.
    """

    def __init__(self, source: str, problems: Sequence[Problem]) -> None:
        self.source = source
        self.problems = tuple(problems)
        super().__init__(source, self.problems)

    def __str__(self) -> str:
        count = "1 problem" if len(self.problems) == 1 else f"{len(self.problems)} problems"
        return "\n  ".join([f"{self.source or 'scenario'}: {count}", *map(str, self.problems)])


def problem_error(source: str, arrived: str, expected: str, path: str = "") -> ScenarioError:
    """Build the error of the file `source` with one problem; the other arguments are the fields of `Problem`."""
    return ScenarioError(source, [Problem(path, arrived, expected)])


def os_error_reason(error: Exception) -> str:
    """Return the reason why a file could not be read or written, for messages."""
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)


def format_value(value: object) -> str:
    """Describe a value of a file as `describe_value` does, but format a float with at most 15 significant digits."""
    return format_number(value) if isinstance(value, float) else describe_value(value)


def describe_value(value: object) -> str:
    """Describe a value of a TOML file on one line: text (shortened), numbers and booleans in TOML notation.

    A table is described as "a table", a list as "a list of N", and None as "nothing".
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        text = f'"{value}"' if value.isprintable() else repr(value)
        return text if len(text) <= _TEXT_MAX else f'{text[:_TEXT_MAX]}..." ({len(value)} characters)'
    if isinstance(value, int):
        # Python limits the digits of printed integers
        return str(value) if value.bit_length() <= _BITS_MAX else f"a whole number of {value.bit_length()} bits"
    if isinstance(value, float):
        return repr(value)  # keeps the decimal point: 1.0 is not an integer
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    return "nothing" if value is None else f"{value} ({type(value).__name__})"


def quoted_list(texts: Iterable[str], separator: str = ", ") -> str:
    """Return texts in quotes as one text, such as ``"north", "south"``."""
    return separator.join(f'"{text}"' for text in texts)


def format_number(value: float) -> str:
    """Format a number with up to 15 significant digits, without trailing zeros."""
    return f"{value:.15g}"


FileKind = Literal["scenario", "study", "aircraft"]
_TABLES_OF_KIND: dict[FileKind, frozenset[str]] = {
    "scenario": frozenset({"timing", "fleet", "aircraft", "goal"}),
    "study": frozenset({"scenario", "sampling", "vary", "rare"}),
    "aircraft": frozenset({"mass", "surface", "aerodynamics", "dave_ml"}),
}
"""Names of the tables that occur in one kind of file only, by the kind of file."""


def check_file_kind(kind: FileKind, values: Mapping[str, Any], source: str) -> None:
    """Raise ScenarioError if the file `source` has tables of another kind of file, and no table of the kind `kind`."""
    if _TABLES_OF_KIND[kind] & values.keys():
        return
    for actual_kind, its_tables in _TABLES_OF_KIND.items():
        if its_tables & values.keys():
            command = {
                "scenario": f"anser check {source}",
                "study": f"anser {'rare' if 'rare' in values else 'campaign'} {source} --out FOLDER",
                "aircraft": f"anser aircraft check {source}",
            }[actual_kind]
            raise problem_error(
                source, f"{_kind_text(actual_kind)}, by its tables", f"{_kind_text(kind)}; for this one: {command}"
            )


def _kind_text(kind: FileKind) -> str:
    return f"{'an' if kind == 'aircraft' else 'a'} {kind} file"
