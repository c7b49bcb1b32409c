"""Content of the report page of a flight as plain data for JSON, with the variables over time compressed."""

import base64
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import (
    DERIVED_VARIABLES,
    LIMITED_COMMANDS,
    REPLANNING_OUTCOMES,
    aircraft_limits,
    find_events,
    limit_value,
)
from anser.report.estimates import EFFECTIVENESS, STATIC_DERIVATIVES
from anser.report.labels import html_label
from anser.report.page_templates import render
from anser.results.dataset import surface_names
from anser.results.flight_rows import goals_over_time
from anser.variables import CATALOGUE

if TYPE_CHECKING:
    from markupsafe import Markup


_STEP_BY_UNIT = {"m": 0.01, "s": 1e-4, "N": 1.0, "Pa": 1.0, "1": 1e-5}  # resolution by unit
_DEFAULT_STEP = 1e-3
_SPREAD_MIN = 1e-6  # a smaller spread is rounding error
_STEPS_MAX = 2**29  # second differences are four times as large and must fit 32 bits with their sign


def quantization_step(values: np.ndarray, unit: str) -> float:
    """Return the step, in the unit `unit`, to which values are rounded on the page.

    Each unit has a default step. Values of small spread get a finer step, at most 1e-5 times the spread; values too
    large for 32 bits get a coarser step.
    """
    finite = values[np.isfinite(values)]
    step = _STEP_BY_UNIT.get(unit, _DEFAULT_STEP)
    if not finite.size:
        return step
    spread = float(np.ptp(finite))
    if spread > _SPREAD_MIN:
        step = min(step, 10.0 ** (np.floor(np.log10(spread)) - 5.0))
    while np.abs(finite).max() / step >= _STEPS_MAX:
        step *= 10.0
    return float(step)


def pack(columns: Sequence[tuple[np.ndarray, float]]) -> tuple[str, list[list[list[int]]]]:
    """Compress arrays (time, aircraft), each with a quantization step, into text that `assets/store.js` decodes.

    Values are rounded to multiples of the step, differenced twice in time, split into bytes by significance, deflated
    and encoded in base64. Also returns the gaps of each array, which are runs of non-finite values: [aircraft, first
    index, last index]. In a gap the text repeats the preceding value, or 0 at the start.
    """
    planes, gaps = [], []
    for values, step in columns:
        missing = ~np.isfinite(values)
        gaps.append(_runs_of_true(missing))
        quantized = np.round(_fill_gaps(values, missing) / step).astype(np.int64)
        second_differences = np.diff(quantized, n=2, axis=0, prepend=np.zeros((2, quantized.shape[1]), dtype=np.int64))
        zigzag = ((second_differences << 1) ^ (second_differences >> 63)).astype("<u4")
        planes.append(np.ascontiguousarray(zigzag.T).view(np.uint8).reshape(-1, 4).T.tobytes())
    return base64.b64encode(zlib.compress(b"".join(planes), 7)).decode("ascii"), gaps


def _fill_gaps(values: np.ndarray, missing: np.ndarray) -> np.ndarray:
    if not missing.any():
        return values
    source_index = np.where(missing, 0, np.arange(values.shape[0])[:, None])
    source_index = np.maximum.accumulate(source_index, axis=0)
    return np.nan_to_num(np.take_along_axis(values, source_index, axis=0), nan=0.0, posinf=0.0, neginf=0.0)


def _runs_of_true(flags: np.ndarray) -> list[list[int]]:
    runs = []
    for column in np.flatnonzero(flags.any(axis=0)):
        edges = np.diff(flags[:, column].astype(np.int8), prepend=0, append=0)
        starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        runs += [[int(column), int(start), int(stop)] for start, stop in zip(starts, stops, strict=True)]
    return runs


