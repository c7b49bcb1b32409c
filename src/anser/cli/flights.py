"""Commands that fly or plan a scenario: run, plan."""

import contextlib
import tempfile
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from anser.cli.app import help_epilog
from anser.cli.arguments import ScenarioPath, complete_scenario
from anser.cli.campaigns import campaign_flight, report_replay
from anser.cli.console import (
    RefusedError,
    activity,
    columns,
    end_without_result,
    number,
    plain_table,
    print_document,
    print_line,
    print_note,
    print_problem,
    print_table,
    progress_bar,
)
from anser.cli.folders import Force, make_next_folder, open_output_folder
from anser.cli.overrides import Overrides, PlannerName, load_with_overrides
from anser.missions.saved_flights import PLAN
from anser.scenario.schema import Scenario

if TYPE_CHECKING:
    import xarray as xr

    from anser.missions.first_plan import FirstPlan
    from anser.missions.plan_output import RecordedPlan


@help_epilog(
    "anser run scenarios/three-aircraft.toml",
    "anser run scenarios/storm-sampling.toml --out runs/storm",
    "anser run scenarios/three-aircraft.toml --set wind.speed_m_s=8 --set wind.from_deg=240 --open",
    "anser run scenarios/three-aircraft.toml --json --quiet > summary.json",
    "anser run scenarios/twenty-aircraft.toml --plan plans/twenty",
    "anser run --campaign runs/how-surely --flight 17",
    unmet="flown, but a requirement was not met; or there is no plan",
)
def run(
    scenario: Annotated[
        Path | None,
        typer.Argument(help="Scenario file (TOML).", show_default=False, autocompletion=complete_scenario),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="New folder for flight.nc, summary.json, report.html; left out: runs/NAME, or runs/NAME-2, ... "
            "where that exists and --force is not given.",
            show_default=False,
        ),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(help="Folder that anser plan --out wrote: its plan is flown, none is made.", show_default=False),
    ] = None,
    campaign: Annotated[
        Path | None,
        typer.Option(help="Folder of a campaign: one of its flights is flown again.", show_default=False),
    ] = None,
    flight: Annotated[int | None, typer.Option(help="Which flight of the campaign.", show_default=False)] = None,
    set_: Overrides = None,
    planner: PlannerName = None,
    force: Force = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the report in the browser at the end.")] = False,
) -> None:
    """Fly a scenario, write its results into a new folder and print a table."""
    store = None
    if campaign is not None or flight is not None:
        if campaign is None or flight is None or scenario is not None:
            raise RefusedError("run: expected either a scenario file, or both --campaign FOLDER and --flight NUMBER")
        if set_ or planner is not None:
            raise RefusedError("run: arrived --set or --planner with --campaign, whose flight is flown as it was")
        store, wanted = campaign_flight(campaign, flight)
    elif scenario is None:
        raise RefusedError("run: arrived no scenario; expected a scenario file, or --campaign and --flight")
    else:
        wanted = load_with_overrides(scenario, set_ or (), planner)
    if plan is not None and not (plan / PLAN).is_file():
        words = f"a folder without {PLAN}" if plan.is_dir() else "no folder"
        raise RefusedError(f"--plan: arrived {plan}, {words}; expected a folder that anser plan --out wrote")
    beside = Path("runs") / wanted.name
    from anser.missions.first_plan import NoPlanError, PlanFileError
    from anser.missions.runs import run as fly  # here: a misspelt key must not wait for plotting libraries

    target = out if out is not None else beside if force else make_next_folder(beside)
    try:
        with open_output_folder(target, force or out is None) as into, progress_bar() as tell:
            planned = None if plan is None else _finished_plan(plan, wanted)
            flown = fly(wanted, tell, planned, "float64" if store is None else store.study.precision)
            tell("writing", None)
            flown.write_into(into)
    except NoPlanError as error:
        end_without_result("no plan", error.reasons, "no plan: ")
    except PlanFileError as error:
        raise RefusedError(f"--plan: {error}") from None
    print_document(lambda: flown.summary)
    stopped_s = _stopped_s(flown.dataset)
    _print_flight(flown.summary, stopped_s, flown.dataset.attrs)
    for note in flown.planned.notes():
        print_note(f"note: {note}")
    print_note(f"{target}: flight.nc, summary.json, report.html written")
    if open_:
        _open_in_browser(target / "report.html")
    if store is not None and flight is not None:
        report_replay(store, flight, flown)
    if not flown.met:
        for beyond in flown.planned.problems():
            print_problem(f"planned beyond the limits: {beyond}")
        _fail_unmet(flown.summary, stopped_s)


