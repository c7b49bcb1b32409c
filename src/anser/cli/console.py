"""Output common to all commands: consoles, tables, progress, and errors for invalid input.

- `screen`: results on standard output; silent with --json or --quiet
- `note`: messages and progress on standard error; silent with --quiet
- `err`: errors on standard error

Consoles use no colour if NO_COLOR is set or the output is not a terminal.
"""

import contextlib
import itertools
import json
import math
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
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
from rich.table import Table
from rich.text import Text

from anser.aircraft_files.sources import DAVE_ML_SUFFIX, SUFFIXES, VARIANTS, aircraft_types, unknown_type_hint
from anser.cli.process import interrupts
from anser.environment.air import AIRSPEED_FORMS, STANDARD_LAYERS, AirspeedForm, Layers, air_in_layers, true_airspeed


def _console(**look: Any) -> Console:
    """Return a console that prints brackets and words between colons literally, not as markup or emoji."""
    return Console(markup=False, emoji=False, **look)


screen = _console()
note = _console(stderr=True, highlight=False)
err = _console(stderr=True, highlight=False)

_WIDTH_MIN = 120  # least width of tables without a terminal, characters
_RANGES = {
    "speed_m_s": (1, 1000),
    "speed_cas_m_s": (1, 1000),
    "speed_eas_m_s": (1, 1000),
    "mach": (0.001, 3),
    "altitude_m": (-500, 30000),
    "cg": (0.1, 0.5),
    "x_cg": (0.1, 0.5),
    "path_angle_deg": (-80, 80),
    "turn_rate_deg_s": (-60, 60),
    "path_rate_deg_s": (-60, 60),
    "pitch_rate_deg_s": (-60, 60),
}
"""Permitted range of each flight-condition option, in the order in which they are checked."""
_BAR_WIDTH = 16  # fits 80 columns with the longest description
_SPEED_PERIOD_S = 3600.0
"""Period over which progress is averaged to estimate the remaining time, s: campaign steps may be minutes apart."""
_REFRESH_PERIOD_S, _LOG_PERIOD_S = 1.0, 10.0
"""Time between two updates of the progress line, and between two printed lines without a terminal, s."""


@dataclass
class _Request:
    """State of the current command: whether --json was used, and whether the JSON document was printed."""

    as_json: bool = False
    answered: bool = False


_request = _Request()


