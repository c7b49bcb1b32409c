"""Time histories of a flight for print.

Variables with their commands and limits, estimated goal velocities, and distances to the rendezvous and to other
aircraft.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import aircraft_limits, required_separation
from anser.report.flight_sheet import FlightSheet
from anser.report.labels import (
    Limit,
    axis_label,
    axis_scale,
    draw_labelled_limit,
    draw_limits,
    find_line_end,
    format_owners,
    label_line_ends,
)
from anser.report.style import LineStyle
from anser.results.separation import nearest_aircraft_distance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MARKS = 8  # on a line over time
_MARGIN, _BEYOND = 0.05, 0.25  # of a panel: empty, and at most for commands beyond what was flown; parts of its height
_SPAN_MIN = {"m s-1": 2.0, "degree": 2.0, "m": 10.0, "s": 0.2, "1": 0.2}
"""Least height of a panel: what hardly moves must not look as if it did."""


@dataclass(frozen=True)
class Curve:
    """A variable, what was asked for, and its limits.

    Attributes
    ----------
    name
        Variable of the dataset.
    wanted
        Variable of what was planned or commanded; None for none.
    low, high
        Keys of its limits in `aircraft_limits`; of `low` a minus sign before it takes the opposite value.
    stops_of
        Name of a control surface whose stops are the limits.
    words
        Of the axis; None: those of the variable.
    """

    name: str
    reference: str | None = None
    low: str | None = None
    high: str | None = None
    stop_surface: str | None = None
    label: str | None = None


def draw_time_histories(sheet: FlightSheet, curves: Sequence[Curve], label: str, asked: str = "") -> "Figure":
    """Panels under one another; a curve that no aircraft has is left out.

    Parameters
    ----------
    sheet
        To draw on.
    curves
        One for each panel.
    words
        What is shown.
    asked
        What `wanted` is: "commanded".
    """
    there = [curve for curve in curves if np.isfinite(sheet.dataset[curve.name].values).any()]
    figure, panels = sheet.panels(len(there))
    told = [f"{sheet.reference_text}: {asked}"] if asked else []
    for axes, curve in zip(panels, there, strict=True):
        told += draw_curve(axes, sheet, curve)
    return sheet.finish(figure, panels, label, "; ".join(told))


def draw_curve(
    axes: "Axes", sheet: FlightSheet, curve: Curve, line_styles: Sequence[LineStyle] | None = None
) -> list[str]:
    """Draw one variable of all aircraft, or of some; returns words about limits that are too far to be shown."""
    values, time = sheet.dataset[curve.name], sheet.time
    line_styles = [
        line_style
        for line_style in line_styles or sheet.line_styles
        if np.isfinite(values.values[:, line_style.index]).any()
    ]
    factor, unit = axis_scale(values, _up_to_arrival(sheet, curve.name, line_styles))
    jump = 180.0 if values.attrs["units"] == "degree" else np.inf
    drawn, asked, ends = [], [], []
    for line_style in line_styles:
        until = slice(0, int(sheet.arrival_index[line_style.index]) + 1)
        x, y = insert_gaps(time[until], factor * sheet.until_arrival(curve.name, line_style), jump)
        every = marker_interval(x.size, line_style.index, sheet.count) if sheet.has_few_aircraft else None
        axes.plot(x, y, markevery=every, label=sheet.name(line_style.index), **sheet.line_properties(line_style))
        drawn.append(y)
        ends.append(find_line_end(x, y, sheet.label(line_style), line_style))
        if curve.reference is not None:
            x, y = insert_gaps(time[until], factor * sheet.until_arrival(curve.reference, line_style), jump)
            axes.plot(x, y, **sheet.reference_properties())
            asked.append(y)
    shown = _shown(drawn, asked, factor * _SPAN_MIN[str(values.attrs["units"])])
    room = _MARGIN * (shown[1] - shown[0])
    axes.set_ylim(shown[0] - room, shown[1] + room)
    far = draw_limits(axes, _limits(sheet, curve, line_styles, factor, unit), shown)
    axes.set_ylabel(axis_label(values, curve.label, unit, sheet.label_capacity(sheet.panel_height)))
    axes.set_xlim(float(time[0]), float(time[sheet.arrival_index.max()]))
    if sheet.has_line_names:
        label_line_ends(axes, ends, sheet.panel_height)
    beyond = ", ".join(limit.label for limit in sorted(far, key=lambda one: one.value))
    return [f"not shown: {str(values.attrs['long_name']).lower()}, {beyond}"] if far else []


def _shown(drawn: Sequence[np.ndarray], asked: Sequence[np.ndarray], least: float) -> tuple[float, float]:
    """What a panel shows: all that was flown, and what was asked for where it does not lie far beyond."""
    flown, wanted = np.concatenate(drawn), np.concatenate([*drawn, *asked])
    low, high = float(np.nanmin(flown)), float(np.nanmax(flown))
    size = max(high - low, least)
    reach = _BEYOND * size
    low, high = max(float(np.nanmin(wanted)), low - reach), min(float(np.nanmax(wanted)), high + reach)
    missing = max(least - (high - low), 0.0)
    return low - missing / 2, high + missing / 2


def _up_to_arrival(sheet: FlightSheet, name: str, line_styles: Sequence[LineStyle]) -> float:
    """Greatest size of a variable up to the arrivals."""
    return max(float(np.nanmax(np.abs(sheet.until_arrival(name, line_style)))) for line_style in line_styles)


def _limits(
    sheet: FlightSheet, curve: Curve, line_styles: Sequence[LineStyle], factor: float, unit: str
) -> list[Limit]:
    """Each value of a limit once, with those whose it is."""
    found: dict[tuple[float, bool], list[str]] = {}
    limits = aircraft_limits(sheet.dataset)
    for line_style in line_styles:
        own = limits[line_style.index]
        if curve.stop_surface is not None:
            ends = own.get("surfaces_deg", {}).get(curve.stop_surface, [None, None])
        else:
            ends = [_limit(own, key) for key in (curve.low, curve.high)]
        for value, is_upper in zip(ends, (False, True), strict=True):
            if value is not None:
                found.setdefault((factor * float(value), is_upper), []).append(sheet.label(line_style))
    what = "limit" if curve.stop_surface is None else "stop"
    result = []
    for (value, is_upper), names in found.items():
        number = f"{float(f'{value:.4g}'):,g}".replace("-", "\u2212")
        number += unit if unit == "°" else f" {unit}".rstrip()
        of = format_owners(names, len(line_styles))
        result.append(Limit(value, is_upper, f"{what} {number}" + (f" ({of})" if of else "")))
    return result


def _limit(limits: Mapping[str, Any], key: str | None) -> float | None:
    """Value of a limit by its key; a minus sign before it stands for the opposite value."""
    value = None if key is None else limits.get(key.removeprefix("-"))
    return None if key is None or value is None else -value if key.startswith("-") else value


def marker_interval(samples: int, index: int, count: int) -> tuple[int, int]:
    """Which samples of one line of some bear a mark: in turn, so that equal lines show all their marks."""
    step = max(samples // _MARKS, 1)
    return index * step // count, step


def insert_gaps(x: np.ndarray, y: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Put a gap wherever y jumps by more than `jump`, so that no line is drawn across a wrapped angle.

    Parameters
    ----------
    x, y
        Samples, shape (samples,).
    jump
        Greatest difference of neighbours that is still drawn, in the unit of y.
    """
    steps = np.abs(np.diff(y))
    at = np.flatnonzero(np.where(np.isfinite(steps), steps, 0.0) > jump) + 1
    return np.insert(x, at, x[at]), np.insert(y, at, np.nan)