def _open_in_browser(page: Path) -> None:
    """Open a file in the browser."""
    if not webbrowser.open(page.resolve().as_uri()):
        print_note(f"no browser could be opened: open {page}")


def _finished_plan(folder: Path, wanted: Scenario) -> "FirstPlan":
    from anser.missions.plans import read_plan

    return read_plan(folder / PLAN, wanted)


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


def _print_flight(summary: dict, stopped_s: dict[str, float], attributes: Mapping[Any, Any]) -> None:
    # here: a misspelt key must not wait for what reads results
    from anser.results.separation import NO_SEPARATION, is_judged_by_separation, proximity_warning
    from anser.results.summary_format import format_fleet

    has_paths = any(row["path"] not in (None, "nominal") for row in summary["aircraft"])
    figures = ("planned\ns", "arrival\ns", "miss\nm", "airspeed\nm/s", "clear\nm")
    table = plain_table(
        f"{summary['scenario']['name']}: {summary['fleet']['simulated_s']:g} s flown",
        *columns("aircraft", overflow="fold"),
        *columns(*(["path"] if has_paths else []), no_wrap=True),
        *columns(*figures, justify="right", no_wrap=True),
        *columns("status", overflow="fold", min_width=7),
    )
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
    print_line(", ".join([*format_fleet(summary), f"{fleet['wall_s']:.1f} s of computing"]))
    if fleet.get("separation_ratio_min") is not None:
        print_line(f"at least {fleet['separation_ratio_min']:.2f} times the separation asked for, holds included")
    if not is_judged_by_separation(summary):
        print_line(NO_SEPARATION)
    warning = proximity_warning([fleet["separation_min_m"]], attributes)
    if warning:
        print_note(f"warning: {warning}")
    if "network" in summary:
        print_line(f"without a centre: {summary['network']['message']}")


def _fail_unmet(summary: dict, stopped_s: dict[str, float]) -> None:
    """Say which requirements were not met, and stop with exit code 1."""
    for row in summary["requirements"]:
        if not row["met"]:
            print_problem(f"not met: {row['name']}: limit {row['limit']:g}, flown {number(row['value'], 4)}")
    for row in summary["aircraft"]:
        if row["status"] != "arrived":
            print_problem(f'aircraft "{row["name"]}": {_status_text(row, stopped_s)}')
    raise typer.Exit(1)


_UNITS = {"m": ("m", 0), "m s-1": ("m/s", 1), "m s-2": ("m/s^2", 2), "degree": ("deg", 1), "1": ("", 2)}
"""How a unit is printed, and with how many decimals."""
_SAME_TIME_S = 5e-3


@help_epilog(
    "anser plan scenarios/three-aircraft.toml",
    "anser plan scenarios/twenty-aircraft.toml --out plans/twenty",
    "anser plan scenarios/three-aircraft.toml --planner certified --open",
    unmet="no plan, or one beyond a limit",
)
def plan(
    scenario: ScenarioPath,
    out: Annotated[
        Path | None,
        typer.Option(
            help="New folder for plan.json, trajectories.csv, plan.png, plan.svg, plan.npz.", show_default=False
        ),
    ] = None,
    set_: Overrides = None,
    planner: PlannerName = None,
    force: Force = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the picture in the browser at the end.")] = False,
) -> None:
    """Plan a scenario without flying it: arrival times, each aircraft's path, what it leaves to the limits."""
    wanted = load_with_overrides(scenario, set_ or (), planner)
    with (
        contextlib.nullcontext() if out is None else open_output_folder(out, force) as into,
        activity("planning") as tell,
    ):
        from anser.missions.plan_output import record_plan
        from anser.missions.plans import plan as make  # here: a misspelt key must not wait for plotting libraries
        from anser.missions.plans import write_plan

        planned = make(wanted, tell)
        if planned.refusals:
            end_without_result("no plan", planned.refusals, "no plan: ")
        recorded = record_plan(planned)
        if into is not None:
            recorded.write_into(into)
            write_plan(planned, into / PLAN)
    print_document(lambda: recorded.summary)
    _print_paths(recorded.summary)
    _print_margins(recorded.summary)
    for text in _separation_lines(recorded.summary):
        print_line(text)
    if out is not None:
        print_note(f"{out}: plan.json, trajectories.csv, plan.png, plan.svg, plan.npz written")
    if open_:
        _open_in_browser(_picture_folder(recorded, out) / "plan.svg")
    for note in recorded.summary["notes"]:
        print_note(f"note: {note}")
    for found in recorded.summary["problems"]:
        print_problem(f"not flyable: {found}")
    if recorded.summary["problems"]:
        raise typer.Exit(1)


