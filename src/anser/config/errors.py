"""Messages about refused files.

Where a problem is, what arrived and what would be right; and the kinds of file, recognized by their tables.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

_TEXT_MAX = 80
_BITS_MAX = 256


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong in a scenario.

    Parameters
    ----------
    path
        The key, such as ``aircraft[1].start.speed_m_s`` (counted from 0), or a place in the file
        (``line 3, column 7``), or empty for the file as a whole.
    arrived
        What stands there.
    expected
        What would be right.
    whom
        The aircraft or goal by its name, such as ``aircraft "north"``; empty where it has none.
    line
        Line of the file in which the key stands, from 1, or the innermost of its tables that does; None: not known.
    """

    path: str
    arrived: str
    expected: str
    whom: str = ""
    line: int | None = field(default=None, compare=False)

    def __str__(self) -> str:
        whom = f" ({self.whom})" if self.whom else ""
        line = "" if self.line is None else f"line {self.line}, "
        where = f"{line}{self.path}{whom}: " if self.path else ""
        return f"{where}arrived {self.arrived}; expected {self.expected}"


class ScenarioError(ValueError):
    """A scenario that cannot be flown; ``str()`` is the finished message.

    The first line names the file, every further line is one problem.

    Parameters
    ----------
    source
        The file, or another name of the place that the scenario came from.
    problems
        At least one problem.
    """

    def __init__(self, source: str, problems: Sequence[Problem]) -> None:
        self.source = source
        self.problems = tuple(problems)
        super().__init__(source, self.problems)

    def __str__(self) -> str:
        count = "1 problem" if len(self.problems) == 1 else f"{len(self.problems)} problems"
        return "\n  ".join([f"{self.source or 'scenario'}: {count}", *map(str, self.problems)])


def problem_error(source: str, arrived: str, expected: str, path: str = "") -> ScenarioError:
    """One problem, with a file as a whole or at a path."""
    return ScenarioError(source, [Problem(path, arrived, expected)])


def os_error_reason(error: Exception) -> str:
    """Why the system did not read or write a file, without its name."""
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)


def describe_value(value: object) -> str:
    """Describe a value that arrived (what a TOML file can hold, or None) in the words of such a file, on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        text = f'"{value}"' if value.isprintable() else repr(value)
        return text if len(text) <= _TEXT_MAX else f'{text[:_TEXT_MAX]}..." ({len(value)} characters)'
    if isinstance(value, int):
        # Python refuses to print very long whole numbers
        return str(value) if value.bit_length() <= _BITS_MAX else f"a whole number of {value.bit_length()} bits"
    if isinstance(value, float):
        return repr(value)  # with its point: 1.0 is no whole number
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    return "nothing" if value is None else f"{value} ({type(value).__name__})"


def format_number(value: float) -> str:
    """Write a number of a validated scenario without needless zeros: all its digits, to 15."""
    return f"{value:.15g}"


FileKind = Literal["scenario", "study", "aircraft"]
_TABLES_OF_KIND: dict[FileKind, frozenset[str]] = {
    "scenario": frozenset({"timing", "fleet", "aircraft", "goal"}),
    "study": frozenset({"scenario", "sampling", "vary", "rare"}),
    "aircraft": frozenset({"mass", "surface", "aerodynamics", "dave_ml"}),
}
"""Tables by which each is known: no other kind has them."""


def check_file_kind(kind: FileKind, values: Mapping[str, Any], source: str) -> None:
    """Refuse values that have nothing of this kind of file and something of another (ScenarioError)."""
    if _TABLES_OF_KIND[kind] & values.keys():
        return
    for other, own in _TABLES_OF_KIND.items():
        if own & values.keys():
            command = {
                "scenario": f"anser check {source}",
                "study": f"anser {'rare' if 'rare' in values else 'campaign'} {source} --out FOLDER",
                "aircraft": f"anser aircraft check {source}",
            }[other]
            raise problem_error(
                source, f"{_kind_text(other)}, by its tables", f"{_kind_text(kind)}; for this one: {command}"
            )


def _kind_text(kind: FileKind) -> str:
    return f"{'an' if kind == 'aircraft' else 'a'} {kind} file"
