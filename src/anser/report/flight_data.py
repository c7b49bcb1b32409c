"""Data of a flight for its page.

Panels and sections of time plots, symbols of goals, packed variables, events and facts of each aircraft, as plain
data.
"""

import html
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import (
    DERIVED_VARIABLES,
    LIMITED_COMMANDS,
    REPLANNING_OUTCOMES,
    aircraft_limits,
    find_events,
)
from anser.report.labels import html_label
from anser.report.packing import pack, quantization_step
from anser.results.dataset import surface_names
from anser.variables import CATALOGUE

_STILL_M_S = 1.0  # slower than a ship keeps steerage, as fast as a current sets a buoy adrift
_DRIFTING_M_S = 30.0  # slower than wings carry, as fast as a gale: what drifts with the air
_PATHS = {
    "ship": "M1 9H15L13 13H4ZM5 8V5H9V8ZM6 4V2H8V4Z",
    "buoy": "M3 11H13L11 14H5ZM5 10L7 4H9L11 10ZM6 3V1H10V3Z",
    "drifting": "M5 13a4 4 0 0 1 -1 -7.5a4.2 4.2 0 0 1 8 -0.5a3.8 3.8 0 0 1 0 8Z",
    "flying": "M15 8L2 13L5 8L2 3Z",
    "goal": "M8 2L14 8L8 14L2 8Z",
}
GOAL_FORM_TEXTS = {
    "ship": "goal under way on the surface (ship, boat)",
    "buoy": "goal at rest or adrift on the surface (buoy)",
    "drifting": "goal in the air, at rest or drifting (storm cell, balloon)",
    "flying": "goal in the air, faster than a gale (aircraft)",
    "goal": "goal",
}
"""Forms by their names, in words for a key."""


def goal_forms(dataset: xr.Dataset, scenario: Mapping[str, Any]) -> list[str]:
    """Form of the goal of each aircraft, a key of `WORDS`: "goal" where the scenario does not say where it is.

    Parameters
    ----------
    dataset
        The flight, with its goals as it holds them for each aircraft.
    scenario
        As the dataset carries it; may be empty.
    """
    kinds = {str(goal["name"]): str(goal.get("kind", "")) for goal in scenario.get("goal") or []}
    goal_of = {str(one["name"]): str(one.get("goal", "")) for one in scenario.get("aircraft") or []}
    time = dataset["time"].values
    return [
        _form(kinds.get(goal_of.get(str(name), ""), ""), _speed_m_s(dataset.isel(aircraft=k), time))
        for k, name in enumerate(dataset["aircraft"].values)
    ]


def goal_form_legend(forms: Collection[str]) -> str:
    """Entries of the scene's key for the forms that are drawn, HTML."""
    return "".join(
        f'<span><svg class="mark" viewBox="0 0 16 16" aria-hidden="true"><path d="{_PATHS[form]}"/></svg>'
        f"{html.escape(words)}</span>"
        for form, words in GOAL_FORM_TEXTS.items()
        if form in forms
    )


def _form(kind: str, speed_m_s: float) -> str:
    if kind == "surface":
        return "ship" if speed_m_s > _STILL_M_S else "buoy"
    if kind == "airborne":
        return "flying" if speed_m_s > _DRIFTING_M_S else "drifting"
    return "goal"


def _speed_m_s(one: xr.Dataset, time: np.ndarray) -> float:
    """Speed of a goal for most of the record; 0 where it has no two places."""
    place = np.stack([one[f"goal_{axis}_m"].values for axis in ("north", "east", "altitude")])
    known = np.isfinite(place).all(axis=0)
    if known.sum() < 2:
        return 0.0
    return float(np.median(np.linalg.norm(np.diff(place[:, known]), axis=0) / np.diff(time[known])))


