"""The plan of a scenario, without flying it."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from anser.cli.arguments import ScenarioPath
from anser.cli.console import (
    answer,
    end_without,
    line,
    make_new,
    number,
    plain_table,
    print_table,
    problem,
    say,
    working,
)
from anser.cli.offering import about
from anser.cli.run_folder import PLAN
from anser.scenario import Scenario, cautions, load

if TYPE_CHECKING:
    from anser.campaign import Planned
    from anser.campaign.plan_output import RecordedPlan

_UNITS = {"m": ("m", 0), "m s-1": ("m/s", 1), "m s-2": ("m/s^2", 2), "degree": ("deg", 1), "1": ("", 2)}
"""How a unit is printed, and with how many decimals."""
_SAME_TIME_S = 5e-3


@about(
    "anser plan scenarios/three-aircraft.toml",
    "anser plan scenarios/twenty-aircraft.toml --out plans/twenty",
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
) -> None:
    """Plan a scenario without flying it: arrival times, each aircraft's path, what it leaves to the limits."""
    wanted = load(scenario)
    for caution in cautions(wanted):
        say(f"caution: {caution}")
    if out is not None:
        make_new(out)
    from anser.campaign import write_plan  # here: a misspelt key must not wait for plotting libraries

    try:
        with working("planning") as tell:
            planned, recorded = _recorded(wanted, tell)
            if out is not None:
                recorded.write_into(out)
                write_plan(planned, out / PLAN)
    finally:
        if out is not None:
            with contextlib.suppress(OSError):
                out.rmdir()  # succeeds only while it is empty: a plan that was refused leaves nothing behind
    answer(lambda: recorded.summary)
    _print(recorded)
    if out is not None:
        say(f"{out}: plan.json, trajectories.csv, plan.png, plan.svg, plan.npz written")
    for note in recorded.summary["notes"]:
        say(f"note: {note}")
    for found in recorded.summary["problems"]:
        problem(f"not flyable: {found}")
    if recorded.summary["problems"]:
        raise typer.Exit(1)


def _recorded(wanted: Scenario, on_progress: Callable[[str], None]) -> "tuple[Planned, RecordedPlan]":
    """Plan; where the planner refuses, say why and stop with exit code 1."""
    from anser.campaign import plan as make
    from anser.campaign.plan_output import record

    planned = make(wanted, on_progress)
    if planned.refusals:
        end_without("no plan", planned.refusals, "no plan: ")
    return planned, record(planned)


def _print(recorded: "RecordedPlan") -> None:
    summary = recorded.summary
    _print_paths(summary)
    _print_margins(summary)
    for text in _apart(summary):
        line(text)


def _print_paths(summary: dict[str, Any]) -> None:
    arrival = summary["arrival"]
    common = arrival["last_s"] - arrival["first_s"] < _SAME_TIME_S
    when = (
        f"all arrive at {arrival['last_s']:.2f} s"
        if common
        else f"arrivals from {arrival['first_s']:.2f} to {arrival['last_s']:.2f} s"
    )
    table = plain_table(f"{summary['scenario']['name']}: {when}")
    table.add_column("aircraft", no_wrap=True)
    table.add_column("path", no_wrap=True)
    rows = [_path_row(row) for row in summary["aircraft"]]
    for name in rows[0]:
        if not (common and name == _ARRIVAL):
            table.add_column(name, justify="right", no_wrap=True)
    for row, cells in zip(summary["aircraft"], rows, strict=True):
        shown = [text for name, text in cells.items() if not (common and name == _ARRIVAL)]
        table.add_row(row["name"], row["path"], *shown)
    print_table(table)


_ARRIVAL = "arrival\ns"


def _path_row(row: dict[str, Any]) -> dict[str, str]:
    """Cells of an aircraft by their headings; the same headings for all of a fleet."""
    found = {one["name"]: one["planned"] for one in row["limits"]}
    cells = {_ARRIVAL: number(row["arrival_s"], 2)}
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
    from anser.planning import LIMITS

    how = "proven at every instant" if summary["bounds"] == "proven" else "at samples"
    table = plain_table(f"left to the limits, {how} (negative: passed)")
    table.add_column("aircraft", no_wrap=True)
    given = {one["name"] for row in summary["aircraft"] for one in row["limits"]}
    shown = [limit for limit in LIMITS if limit.name in given]
    for limit in shown:
        first, _, rest = (limit.heading or limit.words).partition(" ")
        table.add_column(f"{first}\n{rest}\n{_UNITS[limit.unit][0]}", justify="right", no_wrap=True)
    for row in summary["aircraft"]:
        margins = {one["name"]: one["margin"] for one in row["limits"]}
        cells = []
        for limit in shown:
            margin = margins.get(limit.name)
            text = number(margin, _UNITS[limit.unit][1])
            cells.append(f"[bold red]{text}[/bold red]" if margin is not None and margin < 0.0 else text)
        table.add_row(row["name"], *cells)
    print_table(table)


def _apart(summary: dict[str, Any]) -> list[str]:
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