_AXES = ("north", "east", "down")
GOAL_VELOCITIES = tuple(Curve(f"goal_estimate_velocity_{axis}_m_s", f"goal_velocity_{axis}_m_s") for axis in _AXES)
"""What the aircraft estimate, beside the truth."""
_FLAT_M_S = 0.02  # what changes no more is no curve
_STANDS_M_S = 0.05


def has_changing_goals(dataset: xr.Dataset) -> bool:
    """Whether the velocity of a goal, or what an aircraft takes it to be, changes before the arrival."""
    return any(_changing(FlightSheet.with_default_format(dataset), curve) for curve in GOAL_VELOCITIES)


def draw_goal_velocities(sheet: FlightSheet) -> "Figure":
    """Draw the components that change, and say of the others what they are."""
    shown = [(curve, line_styles) for curve in GOAL_VELOCITIES if (line_styles := _changing(sheet, curve))]
    figure, panels = sheet.panels(len(shown))
    told = [f"lines: recovered from the line of sight; {sheet.reference_text}: true"]
    for axes, (curve, line_styles) in zip(panels, shown, strict=True):
        draw_curve(axes, sheet, curve, line_styles)
    drawn = {line_style.index for _, line_styles in shown for line_style in line_styles}
    steady = dict.fromkeys(
        _words(sheet, line_style) for line_style in sheet.line_styles if line_style.index not in drawn
    )
    return sheet.finish(
        figure, panels, "velocities of the goals as the aircraft estimate them", "; ".join([*told, *steady])
    )


