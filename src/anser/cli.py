"""The command line. Exit codes: 0 done; 1 flown but a requirement not met; 2 bad input; 3 internal fault."""

import contextlib
import gc
import math
import sys
import traceback
from pathlib import Path
from typing import Annotated

import rich.box
import rich.progress
import typer
from rich.console import Console
from rich.table import Table

import anser
from anser.scenario import AIRFRAMES, VARIANTS, ScenarioError, load, load_airframe, write_starter

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Fleets of fixed-wing aircraft that must be at moving places at the same time. Civil simulation only.",
)
_out = Console()
_err = Console(stderr=True, highlight=False)

ScenarioPath = Annotated[Path, typer.Argument(help="Scenario file (TOML).", show_default=False)]


class RefusedError(Exception):
    """Bad input found by the command line itself; the text is the finished message."""


@app.callback(invoke_without_command=True)
def _top(version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False) -> None:
    if version:
        _out.print(f"anser {anser.__version__}")
        raise typer.Exit


@app.command()
def run(
    scenario: ScenarioPath,
    out: Annotated[
        Path | None, typer.Option(help="New folder for flight.nc, summary.json, report.html; default runs/NAME.")
    ] = None,
) -> None:
    """Fly a scenario, write its results into a new folder and print a table."""
    wanted = load(scenario)
    target = out if out is not None else Path("runs") / wanted.name
    _make_new(target)
    from anser.campaign import run as fly  # here: a misspelt key must not wait for plotting libraries

    columns = (
        rich.progress.TextColumn("{task.description}"),
        rich.progress.BarColumn(),
        rich.progress.TaskProgressColumn(),
        rich.progress.TimeElapsedColumn(),
    )
    try:
        with rich.progress.Progress(*columns, console=_err, transient=True) as bar:
            task = bar.add_task("starting", total=1.0)
            flown = fly(wanted, lambda what, done: bar.update(task, description=what, completed=done))
            bar.update(task, description="writing", completed=1.0)
            flown.write_into(target)
    finally:
        with contextlib.suppress(OSError):
            target.rmdir()  # succeeds only while it is empty: a flight that did not end leaves nothing behind
    _print_flown(flown.summary)
    _out.print(f"[bold]{target}[/bold]: flight.nc, summary.json, report.html", soft_wrap=True)
    if not flown.met:
        for problem in flown.planned.problems():
            _err.print(f"planned beyond the limits: {problem}", soft_wrap=True, markup=False)
        _fail_unmet(flown.summary)


@app.command()
def plan(scenario: ScenarioPath) -> None:
    """Plan a scenario without flying it: one arrival time, each aircraft's path, how it keeps the limits."""
    wanted = load(scenario)
    from anser.campaign import plan as make

    with _err.status("planning (the first time, this compiles)"):
        planned = make(wanted)
    _print_planned(planned)
    problems = planned.problems()
    for problem in problems:
        _err.print(f"not flyable: {problem}", soft_wrap=True, markup=False)
    if problems:
        raise typer.Exit(1)


@app.command()
def check(scenario: ScenarioPath) -> None:
    """Check a scenario file without planning or flying it."""
    wanted = load(scenario)
    count = len(wanted.aircraft)
    fleet = "1 aircraft" if count == 1 else f"{count} aircraft"
    goals = "1 goal" if len(wanted.goal) == 1 else f"{len(wanted.goal)} goals"
    _out.print(f"{scenario}: good. {wanted.name}: {fleet}, {goals}, {wanted.timing.duration_s:g} s.", soft_wrap=True)


@app.command()
def trim(
    speed_m_s: Annotated[float, typer.Option(help="True airspeed.", show_default=False)],
    altitude_m: Annotated[float, typer.Option(help="Geometric altitude.", show_default=False)],
    aircraft: Annotated[str, typer.Option(help=f"Airframe: {', '.join(AIRFRAMES)}.")] = "f16",
    variant: Annotated[str, typer.Option(help="Published set of tables: textbook, s119 or founding.")] = "textbook",
    path_angle_deg: Annotated[float, typer.Option(help="Climb angle.")] = 0.0,
    turn_rate_deg_s: Annotated[float, typer.Option(help="Rate of the course, right positive.")] = 0.0,
) -> None:
    """Find the steady flight at a condition, or say what stops it and where the nearest one is."""
    if aircraft not in AIRFRAMES:
        raise RefusedError(f"--aircraft: arrived {aircraft!r}; expected one of {', '.join(AIRFRAMES)}")
    if variant not in VARIANTS[aircraft]:
        raise RefusedError(f"--variant: arrived {variant!r}; expected one of {', '.join(VARIANTS[aircraft])}")
    _must_lie("--speed-m-s", speed_m_s, 1, 1000)
    _must_lie("--altitude-m", altitude_m, -500, 30000)
    _must_lie("--path-angle-deg", path_angle_deg, -80, 80)
    _must_lie("--turn-rate-deg-s", turn_rate_deg_s, -60, 60)
    from anser.campaign import find_trim

    with _err.status("solving (the first time, this compiles)"):
        found = find_trim(load_airframe(aircraft, variant), speed_m_s, altitude_m, path_angle_deg, turn_rate_deg_s)
    if found.diagnosis is not None:
        _err.print(found.diagnosis, soft_wrap=True, markup=False)
        raise typer.Exit(1)
    table = Table(title=f"{aircraft} ({variant}) at {speed_m_s:g} m/s, {altitude_m:g} m")
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for name, value, unit in found.rows:
        table.add_row(name, f"{value:.4f}", unit)
    _out.print(table)