@contextlib.contextmanager
def output(as_json: bool, quiet: bool) -> Iterator[None]:
    """Apply --json and --quiet to the consoles in the `with` block, in which one command runs.

    Raises RuntimeError if --json is used and the command ends with exit code 0 or 1 before it prints the document.
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
    """Print the JSON document that `document` returns to standard output if --json was used.

    `document` is called with --json only; the result must not contain NaN or infinity.
    """
    if _request.as_json:
        sys.stdout.write(json.dumps(document(), indent=1, allow_nan=False) + "\n")
        _request.answered = True


def end_without_result(status: str, reasons: Sequence[str], prefix: str = "") -> NoReturn:
    """Print the `reasons` for a missing result, each after `prefix`, and exit with code 1.

    If --json was used, the document has the reasons and `status`, such as "no plan".
    """
    print_document(lambda: {"format_version": 1, "status": status, "reasons": list(reasons)})
    fail_if_any(prefix + reason for reason in reasons)
    raise typer.Exit(1)


def fail_if_any(problems: Iterable[str]) -> None:
    """Print problems as error messages and exit with code 1, if there are any."""
    texts = list(problems)
    for text in texts:
        print_problem(text)
    if texts:
        raise typer.Exit(1)


def print_note(text: str) -> None:
    """Print a message, except with ``--quiet``."""
    note.print(text, soft_wrap=True)


def print_problem(text: str) -> None:
    """Print an error message."""
    err.print(text, soft_wrap=True)


def print_line(text: str) -> None:
    """Print a line of the results, except with ``--json`` or ``--quiet``."""
    screen.print(text, soft_wrap=True, highlight=False)


class _Times(ProgressColumn):
    """Column of a progress bar: elapsed time, and the estimated remaining time if known."""

    def render(self, task: Task) -> Text:
        elapsed, remaining = task.elapsed or 0.0, task.time_remaining
        remaining_text = "" if remaining is None or task.finished else f", {_clock(remaining)} left"
        return Text(_clock(elapsed) + remaining_text, style="progress.elapsed")


def _clock(seconds: float) -> str:
    minutes, remaining_seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{remaining_seconds:02d}" if hours else f"{minutes}:{remaining_seconds:02d}"


def progress_bar() -> contextlib.AbstractContextManager[Callable[[str, float | None], None]]:
    """Return a context manager that shows a progress bar on standard error, with elapsed and remaining time.

    >>> with anser.progress_bar() as progress:
    ...     flown = anser.run("scenarios/three-aircraft.toml", progress)

    The context manager yields a function that sets the description and the completed fraction, 0..1 (None: unknown). If
    standard error is not a terminal, a line is printed every ten seconds.
    """
    columns = (_description_column(), BarColumn(_BAR_WIDTH), TaskProgressColumn(), _Times())
    return _progress_display("starting", 1.0, *columns)


def activity(description: str) -> contextlib.AbstractContextManager[Callable[[str], None]]:
    """Return a context manager that shows a spinner, and yields a function that sets the description of the work."""
    return _progress_display(description, None, SpinnerColumn(), _description_column(), TimeElapsedColumn())


def _description_column() -> TextColumn:
    return TextColumn("{task.description}", markup=False)


@contextlib.contextmanager
def _progress_display(
    first_description: str, total: float | None, *columns: ProgressColumn
) -> Iterator[Callable[..., None]]:
    """Show a progress line in the `with` block, and yield a function that sets description and completed fraction.

    The line says if the process waits for a compilation. `total` is the fraction at the end of the work (1), or None
    for work of unknown duration.
    """
    from anser.compiling.measuring import compilation_message

    disable = not note.is_terminal or note.quiet
    with Progress(
        *columns, console=note, transient=True, disable=disable, speed_estimate_period=_SPEED_PERIOD_S
    ) as bar:
        task = bar.add_task("", total=None)
        description, fraction = first_description, None

        def show() -> None:
            compiling = compilation_message()
            bar.tasks[0].total = None if compiling or fraction is None else total
            bar.update(task, description=compiling or description, completed=fraction)

        def tell(new_description: str, new_fraction: float | None = None) -> None:
            nonlocal description, fraction
            interrupts.check()
            description, fraction = new_description, new_fraction
            show()

        show()
        with _refreshed(bar, show):
            yield tell


@contextlib.contextmanager
def _refreshed(bar: Progress, show: Callable[[], None]) -> Iterator[None]:
    """Call `show` every second in the `with` block; if the output is no terminal, print a line every ten seconds."""
    ended, began = threading.Event(), time.monotonic()

    def refresh() -> None:
        printed = began
        while not ended.wait(_REFRESH_PERIOD_S):
            show()
            now, task = time.monotonic(), bar.tasks[0]
            if not note.is_terminal and now - printed >= _LOG_PERIOD_S:
                printed = now
                percentage = "" if task.total is None else f", {task.percentage:.0f} %"
                print_note(f"{task.description}{percentage}, {_clock(now - began)} gone")

    refresher = threading.Thread(target=refresh, daemon=True)
    refresher.start()
    try:
        yield
    finally:
        ended.set()
        refresher.join()


class InputError(Exception):
    """Invalid input on the command line; `str()` is the complete message."""


@contextlib.contextmanager
def refuse_on(error_type: type[Exception], prefix: str = "") -> Iterator[None]:
    """Convert errors of one type in the `with` block to InputError; `prefix`, before the message, names the option."""
    try:
        yield
    except error_type as error:
        raise InputError(f"{prefix}{error}") from None


def must_be_in_range(option: str, value: float, low: float, high: float, advice: str = "") -> None:
    """Raise InputError if an option's number is not finite or outside [low, high]; `advice` follows the message."""
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{option}: arrived {value:g}; expected a number from {low:g} to {high:g}{advice}")


@dataclass(frozen=True)
class TableColumn:
    """Column of `print_table`."""

    heading: str
    digits: int = 0  # number of decimals
    options: Mapping[str, Any] = field(default_factory=dict)  # options of rich's `add_column` (`justify`, ...)


def columns(*headings: str, digits: int = 0, **options: Any) -> list[TableColumn]:
    """Return a column for each heading; numbers have `digits` decimals."""
    return [TableColumn(heading, digits, options) for heading in headings]


