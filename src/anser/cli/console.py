"""What all commands share: the consoles, the progress bar, refusals, tables."""

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import rich.box
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from anser.scenario import AIRFRAMES, VARIANTS

screen = Console()
err = Console(stderr=True, highlight=False)

_WIDTH_MIN = 120  # columns of a table that nobody looks at on a screen: a pipe has none of its own


class RefusedError(Exception):
    """Bad input found by the command line itself; the text is the finished message."""


@contextlib.contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """Bar on standard error, gone at the end, never there without a screen; told what is being done, and 0 to 1."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, done: bar.update(task, description=what, completed=done)


def make_new(folder: Path) -> None:
    """Make the output folder, before anything is flown; refuse one that exists or cannot be made."""
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise RefusedError(
            f"--out: arrived {folder}, which exists; expected a new folder (nothing is overwritten)"
        ) from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise RefusedError(f"--out: arrived {folder}; expected a place where a folder can be made ({reason})") from None


def must_lie(option: str, value: float, low: float, high: float) -> None:
    """Refuse a number outside a range."""
    if not (math.isfinite(value) and low <= value <= high):
        raise RefusedError(f"{option}: arrived {value:g}; expected a number from {low:g} to {high:g}")


def plain_table(title: str) -> Table:
    """Table without lines between its rows."""
    return Table(title=title, box=rich.box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)


def number(value: float | None, digits: int) -> str:
    """Number with so many decimals; a dash for none."""
    return "-" if value is None else f"{value:.{digits}f}"


def print_table(table: Table) -> None:
    """Print on the screen, or without cutting or folding anything where it is no screen."""
    if screen.is_terminal:
        screen.print(table)
        return
    width = screen.measure(table, options=screen.options.update(max_width=10_000)).maximum
    Console(file=screen.file, width=max(_WIDTH_MIN, width)).print(table)


def flight_point(at: str) -> tuple[float, float]:
    """Speed and altitude (m/s, m) of an option --at."""
    try:
        speed, altitude = (float(part) for part in at.split(","))
    except ValueError:
        raise RefusedError(f"--at: arrived {at!r}; expected SPEED,ALTITUDE in m/s and m, such as 150,2000") from None
    must_lie("--at, speed", speed, 1, 1000)
    must_lie("--at, altitude", altitude, -500, 30000)
    return speed, altitude


def must_be_new_picture(option: str, path: Path, suffixes: Sequence[str]) -> None:
    """Refuse a picture that cannot be written, before anything is computed."""
    if path.suffix not in suffixes:
        raise RefusedError(f"{option}: arrived {path}; expected a name that ends with {', '.join(suffixes)}")
    if path.exists():
        raise RefusedError(f"{option}: arrived {path}, which exists; expected a new file (nothing is overwritten)")
    if not path.parent.is_dir():
        raise RefusedError(f"{option}: arrived {path}; expected a file in a folder that exists")


def must_be_known(aircraft: str, variant: str) -> None:
    """Refuse an airframe, or a variant of it, that the library does not have."""
    if aircraft not in AIRFRAMES:
        raise RefusedError(f"--aircraft: arrived {aircraft!r}; expected one of {', '.join(AIRFRAMES)}")
    if variant not in VARIANTS[aircraft]:
        raise RefusedError(f"--variant: arrived {variant!r}; expected one of {', '.join(VARIANTS[aircraft])}")
