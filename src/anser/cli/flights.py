"""Commands about flights: run, check, new."""

import contextlib
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anser.cli.arguments import ScenarioPath
from anser.cli.console import (
    RefusedError,
    answer,
    end_without,
    line,
    make_new,
    make_next,
    number,
    plain_table,
    print_table,
    problem,
    progress_bar,
    say,
)
from anser.cli.offering import about
from anser.cli.run_folder import PLAN
from anser.scenario import Scenario, ScenarioError, cautions, load, write_starter
from anser.scenario import convert as as_format
from anser.scenario.load import read_text
from anser.scenario.schema import DEFAULT_PLANNERS, FORMAT
from anser.scenario.template import write_new

if TYPE_CHECKING:
    import xarray as xr

    from anser.campaign import Planned


def _loaded(path: Path) -> Scenario:
    """Load a scenario and say on the way what it had better not do."""
    scenario = load(path)
    for caution in cautions(scenario):
        say(f"caution: {caution}")
    return scenario


@about(
    "anser run scenarios/three-aircraft.toml",
    "anser run scenarios/storm-sampling.toml --out runs/storm",
    "anser run scenarios/three-aircraft.toml --json --quiet > summary.json",
    "anser run scenarios/twenty-aircraft.toml --plan plans/twenty",
    unmet="flown, but a requirement was not met; or there is no plan",
)
def run(
    scenario: ScenarioPath,
    out: Annotated[
        Path | None,
        typer.Option(
            help="New folder for flight.nc, summary.json, report.html; left out: runs/NAME, or runs/NAME-2, ... "
            "where that exists.",
            show_default=False,
        ),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(help="Folder that anser plan --out wrote: its plan is flown, none is made.", show_default=False),
    ] = None,
) -> None:
    """Fly a scenario, write its results into a new folder and print a table."""
    wanted = _loaded(scenario)
    if plan is not None and not (plan / PLAN).is_file():
        words = f"a folder without {PLAN}" if plan.is_dir() else "no folder"
        raise RefusedError(f"--plan: arrived {plan}, {words}; expected a folder that anser plan --out wrote")
    if out is not None:
        make_new(out)
    target = out if out is not None else make_next(Path("runs") / wanted.name)
    from anser.campaign import NoPlanError, PlanFileError
    from anser.campaign import run as fly  # here: a misspelt key must not wait for plotting libraries

    try:
        with progress_bar() as tell:
            flown = fly(wanted, tell, None if plan is None else _finished_plan(plan, wanted))
            tell("writing", 1.0)
            flown.write_into(target)
    except NoPlanError as error:
        end_without("no plan", error.reasons, "no plan: ")
    except PlanFileError as error:
        raise RefusedError(f"--plan: {error}") from None
    finally:
        with contextlib.suppress(OSError):
            target.rmdir()  # succeeds only while it is empty: a flight that did not end leaves nothing behind
    answer(lambda: flown.summary)
    stopped_s = _stopped_s(flown.dataset)
    _print_flown(flown.summary, stopped_s)
    for note in flown.planned.notes():
        say(f"note: {note}")
    say(f"{target}: flight.nc, summary.json, report.html written")
    if not flown.met:
        for beyond in flown.planned.problems():
            problem(f"planned beyond the limits: {beyond}")
        _fail_unmet(flown.summary, stopped_s)


def _finished_plan(folder: Path, wanted: Scenario) -> "Planned":
    from anser.campaign import read_plan

    return read_plan(folder / PLAN, wanted)


@about("anser check scenarios/three-aircraft.toml", "anser check mine.toml --json")
def check(scenario: ScenarioPath) -> None:
    """Check a scenario file without planning or flying it.

    Good: it is well-formed and consistent. Whether a plan exists anser plan finds out; the flight may still fail.
    """
    try:
        wanted = _loaded(scenario)
    except ScenarioError as error:
        found = [dataclasses.asdict(one) for one in error.problems]
        answer(lambda: {"format_version": 1, "file": str(scenario), "good": False, "problems": found})
        raise
    count = len(wanted.aircraft)
    fleet = "1 aircraft" if count == 1 else f"{count} aircraft"
    goals = "1 goal" if len(wanted.goal) == 1 else f"{len(wanted.goal)} goals"
    answer(
        lambda: {
            "format_version": 1,
            "file": str(scenario),
            "good": True,
            "name": wanted.name,
            "hash": wanted.hash,
            "aircraft": count,
            "goals": len(wanted.goal),
            "duration_s": wanted.timing.duration_s,
            "cautions": list(cautions(wanted)),
        }
    )
    line(f"{scenario}: good. {wanted.name}: {fleet}, {goals}, {wanted.timing.duration_s:g} s.")
    line(f"Next: anser plan {scenario}")


