"""The time plots of a flight report: which variables stand together, which limits are drawn with them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import xarray as xr

from anser.report.flight_events import LIMITED
from anser.report.flown_beside_plan import DERIVED, limits_of_each
from anser.results import surfaces_of
from anser.variables import CATALOGUE


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
    within: bool = False
    compass: bool = False


def _surface_panel(surface: str) -> Panel:
    """Position and command of a control surface."""
    return Panel(f"{surface}_deg", f"{surface}_command_deg")


SURFACE = _surface_panel("*")
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
            SURFACE,
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
    *(f"{what}_limited" for what in LIMITED),
    "velocity_down_m_s",
)
_OPTIONAL = {variable.name for variable in CATALOGUE if variable.optional}


def _panels(section: Section, surfaces: Sequence[str]) -> list[Panel]:
    """Panels of a section for a flight with these control surfaces."""
    found = []
    for panel in section.panels:
        found += [_surface_panel(name) for name in surfaces] if panel is SURFACE else [panel]
    return found


def _names(panel: Panel) -> list[str]:
    return [name for name in (panel.response, panel.command) if name is not None]


def _drawn(surfaces: Sequence[str]) -> list[str]:
    panels = [panel for section in SECTIONS for panel in _panels(section, surfaces)]
    return [name for panel in panels for name in _names(panel)]


def needed_variables(dataset: xr.Dataset) -> tuple[str, ...]:
    """Variables that a dataset must have for a report, those of its own control surfaces among them."""
    own = [name for name in _drawn(surfaces_of(dataset)) if name not in DERIVED and name not in _OPTIONAL]
    return tuple(dict.fromkeys((*_SCENE, *_EVENTS, *own)))


def packed_variables(dataset: xr.Dataset) -> tuple[str, ...]:
    """Variables of a dataset, derived ones included, that the page gets."""
    drawn = dict.fromkeys((*_SCENE, *_drawn(surfaces_of(dataset))))
    return tuple(name for name in drawn if name in dataset)


def sections_for(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Sections as the page gets them: only panels whose variable is there, limits of all aircraft as numbers.

    Parameters
    ----------
    dataset
        With the derived variables.
    """
    limits = limits_of_each(dataset)
    found = []
    for section in SECTIONS:
        panels = [
            {
                "response": panel.response,
                "command": panel.command if panel.command in dataset else None,
                "limits": list(dict.fromkeys(value for key in panel.limits for value in _limits(key, limits))),
                "within": panel.within,
                "compass": panel.compass,
            }
            for panel in _panels(section, surfaces_of(dataset))
            if panel.response in dataset
        ]
        # a section for what some flights have shows nothing that others stand with
        if all(panel is SURFACE or panel.response in dataset for panel in section.panels[:1]):
            found.append({"key": section.key, "title": section.title, "caption": section.caption, "panels": panels})
    return found


def _limits(key: str | float, limits: Sequence[Mapping[str, Any]]) -> list[float]:
    """Values of a limit among all aircraft."""
    if not isinstance(key, str):
        return [key]
    sign = -1.0 if key.startswith("-") else 1.0
    values = [row.get(key.removeprefix("-")) for row in limits]
    return [sign * float(value) for value in values if value is not None]