@app.command()
def new(path: Annotated[Path, typer.Argument(help="File to write; it must not exist.", show_default=False)]) -> None:
    """Write a commented scenario to start from."""
    write_starter(path)
    _out.print(f"{path}: written. Next: anser run {path}", soft_wrap=True)


def _make_new(folder: Path) -> None:
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


def _must_lie(option: str, value: float, low: float, high: float) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise RefusedError(f"{option}: arrived {value:g}; expected a number from {low:g} to {high:g}")


def _table(title: str) -> Table:
    return Table(title=title, box=rich.box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _print_flown(summary: dict) -> None:
    table = _table(f"{summary['scenario']['name']}: {summary['fleet']['simulated_s']:g} s flown")
    table.add_column("aircraft", overflow="fold")
    table.add_column("path", no_wrap=True)
    for name in ("planned\ns", "arrival\ns", "miss\nm", "airspeed\nm/s", "clear\nm"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("status", overflow="fold", min_width=7)
    for row in summary["aircraft"]:
        bend = row["lateral_bend_m"]
        side = "nominal" if row["nominal"] or bend is None else ("bent right" if bend > 0 else "bent left")
        speeds = "/".join(_number(row[f"speed_{k}_m_s"], 0) for k in ("min", "mean", "max"))
        left = f" (left the tables for {row['tables_left_s']:.1f} s)" if row["tables_left"] else ""
        table.add_row(
            row["name"],
            side,
            _number(row["planned_arrival_s"], 2),
            _number(row["arrival_s"], 2),
            _number(row["miss_m"], 2),
            speeds,
            _number(row["clearance_min_m"], 0),
            row["status"] + left,
        )
    _out.print(table)
    fleet = summary["fleet"]
    _out.print(
        f"arrival spread {_number(fleet['arrival_spread_s'], 4)} s, least separation "
        f"{_number(fleet['separation_min_m'], 0)} m, {fleet['wall_s']:.1f} s of computing"
    )


def _fail_unmet(summary: dict) -> None:
    """Say which requirements were not met, and stop with exit code 1."""
    for row in summary["requirements"]:
        if not row["met"]:
            _err.print(f"not met: {row['name']}: limit {row['limit']:g}, flown {_number(row['value'], 4)}")
    for row in summary["aircraft"]:
        if row["status"] != "arrived":
            _err.print(f'aircraft "{row["name"]}": {row["status"]}', soft_wrap=True, markup=False)
    raise typer.Exit(1)


def _print_planned(planned: "anser.campaign.Planned") -> None:  # pyright: ignore[reportAttributeAccessIssue]
    made, limits, wanted = planned.plan, planned.limits, planned.scenario
    table = _table(f"{wanted.name}: all arrive at {float(made.arrival_time):.2f} s")
    table.add_column("aircraft", overflow="fold")
    table.add_column("path", no_wrap=True)
    for name in ("nominal\nm", "planned\nm", "airspeed\nm/s", "turn, of\nlimit", "climb\nm/s", "lowest\nm"):
        table.add_column(name, justify="right", no_wrap=True)
    for k, aircraft in enumerate(wanted.aircraft):
        bend = float(made.lateral_bends[k])
        table.add_row(
            aircraft.name,
            "nominal" if bend == 0.0 else ("bent right" if bend > 0 else "bent left"),
            f"{float(made.nominal_lengths[k]):.1f}",
            f"{float(made.lengths[k]):.1f}",
            f"{float(limits.speed_min[k]):.0f} to {float(limits.speed_max[k]):.0f}",
            f"{100 * float(limits.turn_use_max[k]):.0f} %",
            f"{float(limits.climb_rate_max[k]):.1f}",
            f"{float(limits.altitude_min[k]):.0f}",
        )
    _out.print(table)
    apart = "" if planned.separation_min_m is None else f", least separation {planned.separation_min_m:.0f} m"
    _out.print(f"mean airspeed {float(made.speed):.1f} m/s{apart}")


def main() -> None:
    """Run the command line and exit with its code."""
    gc.set_threshold(200_000)  # tracing makes many small objects that live: collecting them again and again takes 10 %
    try:
        app()
    except (ScenarioError, RefusedError) as error:
        _err.print(str(error), soft_wrap=True, markup=False)
        sys.exit(2)
    except KeyboardInterrupt:
        _err.print("stopped; nothing was written")
        sys.exit(130)
    except Exception:  # noqa: BLE001 - the outermost frame: an internal fault must end with its own exit code
        traceback.print_exc()
        _err.print("internal fault of anser: please report the lines above together with the scenario")
        sys.exit(3)


__all__ = ["RefusedError", "app", "main"]