@dataclass(frozen=True)
class Panel:
    """One plot over time.

    Attributes
    ----------
    response
        Variable that is drawn solid.
    command
        Variable that is drawn dashed, a command or a plan; None for none.
    limits
        Keys of the scenario's `limits` that are drawn as lines; a number is drawn as it is, and a key with a minus sign
        before it with the opposite sign.
    within
        Whether the axis reaches to the limits, however far from the data they are.
    compass
        Whether it is a direction over ground: the line goes on through north without a jump, and the numbers on its
        axis are those of a compass, 0 to 360 degrees. Wrapped it would jump at each turn through north; unwrapped
        numbers would grow with every circle of a hold and name no direction.
    """

    response: str
    command: str | None = None
    limits: tuple[str | float, ...] = ()
    includes_limits: bool = False
    compass: bool = False


def _surface_panel(surface: str) -> Panel:
    """Position and command of a control surface."""
    return Panel(f"{surface}_deg", f"{surface}_command_deg")


SURFACE_PLACEHOLDER = _surface_panel("*")
"""Stands for a panel of each of the flight's control surfaces."""


@dataclass(frozen=True)
class Section:
    """Plots that are looked at together."""

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...]


SECTIONS: tuple[Section, ...] = (
    Section(
        "plan",
        "Plan against flown",
        "Dashed: planned, up to the hold. Ticks below, a line where they are close together: the plan changed there.",
        (
            Panel("range_to_rendezvous_m"),
            Panel("altitude_m", "reference_altitude_m"),
            Panel("position_error_m"),
            Panel("along_error_m"),
            Panel("across_error_m"),
            Panel("height_error_m"),
        ),
    ),
    Section(
        "limits",
        "Room to the limits",
        "Red lines: limits of the scenario.",
        (
            Panel("airspeed_m_s", None, ("speed_min_m_s", "speed_max_m_s"), True),
            Panel("bank_deg", None, ("-bank_max_deg", "bank_max_deg"), True),
            Panel("load_factor", None, ("load_factor_min", "load_factor_max"), True),
            Panel("alpha_deg", None, ("alpha_min_deg", "alpha_max_deg"), True),
            Panel("climb_rate_m_s", None, ("-climb_rate_max_m_s", "climb_rate_max_m_s"), True),
            Panel("height_over_floor_m", None, (0.0,), True),
            Panel("distance_min_m"),
            Panel("separation_kept", None, (1.0,), True),
            Panel("clearance_m"),
        ),
    ),
    Section(
        "responses",
        "Commands and responses",
        "Solid: response; dashed: command, cut where it lies far beyond. Red at the roll rate: command limit, how fast "
        "the bank that is commanded may change, where the scenario limits it. Course as on a compass, 0 to 360°, going "
        "on through north.",
        (
            Panel("airspeed_m_s", "airspeed_command_m_s"),
            Panel("path_angle_deg", "path_angle_command_deg"),
            Panel("course_deg", "course_command_deg", compass=True),
            Panel("bank_deg", "bank_command_deg"),
            Panel("alpha_deg", "alpha_command_deg"),
            Panel("beta_deg", "beta_command_deg"),
            Panel("roll_rate_deg_s", "roll_rate_command_deg_s", ("-roll_rate_max_deg_s", "roll_rate_max_deg_s")),
            Panel("pitch_rate_deg_s", "pitch_rate_command_deg_s"),
            Panel("yaw_rate_deg_s", "yaw_rate_command_deg_s"),
        ),
    ),
    Section(
        "knowledge",
        "Truth and estimate",
        "Solid: error; dashed: two standard deviations, as the filter has them.",
        (
            Panel("goal_error_m", "goal_band_m"),
            Panel("own_error_m", "own_band_m"),
            Panel("goal_nis", None, (1.0,), True),
        ),
    ),
    Section(
        "network",
        "Clocks along the paths",
        "Each aircraft flies its path by a clock of its own, which waits for those that are kept up.",
        (Panel("clock_lag_s"), Panel("clock_rate"), Panel("links_heard")),
    ),
    Section(
        "gusts",
        "Gusts",
        "Beyond the mean wind, in body axes.",
        (
            Panel("gust_u_m_s"),
            Panel("gust_v_m_s"),
            Panel("gust_w_m_s"),
            Panel("airspeed_m_s", "airspeed_mean_wind_m_s"),
        ),
    ),
    Section(
        "attitude",
        "Attitude",
        "From north, east, down to the body. Yaw as on a compass, 0 to 360°, going on through north.",
        (Panel("roll_deg"), Panel("pitch_deg"), Panel("yaw_deg", compass=True)),
    ),
    Section(
        "controls",
        "Surfaces and engine",
        "Solid: position; dashed: command, cut where it lies far beyond.",
        (
            SURFACE_PLACEHOLDER,
            Panel("throttle"),
            Panel("power_percent"),
            Panel("thrust_n", "thrust_command_n"),
        ),
    ),
)

