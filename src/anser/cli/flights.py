"""Commands that fly or plan a scenario: run, demo, plan."""

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
    InputError,
    activity,
    columns,
    end_without_result,
    fail_if_any,
    number,
    print_document,
    print_line,
    print_note,
    print_problem,
    print_table,
    progress_bar,
)
from anser.cli.folders import Force, make_next_folder, note_if_written, open_output_folder
from anser.cli.overrides import Overrides, PlannerName, load_with_overrides
from anser.config.shipped_files import shipped_files
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
    unmet="flown, but a requirement is not met; or no plan exists",
)
def run(
    scenario: Annotated[
        Path | None, typer.Argument(help="Scenario file (TOML).", autocompletion=complete_scenario)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="New folder for flight.nc, summary.json, report.html; left out: runs/NAME, or runs/NAME-2, ... "
            "where that exists and --force is not given."
        ),
    ] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Folder that anser plan --out wrote: its plan is flown, none is made.")
    ] = None,
    campaign: Annotated[
        Path | None, typer.Option(help="Folder of a campaign: one of its flights is flown again.")
    ] = None,
    flight: Annotated[int | None, typer.Option(help="Which flight of the campaign.")] = None,
    set_: Overrides = None,
    planner: PlannerName = None,
    force: Force = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the report in the browser at the end.")] = False,
) -> None:
    """Fly a scenario, write the results into a new folder and print a table."""
    store = None
    if campaign is not None or flight is not None:
        if campaign is None or flight is None or scenario is not None:
            raise InputError("run: expected either a scenario file, or both --campaign FOLDER and --flight NUMBER")
        if set_ or planner is not None:
            raise InputError("run: arrived --set or --planner with --campaign, whose flight is flown as it was")
        store, scenario_to_fly = campaign_flight(campaign, flight)
    elif scenario is None:
        raise InputError("run: arrived no scenario; expected a scenario file, or --campaign and --flight")
    else:
        scenario_to_fly = load_with_overrides(scenario, set_ or (), planner)
    if plan is not None and not (plan / PLAN).is_file():
        description = f"a folder without {PLAN}" if plan.is_dir() else "no folder"
        raise InputError(f"--plan: arrived {plan}, {description}; expected a folder that anser plan --out wrote")
    default_folder = Path("runs") / scenario_to_fly.name
    from anser.missions.first_plan import NoPlanError, PlanFileError
    from anser.missions.runs import run as fly  # late import: errors in the file come first

    target = out if out is not None else default_folder if force else make_next_folder(default_folder)
    try:
        with open_output_folder(target, force or out is None) as into, progress_bar() as tell:
            planned = None if plan is None else _finished_plan(plan, scenario_to_fly)
            flown = fly(scenario_to_fly, tell, planned, "float64" if store is None else store.study.precision)
            tell("writing", None)
            flown.write_into(into)
    except NoPlanError as error:
        end_without_result("no plan", error.reasons, "no plan: ")
    except PlanFileError as error:
        raise InputError(f"--plan: {error}") from None
    print_document(lambda: flown.summary)
    stopped_s = _stopped_s(flown.dataset)
    _print_flight(flown.summary, stopped_s, flown.dataset.attrs)
    for note in flown.planned.notes():
        print_note(f"note: {note}")
    print_note(f"{target}: flight.nc, summary.json, report.html written")
    if open_:
        _open_in_browser(target / "report.html")
    else:
        print_note(f"to see the flight, open {target / 'report.html'} in a browser (or add --open to the command)")
    if store is not None and flight is not None:
        report_replay(store, flight, flown)
    if not flown.met:
        for problem in flown.planned.problems():
            print_problem(f"planned beyond the limits: {problem}")
        _fail_unmet(flown.summary, stopped_s)


