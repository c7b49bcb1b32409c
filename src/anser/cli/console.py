"""What all commands share: where everything that they say goes, tables, refusals of bad input.

Three consoles. `screen` holds the results, on standard output; `note` holds messages (cautions, where files went) and
progress, on standard error; `err` holds what is wrong, on standard error, and is never silenced. With ``--json`` the
screen is dark and `answer` writes the document there instead; with ``--quiet`` screen and notes are dark. All of them
leave colours away where NO_COLOR is set or nobody looks.
"""

import contextlib
import json
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import rich.box
import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Column, Table
from rich.text import Text

from anser.aircraft_files.sources import DAVE_ML_SUFFIX, SUFFIXES, VARIANTS, aircraft_types, unknown_type_hint
from anser.cli.process import interrupts


def _console(**look: Any) -> Console:
    """Console to which text is text: square brackets are no markup, words between colons no pictures."""
    return Console(markup=False, emoji=False, **look)


screen = _console()
note = _console(stderr=True, highlight=False)
err = _console(stderr=True, highlight=False)

_WIDTH_MIN = 120  # columns of a table that nobody looks at on a screen: a pipe has none of its own
_RANGES = {
    "speed_m_s": (1, 1000),
    "altitude_m": (-500, 30000),
    "cg": (0.1, 0.5),
    "x_cg": (0.1, 0.5),
    "path_angle_deg": (-80, 80),
    "turn_rate_deg_s": (-60, 60),
    "path_rate_deg_s": (-60, 60),
    "pitch_rate_deg_s": (-60, 60),
}
"""What the options of a flight condition may be, in the order in which they are looked at."""
_BAR_WIDTH = 16  # with the longest text, and the times, within 80 columns
_SPEED_PERIOD_S = 3600.0
"""The time left follows from the mean speed so far: steps of a campaign are minutes apart."""
_LOG_PERIOD_S = 60.0
"""Between two lines of progress where there is no screen."""


@dataclass
class _Request:
    """What the command under way was asked for, and whether it has answered."""

    as_json: bool = False
    answered: bool = False


_request = _Request()


@contextlib.contextmanager
def output(as_json: bool, quiet: bool) -> Iterator[None]:
    """Direct what one command says.

    Raises
    ------
    RuntimeError
        The command ended with exit code 0 or 1 without the document that was asked for: a fault of the command.
    """
    _request.as_json, _request.answered = as_json, False
    screen.quiet, note.quiet = as_json or quiet, quiet
    try:
        yield
        _must_have_answered()
    except typer.Exit as end:
        if end.exit_code in (0, 1):
            _must_have_answered()
        raise
    finally:
        _request.as_json = False
        screen.quiet = note.quiet = False


def _must_have_answered() -> None:
    if _request.as_json and not _request.answered:
        raise RuntimeError("the command has no JSON document")


def print_document(document: Callable[[], Mapping[str, Any]]) -> None:
    """With ``--json``, print the document, all that stands on standard output; without, do nothing.

    Parameters
    ----------
    document
        Makes the document, without NaN and infinity, which JSON has not.
    """
    if _request.as_json:
        sys.stdout.write(json.dumps(document(), indent=1, allow_nan=False) + "\n")
        _request.answered = True


def end_without_result(what: str, reasons: Sequence[str], prefix: str = "") -> NoReturn:
    """Say why there is no result, and end with exit code 1; the JSON document then holds the reasons.

    Parameters
    ----------
    what
        What came instead, such as "no plan": the status of the document.
    reasons
        A message each.
    prefix
        Stands before each reason on standard error.
    """
    print_document(lambda: {"format_version": 1, "status": what, "reasons": list(reasons)})
    for reason in reasons:
        print_problem(prefix + reason)
    raise typer.Exit(1)


def print_note(text: str) -> None:
    """Give a message that ``--quiet`` leaves away."""
    note.print(text, soft_wrap=True)


def print_problem(text: str) -> None:
    """Tell what is wrong."""
    err.print(text, soft_wrap=True)


def print_line(text: str) -> None:
    """Print a line of the results."""
    screen.print(text, soft_wrap=True, highlight=False)


class _Times(ProgressColumn):
    """Time gone, and the time left as soon as it can be told."""

    def render(self, task: Task) -> Text:
        """Text of both."""
        gone, left = task.elapsed or 0.0, task.time_remaining
        more = "" if left is None or task.finished else f", {_clock(left)} left"
        return Text(_clock(gone) + more, style="progress.elapsed")