_SCENE = (
    *(
        f"{place}{axis}_m"
        for place in ("", "reference_", "goal_", "rendezvous_")
        for axis in ("north", "east", "altitude")
    ),
    *(f"quaternion_{k}" for k in range(4)),
)
_EVENTS = (
    *("phase", "renewal", "status", "outside_tables", "arrival_time_s", "planned_length_m", "lateral_bend_m"),
    *(f"{what}_limited" for what in LIMITED_COMMANDS),
    "velocity_down_m_s",
)
_OPTIONAL = {variable.name for variable in CATALOGUE if variable.optional}


def _panels(section: Section, surfaces: Sequence[str]) -> list[Panel]:
    """Panels of a section for a flight with these control surfaces."""
    found = []
    for panel in section.panels:
        found += [_surface_panel(name) for name in surfaces] if panel is SURFACE_PLACEHOLDER else [panel]
    return found


def _names(panel: Panel) -> list[str]:
    return [name for name in (panel.response, panel.command) if name is not None]


def _drawn(surfaces: Sequence[str]) -> list[str]:
    panels = [panel for section in SECTIONS for panel in _panels(section, surfaces)]
    return [name for panel in panels for name in _names(panel)]


def needed_variables(dataset: xr.Dataset) -> tuple[str, ...]:
    """Variables that a dataset must have for a report, those of its own control surfaces among them."""
    own = [name for name in _drawn(surface_names(dataset)) if name not in DERIVED_VARIABLES and name not in _OPTIONAL]
    return tuple(dict.fromkeys((*_SCENE, *_EVENTS, *own)))


def packed_variables(dataset: xr.Dataset) -> tuple[str, ...]:
    """Variables of a dataset, derived ones included, that the page gets."""
    drawn = dict.fromkeys((*_SCENE, *_drawn(surface_names(dataset))))
    return tuple(name for name in drawn if name in dataset)