@help_epilog("anser demo", "anser demo --open", unmet="flown, but a requirement is not met")
def demo(
    out: Annotated[Path | None, typer.Option(help="New folder for the results; left out: runs/three-aircraft.")] = None,
    force: Force = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the report in the browser at the end.")] = False,
) -> None:
    """Fly the published case, three aircraft to three moving points, from anywhere: no file is needed.

    For a copy of its scenario: anser new mine.toml --from three-aircraft
    """
    run(shipped_files()["three-aircraft"], out=out, force=force, open_=open_)


def _open_in_browser(page: Path) -> None:
    if not webbrowser.open(page.resolve().as_uri()):
        print_note(f"no browser could be opened: open {page}")


def _finished_plan(folder: Path, scenario: Scenario) -> "FirstPlan":
    from anser.missions.plans import read_plan

    return read_plan(folder / PLAN, scenario)


def _stopped_s(dataset: "xr.Dataset") -> dict[str, float]:
    """Return the time, s, at which an aircraft's status first changed from 0 (flying), by name of the aircraft."""
    stop_times = {}
    for name, codes in zip(dataset["aircraft"].values, dataset["status"].values.T, strict=True):
        stopped_rows = codes.nonzero()[0]
        if stopped_rows.size and stopped_rows[0] > 0:
            stop_times[str(name)] = float(dataset["time"].values[stopped_rows[0]])
    return stop_times


def _status_text(aircraft: dict, stopped_s: dict[str, float]) -> str:
    """Return the status in an aircraft's summary entry, preceded by "at 12.0 s: " if `stopped_s` has its time."""
    stop_time = stopped_s.get(aircraft["name"])
    return aircraft["status"] if stop_time is None else f"at {stop_time:.1f} s: {aircraft['status']}"


def _print_flight(summary: dict, stopped_s: dict[str, float], attributes: Mapping[Any, Any]) -> None:
    # late import: errors in the file come first
    from anser.results.faults import fault_lines
    from anser.results.separation import NO_SEPARATION, is_judged_by_separation, proximity_warning
    from anser.results.summary_format import format_fleet

    has_paths = any(aircraft["path"] not in (None, "nominal") for aircraft in summary["aircraft"])
    headings = [
        *columns("aircraft", overflow="fold"),
        *columns(*(["path"] if has_paths else []), no_wrap=True),
        *columns("planned\ns", "arrival\ns", "miss\nm", justify="right", no_wrap=True, digits=2),
        *columns("airspeed\nm/s", "clear\nm", justify="right", no_wrap=True),
        *columns("status", overflow="fold", min_width=7),
    ]
    rows = []
    for aircraft in summary["aircraft"]:
        speeds = "/".join(number(aircraft[f"speed_{k}_m_s"], 0) for k in ("min", "mean", "max"))
        tables_note = f" (left the tables for {aircraft['tables_left_s']:.1f} s)" if aircraft["tables_left"] else ""
        texts = [aircraft["name"], *([aircraft["path"]] if has_paths else [])]
        times = [aircraft[key] for key in ("planned_arrival_s", "arrival_s", "miss_m")]
        status = _status_text(aircraft, stopped_s) + tables_note
        rows.append([*texts, *times, speeds, aircraft["clearance_min_m"], status])
    print_table(f"{summary['scenario']['name']}: {summary['fleet']['simulated_s']:g} s flown", headings, rows)
    fleet = summary["fleet"]
    print_line(", ".join([*format_fleet(summary), f"{fleet['wall_s']:.1f} s of computing"]))
    if fleet.get("separation_ratio_min") is not None:
        print_line(f"at least {fleet['separation_ratio_min']:.2f} times the separation asked for, holds included")
    if not is_judged_by_separation(summary):
        print_line(NO_SEPARATION)
    warning = proximity_warning([fleet["separation_min_m"]], attributes)
    if warning:
        print_note(f"warning: {warning}")
    for line in fault_lines(summary):
        print_line(line)
    if "network" in summary:
        print_line(f"without a centre: {summary['network']['message']}")