def _picture_folder(recorded: "RecordedPlan", out: Path | None) -> Path:
    """Folder with the picture of a plan: the output folder, or a temporary one."""
    if out is not None:
        return out
    folder = Path(tempfile.mkdtemp(prefix="anser-"))
    recorded.write_into(folder)
    return folder


def _print_paths(summary: dict[str, Any]) -> None:
    from anser.results.arrival import format_planned_arrivals

    arrival = summary["arrival"]
    common = arrival["last_s"] - arrival["first_s"] < _SAME_TIME_S
    when = format_planned_arrivals(len(summary["aircraft"]), arrival["first_s"], arrival["last_s"])
    rows = [_path_row(row, common) for row in summary["aircraft"]]
    table = plain_table(
        f"{summary['scenario']['name']}: {when}",
        *columns("aircraft", "path", no_wrap=True),
        *columns(*rows[0], justify="right", no_wrap=True),
    )
    for row, cells in zip(summary["aircraft"], rows, strict=True):
        table.add_row(row["name"], row["path"], *cells.values())
    print_table(table)


def _path_row(row: dict[str, Any], arrive_together: bool) -> dict[str, str]:
    """Cells of an aircraft by their headings; the same headings for all of a fleet."""
    found = {one["name"]: one["planned"] for one in row["limits"]}
    cells = {} if arrive_together else {"arrival\ns": number(row["arrival_s"], 2)}
    if "nominal_length_m" in row:
        cells["nominal\nm"] = number(row["nominal_length_m"], 1)
    cells["planned\nm"] = number(row["length_m"], 1)
    cells["mean\nm/s"] = number(row["speed_mean_m_s"], 1)
    cells["airspeed\nm/s"] = f"{number(row['speed_min_m_s'], 0)} to {number(row['speed_max_m_s'], 0)}"
    if "turn_use" in row:
        cells["turn, of\nlimit"] = f"{number(100.0 * row['turn_use'], 0)} %"
    cells["bank\ndeg"] = number(found.get("bank_max_deg"), 0)
    cells["climb\nm/s"] = number(found.get("climb_rate_max_m_s"), 1)
    cells["lowest\nm"] = number(found.get("altitude_min_m"), 0)
    return cells


def _print_margins(summary: dict[str, Any]) -> None:
    """What each path leaves to each limit; what is left of none is marked."""
    from anser.planning.limits import LIMITS

    how = "proven at every instant" if summary["bounds"] == "proven" else "at samples"
    table = plain_table(f"left to the limits, {how} (negative: passed)", *columns("aircraft", no_wrap=True))
    given = {one["name"] for row in summary["aircraft"] for one in row["limits"]}
    shown = [limit for limit in LIMITS if limit.name in given]
    for limit in shown:
        first, _, rest = (limit.heading or limit.description).partition(" ")
        table.add_column(f"{first}\n{rest}\n{_UNITS[limit.unit][0]}", justify="right", no_wrap=True)
    for row in summary["aircraft"]:
        margins = {one["name"]: one["margin"] for one in row["limits"]}
        cells: list[Text | str] = []
        for limit in shown:
            margin = margins.get(limit.name)
            text = number(margin, _UNITS[limit.unit][1])
            cells.append(Text(text, "bold red") if margin is not None and margin < 0.0 else text)
        table.add_row(row["name"], *cells)
    print_table(table)


def _separation_lines(summary: dict[str, Any]) -> list[str]:
    """Lines about the closest pairs and the keep-outs."""
    lines = []
    asked, least = summary["separation"], summary["least_distance"]
    if asked is not None and asked["pair"] is not None:
        words = f"{asked['horizontal_asked_m']:g} m"
        if asked["vertical_asked_m"]:
            words += f", or {asked['vertical_asked_m']:g} m in altitude"
        lines.append(
            f"closest by the separation ({words}): {' and '.join(asked['pair'])} at {asked['time_s']:.2f} s, "
            f"{asked['horizontal_m']:.0f} m in the plane and {asked['vertical_m']:.0f} m in altitude"
        )
    if asked is not None and asked.get("hold_bound_ratio") is not None:
        lines.append(f"holds: at least {asked['hold_bound_ratio']:.2f} times the separation, until the flight ends")
    if least["pair"] is not None:
        required = "" if least["required_m"] is None else f" ({least['required_m']:g} m required)"
        lines.append(
            f"least separation {least['value_m']:.0f} m in space{required}: {' and '.join(least['pair'])} "
            f"at {least['time_s']:.2f} s"
        )
    lines += [
        f"keep-out {one['name']}: nearest is {one['aircraft']}, {one['room_m']:.0f} m outside at {one['time_s']:.2f} s"
        for one in summary["keep_outs"]
    ]
    return lines