def _changing(sheet: FlightSheet, curve: Curve) -> list[LineStyle]:
    """Aircraft for whose goal a component changes."""
    names = [name for name in (curve.name, curve.reference) if name is not None]
    return [
        line_style
        for line_style in sheet.line_styles
        if any(float(np.ptp(sheet.until_arrival(name, line_style))) > _FLAT_M_S for name in names)
    ]


def _words(sheet: FlightSheet, line_style: LineStyle) -> str:
    north, east, down = (float(sheet.until_arrival(f"goal_velocity_{axis}_m_s", line_style)[-1]) for axis in _AXES)
    speed, goal = np.hypot(north, east), sheet.goal_name(line_style)
    if np.hypot(speed, down) < _STANDS_M_S:
        return f"{goal} stands"
    words = f"{goal} keeps {speed:.3g} m/s on course {np.degrees(np.arctan2(east, north)) % 360.0:.0f}°"
    return words if abs(down) < _STANDS_M_S else f"{words}, {abs(down):.2g} m/s {'down' if down > 0.0 else 'up'}"


_RANGE = "range_to_rendezvous_m"
_PLACE, _VELOCITY = ("north_m", "east_m", "altitude_m"), ("north_m_s", "east_m_s", "down_m_s")
_LEAST_SHOWN_M = 1e-3  # less than any of these flights is known to


def zero_effort_miss_m(dataset: xr.Dataset) -> np.ndarray:
    """Least distance to the rendezvous from each instant on, if aircraft and goal kept their velocities; m.

    This is the zero-effort miss with the time to go to the closest approach; where that is past, the present distance.
    At the arrival it is the miss of the summary.

    Parameters
    ----------
    dataset
        A flight, dimensions (time, aircraft).

    Returns
    -------
    np.ndarray
        Shape (time, aircraft).
    """
    away = np.stack([(dataset[f"rendezvous_{a}"] - dataset[a]).values for a in _PLACE], axis=-1)
    rates = [(dataset[f"goal_velocity_{a}"] - dataset[f"velocity_{a}"]).values for a in _VELOCITY]
    rate = np.stack([*rates[:2], -rates[2]], axis=-1)
    squared = np.sum(rate**2, axis=-1)
    to_go = np.divide(-np.sum(away * rate, axis=-1), squared, out=np.zeros_like(squared), where=squared > 0.0)
    return np.linalg.norm(away + np.maximum(to_go, 0.0)[..., np.newaxis] * rate, axis=-1)


def draw_miss(sheet: FlightSheet) -> "Figure":
    """Draw the zero-effort miss up to the arrivals, logarithmic, with the greatest that the scenario allows."""
    figure, (axes,) = sheet.panels(1)
    _lines(axes, sheet, np.maximum(zero_effort_miss_m(sheet.dataset), _LEAST_SHOWN_M), sheet.arrival_index)
    axes.set_ylabel("Zero-effort miss (m)")
    _logarithmic(axes, sheet, _required(sheet, "miss_max_m", is_upper=True))
    note = "least distance to the rendezvous if aircraft and goal kept their velocities from here on"
    return sheet.finish(figure, [axes], "predicted miss of the rendezvous", note)