def number(value: float | None, digits: int) -> str:
    """Format a number with `digits` decimals; a dash for None, NaN and infinity."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def print_table(
    title: str,
    columns: Sequence[TableColumn],
    rows: Iterable[Sequence[str | float | Text | None]],
    styles: Iterable[str | None] = (),
) -> None:
    """Print a table of results, except with --json or --quiet; None, NaN and infinity are a dash.

    `styles` has one style per row. If the output is not a terminal, lines are neither wrapped nor cut.
    """
    table = Table(title=title, box=rich.box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    for column in columns:
        table.add_column(column.heading, **column.options)
    for row, style in itertools.zip_longest(rows, styles):
        cells = zip(columns, row, strict=True)
        texts = [cell if isinstance(cell, str | Text) else number(cell, column.digits) for column, cell in cells]
        table.add_row(*texts, style=style)
    if screen.is_terminal or screen.quiet:
        screen.print(table)
        return
    width = screen.measure(table, options=screen.options.update(max_width=10_000)).maximum
    _console(file=screen.file, width=max(_WIDTH_MIN, width)).print(table)


def flight_point(at: str) -> tuple[float, float]:
    """Return the true airspeed (m/s) and altitude (m) of an option --at, "SPEED,ALTITUDE".

    A prefix selects another airspeed, which the standard atmosphere converts: "cas:140,2000", "eas:138,2000",
    "mach:0.45,2000". Raises InputError if the option is invalid.
    """
    try:
        speed_text, altitude_text = at.split(",")
        prefix, _, number_text = speed_text.rpartition(":")
        form, speed, altitude = _AT_FORMS[prefix.strip().lower()], float(number_text), float(altitude_text)
    except (ValueError, KeyError):
        raise InputError(
            f"--at: arrived {at!r}; expected SPEED,ALTITUDE in m/s and m, such as 150,2000 (true airspeed), "
            "cas:140,2000, eas:138,2000 or mach:0.45,2000"
        ) from None
    must_be_in_range("--at, speed", speed, *_RANGES[form])
    must_be_in_range("--at, altitude", altitude, *_RANGES["altitude_m"])
    return float(true_airspeed(form, speed, air_in_layers(STANDARD_LAYERS, altitude))), altitude


_AT_FORMS: dict[str, AirspeedForm] = {
    "": "speed_m_s",
    "tas": "speed_m_s",
    "cas": "speed_cas_m_s",
    "eas": "speed_eas_m_s",
    "mach": "mach",
}
"""Form of the airspeed in an option --at (true, calibrated, equivalent, Mach number), by the prefix of the number."""


def true_airspeed_of(
    altitude_m: float, airspeeds: Mapping[AirspeedForm, float | None], layers: Layers = STANDARD_LAYERS
) -> float:
    """Return the true airspeed, m/s, for the one airspeed option that is not None, at an altitude, m.

    `airspeeds` has the options by form: true, calibrated, equivalent, Mach number. `layers` is the atmosphere. Raises
    InputError if the number of options is not one, or if airspeed or altitude is outside its range.
    """
    arrived = [form for form in AIRSPEED_FORMS if airspeeds[form] is not None]
    if len(arrived) != 1:
        options = " and ".join(map(_option, arrived)) or "nothing"
        raise InputError(f"airspeed: arrived {options}; expected one of {', '.join(map(_option, AIRSPEED_FORMS))}")
    must_be_flight_condition({**airspeeds, "altitude_m": altitude_m})
    ((form, value),) = ((form, value) for form, value in airspeeds.items() if value is not None)
    return float(true_airspeed(form, value, air_in_layers(layers, altitude_m)))


@contextlib.contextmanager
def trim_progress(description: str) -> Iterator[Callable[[str], None]]:
    """Show a spinner with the text `description` in the `with` block, and yield a function that replaces the text.

    If the block raises ConditionError (no steady flight), the reason is printed and the command ends with code 1.
    """
    from anser.analysis.trim_points import ConditionError

    try:
        with activity(description) as tell:
            yield tell
    except ConditionError as error:
        end_without_result("no steady flight", [str(error)])


def must_be_flight_condition(condition: Mapping[str, float | None]) -> None:
    """Raise InputError if a value is outside `_RANGES`, or if a pitch rate is given with a turn or path rate.

    `condition` has the values by name of the option; None stands for an option that is not given.
    """
    for name, (low, high) in _RANGES.items():
        value = condition.get(name)
        if value is not None:
            must_be_in_range(_option(name), value, low, high)
    pitch_rate = condition.get("pitch_rate_deg_s")
    for name in ("turn_rate_deg_s", "path_rate_deg_s"):
        rate = condition.get(name)
        if rate and pitch_rate:
            option, rate_option = _option("pitch_rate_deg_s"), _option(name)
            raise InputError(f"{option}: arrived {pitch_rate:g} with {rate_option} {rate:g}; expected one of them 0")


def _option(parameter: str) -> str:
    return f"--{parameter.replace('_', '-')}"


def must_be_f16(aircraft: str, instead: str) -> None:
    """Raise InputError if the aircraft is not the F-16; `instead` names the alternative for other aircraft."""
    if aircraft not in VARIANTS:
        raise InputError(f"--aircraft: arrived {aircraft!r}; expected f16 with any --variant: {instead}")


def must_be_known_aircraft(aircraft: str, variant: str, parameter: str = "--aircraft", cg: float | None = None) -> None:
    """Raise InputError if an airframe's name (option `parameter`), variant or option --cg is unknown to it.

    Paths are not checked. The F-16 alone has the centre of gravity `cg`.
    """
    if Path(aircraft).suffix not in (*SUFFIXES, DAVE_ML_SUFFIX) and aircraft not in aircraft_types():
        expected = f"{unknown_type_hint(aircraft)}, or the path of an aircraft file (.toml)"
        raise InputError(f"{parameter}: arrived {aircraft!r}; expected {expected}")
    variants = VARIANTS.get(aircraft, ("textbook",))
    if variant not in variants:
        expected = f"one of {', '.join(variants)}" if aircraft in VARIANTS else f"none: {aircraft} has no variants"
        raise InputError(f"--variant: arrived {variant!r}; expected {expected}")
    if cg is not None and aircraft not in VARIANTS:
        raise InputError(f"--cg: arrived {cg:g} with {aircraft}; expected none: the F-16 alone has it")