def page_sections(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Sections as the page gets them: only panels whose variable is there, limits of all aircraft as numbers.

    Parameters
    ----------
    dataset
        With the derived variables.
    """
    limits = aircraft_limits(dataset)
    found = []
    for section in SECTIONS:
        panels = [
            {
                "response": panel.response,
                "command": panel.command if panel.command in dataset else None,
                "limits": list(dict.fromkeys(value for key in panel.limits for value in _limits(key, limits))),
                "within": panel.includes_limits,
                "compass": panel.compass,
            }
            for panel in _panels(section, surface_names(dataset))
            if panel.response in dataset
        ]
        # a section for what some flights have shows nothing that others stand with
        if all(panel is SURFACE_PLACEHOLDER or panel.response in dataset for panel in section.panels[:1]):
            found.append({"key": section.key, "title": section.title, "caption": section.caption, "panels": panels})
    return found


def _limits(key: str | float, limits: Sequence[Mapping[str, Any]]) -> list[float]:
    """Values of a limit among all aircraft."""
    if not isinstance(key, str):
        return [key]
    sign = -1.0 if key.startswith("-") else 1.0
    values = [row.get(key.removeprefix("-")) for row in limits]
    return [sign * float(value) for value in values if value is not None]


_SAMPLES_MAX = 150_000  # of all aircraft together: 20 aircraft at 10 Hz for 750 s
_TIMES_MAX = 12_000
_SUMMARY_KEYS = ("scenario", "versions", "seed", "aircraft", "fleet", "requirements")
_FACT_KEYS = ("name", "goal", "planned_arrival_s", "arrival_s", "miss_m", "status")
_ROW_KEYS = (
    *_FACT_KEYS,
    *("speed_min_m_s", "speed_mean_m_s", "speed_max_m_s", "clearance_min_m", "position_error_max_m", "tables_left_s"),
)


def check_flight(dataset: xr.Dataset, summary: Mapping[str, Any]) -> None:
    """Refuse what cannot be reported.

    Raises
    ------
    ValueError
        The dataset lacks a variable, the summary a key, or dataset and summary are not of one flight.
    """
    missing = [name for name in needed_variables(dataset) if name not in dataset.data_vars]
    if missing:
        raise ValueError(f"the dataset lacks {', '.join(missing)}, which the report draws")
    lacking = [key for key in _SUMMARY_KEYS if key not in summary]
    rows = [] if lacking else summary["aircraft"]
    lacking += [f"aircraft.{key}" for key in _ROW_KEYS if any(key not in row for row in rows)]
    if lacking:
        raise ValueError(f"the summary lacks {', '.join(lacking)}, which the report tells")
    flown, summarized = [str(name) for name in dataset["aircraft"].values], [row["name"] for row in summary["aircraft"]]
    if flown != summarized:
        raise ValueError(f"the dataset holds the aircraft {flown}, the summary {summarized}")
    of_dataset, of_summary = dataset.attrs.get("scenario_hash"), summary["scenario"]["hash"]
    if of_dataset is not None and of_dataset != of_summary:
        raise ValueError(f"the dataset is of scenario {of_dataset}, the summary {of_summary}")


def flight_data(
    dataset: xr.Dataset, summary: Mapping[str, Any], scenario: Mapping[str, Any], label: str
) -> dict[str, Any]:
    """Collect what the page draws of one flight.

    Parameters
    ----------
    dataset
        The flight with its derived variables.
    summary
        As `summary.json` holds it.
    scenario
        As the dataset carries it; may be empty.
    label
        What the run is called on the page.

    Returns
    -------
    dict
        For JSON. Variables come packed, every `every`-th record of them.
    """
    every = max(
        1,
        -(-dataset.sizes["time"] * dataset.sizes["aircraft"] // _SAMPLES_MAX),
        -(-dataset.sizes["time"] // _TIMES_MAX),
    )
    kept = np.unique(np.append(np.arange(0, dataset.sizes["time"], every), dataset.sizes["time"] - 1))
    names = packed_variables(dataset)
    time = dataset["time"].values[kept][:, None]
    columns = [(time, quantization_step(time, "s"))]
    for name in names:
        values = np.asarray(dataset[name].values[kept], dtype=np.float64)
        columns.append((values, quantization_step(values, str(dataset[name].attrs["units"]))))
    packed, gaps = pack(columns)
    variables = {
        name: html_label(dataset[name]) | {"place": k, "step": columns[k][1], "gaps": gaps[k]}
        for k, name in enumerate(names, start=1)
    }
    return {
        "label": label,
        "times": int(kept.size),
        "every": every,
        "timeStep": columns[0][1],
        "aircraft": [
            {key: row[key] for key in _FACT_KEYS} | {"form": form, "before": before}
            for row, form, before in zip(
                summary["aircraft"], goal_forms(dataset, scenario), _goals_before(summary, scenario), strict=True
            )
        ],
        "variables": variables,
        "packed": packed,
        "events": find_events(dataset),
        "eventWords": {"renewals": REPLANNING_OUTCOMES, "limited": list(LIMITED_COMMANDS.values())},
        "sections": page_sections(dataset),
        "keepOuts": scenario.get("keep_out") or [],
    }


def _goals_before(summary: Mapping[str, Any], scenario: Mapping[str, Any]) -> list[list[Any] | None]:
    """Of each aircraft that took over another's goal: its own goal, and until when, s, it flew to that."""
    own = {str(one["name"]): str(one["goal"]) for one in scenario.get("aircraft") or [] if "goal" in one}
    events = [one for one in summary.get("events", ()) if one["kind"] == "goal-taken-over"]
    until = {str(one["whom"]): float(one["time_s"]) for one in events}
    names = [str(row["name"]) for row in summary["aircraft"]]
    return [[own[name], until[name]] if name in own and name in until else None for name in names]


def script_json(data: Any) -> str:
    """JSON that can stand within a script element: nothing in it ends the element or begins another."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