def _clock(seconds: float) -> str:
    """Minutes and seconds, and hours where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def progress_bar() -> contextlib.AbstractContextManager[Callable[[str, float | None], None]]:
    """Bar with the time gone and left, gone at the end; without a screen a line each minute.

    It is told what is being done and how much of it is done, 0 to 1; None: nobody knows, the bar only moves.
    """
    return _progress_display(
        "starting", 1.0, _description_column(), BarColumn(_BAR_WIDTH), TaskProgressColumn(), _Times()
    )


def activity(what: str) -> contextlib.AbstractContextManager[Callable[[str], None]]:
    """Sign of life with the time gone, where nobody knows how long it takes; told what is being done."""
    return _progress_display(what, None, SpinnerColumn(), _description_column(), TimeElapsedColumn())


def _description_column() -> TextColumn:
    return TextColumn("{task.description}", markup=False)


@contextlib.contextmanager
def _progress_display(what: str, total: float | None, *columns: ProgressColumn) -> Iterator[Callable[..., None]]:
    """Line on the screen, told what is being done and how much of it is; it says so while anser compiles."""
    from anser.compiling.program import watch_compilation  # here: help needs no JAX

    disable = not note.is_terminal or note.quiet
    with Progress(
        *columns, console=note, transient=True, disable=disable, speed_estimate_period=_SPEED_PERIOD_S
    ) as bar:
        task = bar.add_task("", total=None)
        now, part = what, None

        def show(compiling: bool) -> None:
            # How long the compiler takes nobody knows either.
            bar.tasks[0].total = None if compiling or part is None else total
            bar.update(task, description=f"{now}: compiling" if compiling else now, completed=part)

        def tell(doing: str, done: float | None = None) -> None:
            nonlocal now, part
            interrupts.check()
            now, part = doing, done
            show(compiling=False)

        show(compiling=False)
        with watch_compilation(show), _log_progress(bar):
            yield tell


@contextlib.contextmanager
def _log_progress(bar: Progress) -> Iterator[None]:
    """A line each minute where there is no screen, so that a log shows that the work goes on."""
    if note.is_terminal or note.quiet:
        yield
        return
    ended, began = threading.Event(), time.monotonic()

    def tell() -> None:
        while not ended.wait(_LOG_PERIOD_S):
            task = bar.tasks[0]
            done = "" if task.total is None else f", {task.percentage:.0f} %"
            print_note(f"{task.description}{done}, {_clock(time.monotonic() - began)} gone")

    telling = threading.Thread(target=tell, daemon=True)
    telling.start()
    try:
        yield
    finally:
        ended.set()
        telling.join()


class RefusedError(Exception):
    """Bad input found by the command line itself; the text is the finished message."""


def must_be_in_range(option: str, value: float, low: float, high: float) -> None:
    """Refuse a number outside a range."""
    if not (math.isfinite(value) and low <= value <= high):
        raise RefusedError(f"{option}: arrived {value:g}; expected a number from {low:g} to {high:g}")


def plain_table(title: str, *columns: Column | str) -> Table:
    """Table without lines between its rows."""
    return Table(*columns, title=title, box=rich.box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)


def columns(*headings: str, **look: Any) -> list[Column]:
    """Columns of one look for `plain_table`: `justify`, `overflow`, `no_wrap`."""
    return [Column(heading, **look) for heading in headings]


def number(value: float | None, digits: int) -> str:
    """Number with so many decimals; a dash for none."""
    return "-" if value is None else f"{value:.{digits}f}"


def print_table(table: Table) -> None:
    """Print on the screen, or without cutting or folding anything where it is no screen."""
    if screen.is_terminal or screen.quiet:
        screen.print(table)
        return
    width = screen.measure(table, options=screen.options.update(max_width=10_000)).maximum
    _console(file=screen.file, width=max(_WIDTH_MIN, width)).print(table)


def flight_point(at: str) -> tuple[float, float]:
    """Speed and altitude (m/s, m) of an option --at."""
    try:
        speed, altitude = (float(part) for part in at.split(","))
    except ValueError:
        raise RefusedError(f"--at: arrived {at!r}; expected SPEED,ALTITUDE in m/s and m, such as 150,2000") from None
    must_be_in_range("--at, speed", speed, *_RANGES["speed_m_s"])
    must_be_in_range("--at, altitude", altitude, *_RANGES["altitude_m"])
    return speed, altitude


@contextlib.contextmanager
def trim_progress(what: str) -> Iterator[Callable[[str], None]]:
    """As `working`; ends the command with exit code 1 where there is no steady flight at the condition."""
    from anser.analysis.trim_points import ConditionError

    try:
        with activity(what) as tell:
            yield tell
    except ConditionError as error:
        end_without_result("no steady flight", [str(error)])


def must_be_flight_condition(condition: Mapping[str, float | None]) -> None:
    """Refuse numbers outside the range of their options, and a pitch rate beside another rate.

    Parameters
    ----------
    condition
        Parameters of the command by name: speed, altitude, centre of gravity, path angle, rates; None: not given.
    """
    for name, (low, high) in _RANGES.items():
        value = condition.get(name)
        if value is not None:
            must_be_in_range(_option(name), value, low, high)
    pitch_rate = condition.get("pitch_rate_deg_s")
    for name in ("turn_rate_deg_s", "path_rate_deg_s"):
        rate = condition.get(name)
        if rate and pitch_rate:
            option, other = _option("pitch_rate_deg_s"), _option(name)
            raise RefusedError(f"{option}: arrived {pitch_rate:g} with {other} {rate:g}; expected one of them 0")


def _option(parameter: str) -> str:
    return f"--{parameter.replace('_', '-')}"


F16_SURVEYS_ONLY = (
    "grid, limits and gains of this survey are the F-16's; of another aircraft anser aircraft show has the trim map, "
    "anser margins --at and anser gallery --aircraft the autopilot"
)
"""What to do where a survey is of the F-16 alone."""


def must_be_f16(aircraft: str, instead: str) -> None:
    """Refuse another airframe than the F-16 for a survey that is made for it; `instead` says what works."""
    if aircraft not in VARIANTS:
        raise RefusedError(f"--aircraft: arrived {aircraft!r}; expected f16 with any --variant: {instead}")


def must_be_known_aircraft(aircraft: str, variant: str) -> None:
    """Refuse an airframe that nobody offers, or a variant that it does not have; files are read later."""
    if Path(aircraft).suffix not in (*SUFFIXES, DAVE_ML_SUFFIX) and aircraft not in aircraft_types():
        words = f"{unknown_type_hint(aircraft)}, or the path of an aircraft file (.toml)"
        raise RefusedError(f"--aircraft: arrived {aircraft!r}; expected {words}")
    known = VARIANTS.get(aircraft, ("textbook",))
    if variant not in known:
        words = f"one of {', '.join(known)}" if aircraft in VARIANTS else f"none: {aircraft} has no variants"
        raise RefusedError(f"--variant: arrived {variant!r}; expected {words}")
