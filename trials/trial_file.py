"""A file of trials: a JSON header line, then one line per trial, so that an interrupted run loses nothing."""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trials.runner import Trial

__all__ = ["FORMAT", "TrialFileError", "append_trial", "begin_trials", "read_trials"]

FORMAT = "anser plan trials 2"


class TrialFileError(ValueError):
    """The file is not a file of trials, or of other trials; the message states the value found and the expected one."""


def begin_trials(path: Path, iterations: int) -> None:
    """Create a file without trials.

    Raises
    ------
    FileExistsError
        If the file exists: nothing is overwritten.
    """
    with path.open("x", encoding="utf-8") as file:
        file.write(json.dumps({"format": FORMAT, "search_iterations": iterations}) + "\n")


def append_trial(path: Path, trial: Trial) -> None:
    """Append a trial; on return it is written to the file."""
    line = json.dumps(dataclasses.asdict(trial), allow_nan=False, default=_plain)
    with path.open("a", encoding="utf-8") as file:
        file.write(line + "\n")


def _plain(value: Any) -> Any:
    """Convert a NumPy number to a Python number."""
    return value.item()


def read_trials(path: Path, iterations: int) -> list[Trial]:
    """Read the trials of a file with the same number of search iterations; remove a truncated last line from the file.

    Raises
    ------
    TrialFileError
        If the format or the number of iterations differs, or a line other than the last is damaged.
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
        entry = _parsed(line, path, k)
        if set(entry) != names:
            raise TrialFileError(f"arrived {path} with other fields than a trial's in line {k}; expected a trial")
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in entry.items()
        }
        yield Trial(**values)


def _parsed(line: str, path: Path, number: int) -> dict[str, Any]:
    try:
        entry = json.loads(line)
    except json.JSONDecodeError:
        entry = None
    if not isinstance(entry, dict):
        raise TrialFileError(f"arrived {path}, whose line {number} is no JSON object; expected one per line")
    return entry