_ADRIFT_SPEED_MAX_M_S = 1.0  # below a ship's steerage way; a buoy drifts with the current
_WIND_SPEED_MAX_M_S = 30.0  # a gale; below an aircraft's stalling speed
_ICON_PATHS = {
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
"""Description of each symbol of a goal in the animated scene, for the legend, by name of the symbol."""


def goal_forms(dataset: xr.Dataset, scenario: Mapping[str, Any]) -> list[str]:
    """Return the symbol of each aircraft's goal, a key of `GOAL_FORM_TEXTS`, from the goal's kind and speed."""
    kinds = {str(goal["name"]): str(goal.get("kind", "")) for goal in scenario.get("goal") or []}
    goal_of = {str(table["name"]): str(table.get("goal", "")) for table in scenario.get("aircraft") or []}
    time = dataset["time"].values
    return [
        _form(kinds.get(goal_of.get(str(name), ""), ""), _speed_m_s(dataset.isel(aircraft=k), time))
        for k, name in enumerate(dataset["aircraft"].values)
    ]


def goal_form_legend(forms: Collection[str]) -> "Markup":
    """Return the legend of the goal symbols in `forms`, keys of `GOAL_FORM_TEXTS`, as HTML."""
    entries = [(_ICON_PATHS[form], text) for form, text in GOAL_FORM_TEXTS.items() if form in forms]
    return render("goal_forms.html", forms=entries)


def _form(kind: str, speed_m_s: float) -> str:
    if kind == "surface":
        return "ship" if speed_m_s > _ADRIFT_SPEED_MAX_M_S else "buoy"
    if kind == "airborne":
        return "flying" if speed_m_s > _WIND_SPEED_MAX_M_S else "drifting"
    return "goal"


def _speed_m_s(aircraft: xr.Dataset, time: np.ndarray) -> float:
    """Return the median speed of an aircraft's goal, m/s; 0 if fewer than two positions are recorded."""
    position = np.stack([aircraft[f"goal_{axis}_m"].values for axis in ("north", "east", "altitude")])
    is_recorded = np.isfinite(position).all(axis=0)
    if is_recorded.sum() < 2:
        return 0.0
    return float(np.median(np.linalg.norm(np.diff(position[:, is_recorded]), axis=0) / np.diff(time[is_recorded])))


@dataclass(frozen=True)
class Panel:
    """A plot of one variable over time; left out if the dataset lacks the variable or the band."""

    response: str  # variable drawn as a solid line
    command: str | None = None  # variable of the command or plan, dashed
    limits: tuple[str | float, ...] = ()  # values, or keys of the aircraft's limits; "-" before a key negates the value
    includes_limits: bool = False  # True: the axis reaches to the limits
    compass: bool = False  # True: a direction, drawn without a jump at north, with labels from 0 to 360 degrees
    band: tuple[str, str] | None = None  # variables at the edges of a shaded band


def _estimate_panel(name: str, truth: str | None = None) -> Panel:
    return Panel(f"{name}_estimate", truth, band=(f"{name}_low", f"{name}_high"))


def _surface_panel(surface: str) -> Panel:
    return Panel(f"{surface}_deg", f"{surface}_command_deg")


SURFACE_PLACEHOLDER = _surface_panel("*")
"""Placeholder in a section, replaced by a panel for each control surface of the flight."""


@dataclass(frozen=True)
class Section:
    """A group of panels with a common heading, left out if the dataset lacks the variable of its first panel."""

    key: str  # identifier in the page
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
        "adaptation",
        "Estimates of the adaptive autopilot",
        "Solid: estimate; shaded: two standard deviations, cut where they lie far beyond; dashed: truth, as far as the "
        "scenario tells it.",
        (
            *(_estimate_panel(name, f"{name}_truth") for name in EFFECTIVENESS),
            *(_estimate_panel(name) for name in STATIC_DERIVATIVES),
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
        (SURFACE_PLACEHOLDER, Panel("throttle"), Panel("power_percent"), Panel("thrust_n", "thrust_command_n")),
    ),
)

_SCENE = (
    *(
        f"{prefix}{axis}_m"
        for prefix in ("", "reference_", "goal_", "rendezvous_")
        for axis in ("north", "east", "altitude")
    ),
    *(f"quaternion_{k}" for k in range(4)),
)
_EVENTS = (
    *("phase", "renewal", "status", "outside_tables", "arrival_time_s", "planned_length_m", "lateral_bend_m"),
    *(f"{command}_limited" for command in LIMITED_COMMANDS),
    "velocity_down_m_s",
)
_OPTIONAL = {variable.name for variable in CATALOGUE if variable.optional}


def _panels(section: Section, surfaces: Sequence[str]) -> list[Panel]:
    """Return the panels of a section, with a panel for each of `surfaces` in place of `SURFACE_PLACEHOLDER`."""
    panels = []
    for panel in section.panels:
        panels += [_surface_panel(name) for name in surfaces] if panel is SURFACE_PLACEHOLDER else [panel]
    return panels


def _plotted_variables(surfaces: Sequence[str]) -> list[str]:
    panels = [panel for section in SECTIONS for panel in _panels(section, surfaces)]
    return [
        name for panel in panels for name in (panel.response, panel.command, *(panel.band or ())) if name is not None
    ]