@about("anser convert old.toml new.toml", "anser convert new.toml old.toml --format 1")
def convert(
    scenario: ScenarioPath,
    path: Annotated[Path, typer.Argument(help="File to write; it must not exist.", show_default=False)],
    format_: Annotated[int, typer.Option("--format", help="Format to write: 1 or 2.")] = FORMAT,
) -> None:
    """Write a scenario file in another format: it flies as it did, and its comments stay."""
    if format_ not in DEFAULT_PLANNERS:
        raise RefusedError(f"--format: arrived {format_}; expected {' or '.join(map(str, DEFAULT_PLANNERS))}")
    text = as_format(read_text(scenario), str(scenario), format_)
    write_new(path, text)
    answer(lambda: {"format_version": 1, "file": str(path), "format": format_})
    line(f"{path}: written in format {format_}. Next: anser check {path}")


@about("anser new mine.toml")
def new(path: Annotated[Path, typer.Argument(help="File to write; it must not exist.", show_default=False)]) -> None:
    """Write a commented scenario to start from."""
    write_starter(path)
    answer(lambda: {"format_version": 1, "file": str(path)})
    line(f"{path}: written. Next: anser check {path}")


def _stopped_s(dataset: "xr.Dataset") -> dict[str, float]:
    """Since when the record has a status other than that of flying, s, of each aircraft that got one on the way."""
    found = {}
    for name, codes in zip(dataset["aircraft"].values, dataset["status"].values.T, strict=True):
        rows = codes.nonzero()[0]
        if rows.size and rows[0] > 0:
            found[str(name)] = float(dataset["time"].values[rows[0]])
    return found


def _status_text(row: dict, stopped_s: dict[str, float]) -> str:
    """Status of an aircraft, and since when where it got it on the way."""
    since = stopped_s.get(row["name"])
    return row["status"] if since is None else f"at {since:.1f} s: {row['status']}"


def _print_flown(summary: dict, stopped_s: dict[str, float]) -> None:
    table = plain_table(f"{summary['scenario']['name']}: {summary['fleet']['simulated_s']:g} s flown")
    table.add_column("aircraft", overflow="fold")
    has_paths = any(row["path"] not in (None, "nominal") for row in summary["aircraft"])
    if has_paths:
        table.add_column("path", no_wrap=True)
    for name in ("planned\ns", "arrival\ns", "miss\nm", "airspeed\nm/s", "clear\nm"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("status", overflow="fold", min_width=7)
    for row in summary["aircraft"]:
        speeds = "/".join(number(row[f"speed_{k}_m_s"], 0) for k in ("min", "mean", "max"))
        left = f" (left the tables for {row['tables_left_s']:.1f} s)" if row["tables_left"] else ""
        table.add_row(
            row["name"],
            *([row["path"]] if has_paths else []),
            number(row["planned_arrival_s"], 2),
            number(row["arrival_s"], 2),
            number(row["miss_m"], 2),
            speeds,
            number(row["clearance_min_m"], 0),
            _status_text(row, stopped_s) + left,
        )
    print_table(table)
    fleet = summary["fleet"]
    line(
        f"arrival spread {number(fleet['arrival_spread_s'], 4)} s, least separation "
        f"{number(fleet['separation_min_m'], 0)} m, {fleet['wall_s']:.1f} s of computing"
    )
    if fleet.get("separation_ratio_min") is not None:
        line(f"at least {fleet['separation_ratio_min']:.2f} times the separation asked for, holds included")


def _fail_unmet(summary: dict, stopped_s: dict[str, float]) -> None:
    """Say which requirements were not met, and stop with exit code 1."""
    for row in summary["requirements"]:
        if not row["met"]:
            problem(f"not met: {row['name']}: limit {row['limit']:g}, flown {number(row['value'], 4)}")
    for row in summary["aircraft"]:
        if row["status"] != "arrived":
            problem(f'aircraft "{row["name"]}": {_status_text(row, stopped_s)}')
    raise typer.Exit(1)