def _fail_unmet(summary: dict, stopped_s: dict[str, float]) -> None:
    """Print each unmet requirement and, with the time in `stopped_s`, each failed aircraft; always exit with code 1."""
    from anser.results.arrival import AS_PLANNED  # late import: errors in the file come first

    for item in summary["requirements"]:
        if not item["met"]:
            print_problem(f"not met: {item['name']}: limit {item['limit']:g}, flown {number(item['value'], 4)}")
    for item in summary["aircraft"]:
        if item["status"] not in AS_PLANNED:
            print_problem(f'aircraft "{item["name"]}": {_status_text(item, stopped_s)}')
    raise typer.Exit(1)


_UNITS = {"m": ("m", 0), "m s-1": ("m/s", 1), "m s-2": ("m/s^2", 2), "degree": ("deg", 1), "1": ("", 2)}
"""Unit as printed and number of decimals, by unit in the dataset."""
_SAME_TIME_S = 5e-3


@help_epilog(
    "anser plan scenarios/three-aircraft.toml",
    "anser plan scenarios/twenty-aircraft.toml --out plans/twenty",
    "anser plan scenarios/three-aircraft.toml --planner certified --open",
    unmet="no plan, or a plan beyond a limit",
)
def plan(
    scenario: ScenarioPath,
    out: Annotated[
        Path | None, typer.Option(help="New folder for plan.json, trajectories.csv, plan.png, plan.svg, plan.npz.")
    ] = None,
    set_: Overrides = None,
    planner: PlannerName = None,
    force: Force = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the picture in the browser at the end.")] = False,
) -> None:
    """Plan a scenario without flying it: arrival times, paths, and margins to the limits."""
    scenario_to_plan = load_with_overrides(scenario, set_ or (), planner)
    with (
        contextlib.nullcontext() if out is None else open_output_folder(out, force) as into,
        activity("planning") as tell,
    ):
        from anser.missions.plans import plan as make_plan  # late import: errors in the file come first
        from anser.missions.plans import write_plan

        planned = make_plan(scenario_to_plan, tell)
        if planned.refusals:
            end_without_result("no plan", planned.refusals, "no plan: ")
        recorded = planned.record()
        if into is not None:
            recorded.write_into(into)
            write_plan(planned, into / PLAN)
    print_document(lambda: recorded.summary)
    _print_paths(recorded.summary)
    _print_margins(recorded.summary)
    for text in _separation_lines(recorded.summary):
        print_line(text)
    note_if_written(out, "plan.json, trajectories.csv, plan.png, plan.svg, plan.npz")
    if open_:
        _open_in_browser(_picture_folder(recorded, out) / "plan.svg")
    for note in recorded.summary["notes"]:
        print_note(f"note: {note}")
    fail_if_any(f"not flyable: {problem}" for problem in recorded.summary["problems"])


def _picture_folder(recorded: "RecordedPlan", out: Path | None) -> Path:
    if out is not None:
        return out
    folder = Path(tempfile.mkdtemp(prefix="anser-"))
    recorded.write_into(folder)
    return folder


def _print_paths(summary: dict[str, Any]) -> None:
    from anser.results.arrival import format_planned_arrivals

    arrival = summary["arrival"]
    common = arrival["last_s"] - arrival["first_s"] < _SAME_TIME_S
    arrival_text = format_planned_arrivals(len(summary["aircraft"]), arrival["first_s"], arrival["last_s"])
    path_cells = [_path_row(aircraft, common) for aircraft in summary["aircraft"]]
    print_table(
        f"{summary['scenario']['name']}: {arrival_text}",
        [*columns("aircraft", "path", no_wrap=True), *columns(*path_cells[0], justify="right", no_wrap=True)],
        [(a["name"], a["path"], *cells.values()) for a, cells in zip(summary["aircraft"], path_cells, strict=True)],
    )