def draw_ranges(sheet: FlightSheet) -> "Figure":
    """Draw the ranges to the rendezvous, linear above and logarithmic below."""
    figure, panels = sheet.panels(2)
    values = sheet.dataset[_RANGE]
    factor, unit = axis_scale(values, float(np.nanmax(values.values[: sheet.arrival_index.max() + 1])))
    _lines(panels[0], sheet, factor * values.values, sheet.arrival_index)
    panels[0].set_ylim(bottom=0.0)
    _lines(panels[1], sheet, np.maximum(values.values, _LEAST_SHOWN_M), sheet.arrival_index)
    letters = sheet.label_capacity(sheet.panel_height)
    panels[0].set_ylabel(axis_label(values, in_unit=unit, length=letters))
    panels[1].set_ylabel(axis_label(values, length=letters))
    _logarithmic(panels[1], sheet, None)
    _named(panels[0], sheet)
    return sheet.finish(figure, panels, "ranges to the rendezvous", "above linear, below logarithmic")


def draw_separation(sheet: FlightSheet) -> "Figure":
    """Draw the least distance of each aircraft to any other until the flight ends, and its ratio to that asked for."""
    asked = required_separation(sheet.scenario)
    places = np.stack([sheet.dataset[name].values for name in _PLACE], axis=-1)
    end = np.full(sheet.count, len(sheet.time) - 1)
    figure, panels = sheet.panels(1 if asked is None else 2)
    _lines(panels[0], sheet, nearest_aircraft_distance(places), end)
    panels[0].set_ylabel(_short(sheet, "Least distance to another (m)", "Distance (m)"))
    _logarithmic(panels[0], sheet, _required(sheet, "separation_min_m", is_upper=False))
    note = ""
    if asked is not None:
        _lines(panels[1], sheet, nearest_aircraft_distance(places, asked), end)
        panels[1].set_ylabel(_short(sheet, "Distance over separation", "Distance over\nseparation"))
        above = f", or {asked[1]:g} m in altitude" if asked[1] else " in the plane"
        _logarithmic(panels[1], sheet, Limit(1.0, False, "asked for"))
        note = f"separation asked for: {asked[0]:g} m{above}"
    return sheet.finish(figure, panels, "distances between the aircraft", note)


def _required(sheet: FlightSheet, key: str, *, is_upper: bool) -> Limit | None:
    """What a scenario requires of a distance; None where it requires nothing."""
    value = sheet.scenario.get("requirements", {}).get(key)
    return None if value is None else Limit(float(value), is_upper, f"required: {value:g} m")


def _short(sheet: FlightSheet, label: str, short: str) -> str:
    return label if len(label) <= sheet.label_capacity(sheet.panel_height) else short


def _lines(axes: "Axes", sheet: FlightSheet, values: np.ndarray, until: np.ndarray) -> None:
    """One line for each aircraft up to an index of its own."""
    for line_style in sheet.line_styles:
        upto = slice(0, int(until[line_style.index]) + 1)
        every = (
            marker_interval(int(until[line_style.index]) + 1, line_style.index, sheet.count)
            if sheet.has_few_aircraft
            else None
        )
        label = sheet.name(line_style.index)
        axes.plot(
            sheet.time[upto],
            values[upto, line_style.index],
            label=label,
            markevery=every,
            **sheet.line_properties(line_style),
        )
    axes.set_xlim(float(sheet.time[0]), float(sheet.time[until.max()]))


def _logarithmic(axes: "Axes", sheet: FlightSheet, limit: Limit | None) -> None:
    """Make the scale of a panel logarithmic, draw a limit with its words, and name the lines."""
    axes.set_yscale("log")
    if limit is not None:
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, 0.6 * limit.value), max(high, 1.5 * limit.value))
        draw_labelled_limit(axes, limit)
    _named(axes, sheet)


def _named(axes: "Axes", sheet: FlightSheet) -> None:
    if sheet.has_line_names:
        lines = zip(axes.lines, sheet.line_styles, strict=False)  # further lines are limits
        drawn = [(line_style, *(np.asarray(values) for values in line.get_data())) for line, line_style in lines]
        ends = [find_line_end(x, y, sheet.label(line_style), line_style) for line_style, x, y in drawn]
        label_line_ends(axes, ends, sheet.panel_height)
