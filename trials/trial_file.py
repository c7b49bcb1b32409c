"""A file of trials: one JSON line about all of them, then one per trial, so that an interrupted run loses nothing."""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trials.runner import Trial

__all__ = ["FORMAT", "TrialFileError", "append_trial", "begin_trials", "read_trials"]

FORMAT = "anser plan trials 2"


class TrialFileError(ValueError):
    """The file is none of trials, or not of these; the text says what arrived and what was expected."""


def begin_trials(path: Path, iterations: int) -> None:
    """Make a new file without trials.

    Raises
    ------
    FileExistsError
        If there is one: nothing is overwritten.
    """
    with path.open("x", encoding="utf-8") as file:
        file.write(json.dumps({"format": FORMAT, "search_iterations": iterations}) + "\n")


def append_trial(path: Path, trial: Trial) -> None:
    """Add a trial at the end; once this returns it is in the file."""
    line = json.dumps(dataclasses.asdict(trial), allow_nan=False, default=_plain)
    with path.open("a", encoding="utf-8") as file:
        file.write(line + "\n")


def _plain(value: Any) -> Any:
    """Numbers that are not Python's own."""
    return value.item()


def read_trials(path: Path, iterations: int) -> list[Trial]:
    """Trials of a file of as many search iterations; a last line that was cut short is taken out of it.

    Raises
    ------
    TrialFileError
        If the file is another kind, of another number of iterations, or broken elsewhere than in its last line.
    """
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    lines = whole.splitlines()
    head = _parsed(lines[0], path, 1) if lines else {}
    if head.get("format") != FORMAT:
        raise TrialFileError(
            f"arrived {path}, which does not begin as a file of trials; expected {FORMAT!r} in its head"
        )
    if head.get("search_iterations") != iterations:
        raise TrialFileError(
            f"arrived {path}, of {head.get('search_iterations')} search iterations; expected {iterations} as asked now"
        )
    trials = list(_trials(lines, path))
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    return trials


def _trials(lines: list[str], path: Path) -> Iterator[Trial]:
    names = {field.name for field in dataclasses.fields(Trial)}
    for k, line in enumerate(lines[1:], start=2):
        row = _parsed(line, path, k)
        if set(row) != names:
            raise TrialFileError(f"arrived {path} with other fields than a trial's in line {k}; expected a trial")
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in row.items()
        }
        yield Trial(**values)


def _parsed(line: str, path: Path, number: int) -> dict[str, Any]:
    try:
        row = json.loads(line)
    except json.JSONDecodeError:
        row = None
    if not isinstance(row, dict):
        raise TrialFileError(f"arrived {path}, whose line {number} is no JSON object; expected one per line")
    return row