def needed_variables(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the variables that a flight's dataset must contain for a report."""
    names = (*_SCENE, *_EVENTS, *_plotted_variables(surface_names(dataset)))
    return tuple(name for name in dict.fromkeys(names) if name not in DERIVED_VARIABLES and name not in _OPTIONAL)


def packed_variables(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the variables, recorded or derived, whose values the page contains, in order."""
    names = dict.fromkeys((*_SCENE, *_plotted_variables(surface_names(dataset))))
    return tuple(name for name in names if name in dataset)


def page_sections(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the sections of the page as plain data; a panel has each different limit of the aircraft once."""
    limits = aircraft_limits(dataset)
    sections = []
    for section in SECTIONS:
        panels = [
            {
                "response": panel.response,
                "command": panel.command if panel.command in dataset else None,
                "limits": _panel_limits(panel, limits),
                "within": panel.includes_limits,
                "compass": panel.compass,
                "band": panel.band,
            }
            for panel in _panels(section, surface_names(dataset))
            if panel.response in dataset and (panel.band is None or panel.band[0] in dataset)
        ]
        # a section is left out if its first variable is missing
        if all(panel is SURFACE_PLACEHOLDER or panel.response in dataset for panel in section.panels[:1]):
            sections.append({"key": section.key, "title": section.title, "caption": section.caption, "panels": panels})
    return sections


def _panel_limits(panel: Panel, limits: Sequence[Mapping[str, Any]]) -> list[float]:
    values: dict[float, None] = {}
    for key in panel.limits:
        candidates = [limit_value(table, key) for table in limits] if isinstance(key, str) else [key]
        values |= dict.fromkeys(value for value in candidates if value is not None)
    return list(values)


_SAMPLES_MAX = 150_000  # total over the aircraft: 20 aircraft at 10 Hz for 750 s
_TIMES_MAX = 12_000
_SUMMARY_KEYS = ("scenario", "versions", "seed", "aircraft", "fleet", "requirements")
_FACT_KEYS = ("name", "goal", "planned_arrival_s", "arrival_s", "miss_m", "status")
_AIRCRAFT_KEYS = (
    *_FACT_KEYS,
    *("speed_min_m_s", "speed_mean_m_s", "speed_max_m_s", "clearance_min_m", "position_error_max_m", "tables_left_s"),
)


def check_flight(dataset: xr.Dataset, summary: Mapping[str, Any]) -> None:
    """Check that dataset and summary have the data for a report, and belong to the same flight.

    Raises ValueError if data is missing, or if aircraft or scenario hash differ.
    """
    missing = [name for name in needed_variables(dataset) if name not in dataset.data_vars]
    if missing:
        raise ValueError(f"the dataset lacks {', '.join(missing)}, which the report draws")
    lacking = [key for key in _SUMMARY_KEYS if key not in summary]
    fleet = [] if lacking else summary["aircraft"]
    lacking += [f"aircraft.{key}" for key in _AIRCRAFT_KEYS if any(key not in aircraft for aircraft in fleet)]
    if lacking:
        raise ValueError(f"the summary lacks {', '.join(lacking)}, which the report tells")
    flown = [str(name) for name in dataset["aircraft"].values]
    summarized = [aircraft["name"] for aircraft in summary["aircraft"]]
    if flown != summarized:
        raise ValueError(f"the dataset holds the aircraft {flown}, the summary {summarized}")
    dataset_hash, summary_hash = dataset.attrs.get("scenario_hash"), summary["scenario"]["hash"]
    if dataset_hash is not None and dataset_hash != summary_hash:
        raise ValueError(f"the dataset is of scenario {dataset_hash}, the summary {summary_hash}")


def flight_data(
    dataset: xr.Dataset, summary: Mapping[str, Any], scenario: Mapping[str, Any], label: str
) -> dict[str, Any]:
    """Return the data of one flight that the page draws, as plain data for JSON.

    `dataset` must contain the derived variables; `scenario` may be empty; `label` is the name of the flight on the
    page. A long record is reduced to every n-th sample and the last one; the key `every` has n.
    """
    times, aircraft_count = dataset.sizes["time"], dataset.sizes["aircraft"]
    stride = max(1, -(-times * aircraft_count // _SAMPLES_MAX), -(-times // _TIMES_MAX))
    samples = np.unique(np.append(np.arange(0, times, stride), times - 1))
    names = packed_variables(dataset)
    time = dataset["time"].values[samples][:, None]
    columns = [(time, quantization_step(time, "s"))]
    for name in names:
        values = np.asarray(dataset[name].values[samples], dtype=np.float64)
        columns.append((values, quantization_step(values, str(dataset[name].attrs["units"]))))
    packed, gaps = pack(columns)
    variables = {
        name: html_label(dataset[name]) | {"place": k, "step": columns[k][1], "gaps": gaps[k]}
        for k, name in enumerate(names, start=1)
    }
    return {
        "label": label,
        "times": int(samples.size),
        "every": stride,
        "timeStep": columns[0][1],
        "aircraft": [
            {key: aircraft[key] for key in _FACT_KEYS} | {"form": form, "goals": goals}
            for aircraft, form, goals in zip(
                summary["aircraft"], goal_forms(dataset, scenario), goals_over_time(summary, scenario), strict=True
            )
        ],
        "variables": variables,
        "packed": packed,
        "events": find_events(dataset),
        "eventWords": {"renewals": REPLANNING_OUTCOMES, "limited": list(LIMITED_COMMANDS.values())},
        "sections": page_sections(dataset),
        "keepOuts": scene_keep_outs(scenario),
    }


def scene_keep_outs(scenario: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the tables of a scenario's keep-outs, each with `from_s`: 0, or the time of the event that adds it, s."""
    standing = [(table, 0.0) for table in scenario.get("keep_out") or []]
    appearing = [(event["keep_out"], event["time_s"]) for event in scenario.get("event") or [] if event.get("keep_out")]
    return [{**table, "from_s": from_s} for table, from_s in [*standing, *appearing]]