def _path_row(aircraft: dict[str, Any], arrive_together: bool) -> dict[str, str]:
    """Return the table cells of one path by column heading; the arrival time is left out if `arrive_together`."""
    planned = {limit["name"]: limit["planned"] for limit in aircraft["limits"]}
    cells = {} if arrive_together else {"arrival\ns": number(aircraft["arrival_s"], 2)}
    if "nominal_length_m" in aircraft:
        cells["nominal\nm"] = number(aircraft["nominal_length_m"], 1)
    cells["planned\nm"] = number(aircraft["length_m"], 1)
    cells["mean\nm/s"] = number(aircraft["speed_mean_m_s"], 1)
    cells["airspeed\nm/s"] = f"{number(aircraft['speed_min_m_s'], 0)} to {number(aircraft['speed_max_m_s'], 0)}"
    if "turn_use" in aircraft:
        cells["turn, of\nlimit"] = f"{number(100.0 * aircraft['turn_use'], 0)} %"
    cells["bank\ndeg"] = number(planned.get("bank_max_deg"), 0)
    cells["climb\nm/s"] = number(planned.get("climb_rate_max_m_s"), 1)
    cells["lowest\nm"] = number(planned.get("altitude_min_m"), 0)
    return cells


def _print_margins(summary: dict[str, Any]) -> None:
    from anser.planning.limits import LIMITS

    method = "proven at every instant" if summary["bounds"] == "proven" else "at samples"
    limit_names = {entry["name"] for aircraft in summary["aircraft"] for entry in aircraft["limits"]}
    shown = [limit for limit in LIMITS if limit.name in limit_names]
    headings = columns("aircraft", no_wrap=True)
    for limit in shown:
        first_word, _, other_words = (limit.heading or limit.description).partition(" ")
        unit, digits = _UNITS[limit.unit]
        headings += columns(f"{first_word}\n{other_words}\n{unit}", justify="right", no_wrap=True, digits=digits)
    rows = []
    for aircraft in summary["aircraft"]:
        margins = {entry["name"]: entry["margin"] for entry in aircraft["limits"]}
        cells = []
        for limit in shown:
            margin = margins.get(limit.name)
            is_exceeded = margin is not None and margin < 0.0
            cells.append(Text(number(margin, _UNITS[limit.unit][1]), "bold red") if is_exceeded else margin)
        rows.append([aircraft["name"], *cells])
    print_table(f"left to the limits, {method} (negative: passed)", headings, rows)


def _separation_lines(summary: dict[str, Any]) -> list[str]:
    lines = []
    separation, closest = summary["separation"], summary["least_distance"]
    if separation is not None and separation["pair"] is not None:
        required_text = f"{separation['horizontal_asked_m']:g} m"
        if separation["vertical_asked_m"]:
            required_text += f", or {separation['vertical_asked_m']:g} m in altitude"
        lines.append(
            f"closest by the separation ({required_text}): {' and '.join(separation['pair'])} "
            f"at {separation['time_s']:.2f} s, {separation['horizontal_m']:.0f} m in the plane and "
            f"{separation['vertical_m']:.0f} m in altitude"
        )
    if separation is not None and separation.get("hold_bound_ratio") is not None:
        lines.append(
            f"holds: at least {separation['hold_bound_ratio']:.2f} times the separation, until the flight ends"
        )
    if closest["pair"] is not None:
        required = "" if closest["required_m"] is None else f" ({closest['required_m']:g} m required)"
        lines.append(
            f"least separation {closest['value_m']:.0f} m in space{required}: {' and '.join(closest['pair'])} "
            f"at {closest['time_s']:.2f} s"
        )
    lines += [
        f"keep-out {keep_out['name']}: nearest is {keep_out['aircraft']}, {keep_out['room_m']:.0f} m outside "
        f"at {keep_out['time_s']:.2f} s"
        for keep_out in summary["keep_outs"]
    ]
    return lines
