"""Figures of a flight over time, for print.

Variables with commands and limits, estimated goal velocities, and distances to the rendezvous and between aircraft.
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


_MARKERS_PER_LINE = 8
_MARGIN, _COMMAND_EXCESS_MAX = 0.05, 0.25  # relative to the range of the panel
_SPAN_MIN = {"m s-1": 2.0, "degree": 2.0, "m": 10.0, "s": 0.2, "1": 0.2}
"""Least range of a panel's axis by unit, so that a nearly constant variable looks constant."""


@dataclass(frozen=True)
class Curve:
    """A variable to be drawn over time, with its command and limits.

    Attributes
    ----------
    name
        Variable of the dataset.
    reference
        Variable with the planned or commanded value; None without one.
    low, high
        Keys of the limits in `aircraft_limits`; a minus sign in front of `low` takes the opposite value.
    stop_surface
        Control surface whose stops are the limits.
    label
        Axis label; by default the variable's long name.
    """

    name: str
    reference: str | None = None
    low: str | None = None
    high: str | None = None
    stop_surface: str | None = None
    label: str | None = None


def draw_time_histories(sheet: FlightSheet, curves: Sequence[Curve], label: str, reference_name: str = "") -> "Figure":
    """Draw one panel for each curve, below one another; a curve without a finite value is left out.

    Parameters
    ----------
    label
        Title of the figure.
    reference_name
        Meaning of the reference variable, for example "commanded".
    """
    available = [curve for curve in curves if np.isfinite(sheet.dataset[curve.name].values).any()]
    figure, panels = sheet.panels(len(available))
    notes = [f"{sheet.reference_text}: {reference_name}"] if reference_name else []
    for axes, curve in zip(panels, available, strict=True):
        notes += draw_curve(axes, sheet, curve)
    return sheet.finish(figure, panels, label, "; ".join(notes))


def draw_curve(
    axes: "Axes", sheet: FlightSheet, curve: Curve, line_styles: Sequence[LineStyle] | None = None
) -> list[str]:
    """Draw one variable of the aircraft with the given line styles, by default of all aircraft.

    Returns
    -------
    A note on limits that lie outside the panel; empty without any.
    """
    values, time = sheet.dataset[curve.name], sheet.time
    line_styles = [
        line_style
        for line_style in line_styles or sheet.line_styles
        if np.isfinite(values.values[:, line_style.index]).any()
    ]
    factor, unit = axis_scale(values, _magnitude_until_arrival(sheet, curve.name, line_styles))
    jump_max = 180.0 if values.attrs["units"] == "degree" else np.inf
    response_lines, reference_lines, line_ends = [], [], []
    for line_style in line_styles:
        samples = slice(0, int(sheet.arrival_index[line_style.index]) + 1)
        x, y = insert_gaps(time[samples], factor * sheet.until_arrival(curve.name, line_style), jump_max)
        marker_spacing = marker_interval(x.size, line_style.index, sheet.count) if sheet.has_few_aircraft else None
        axes.plot(
            x, y, markevery=marker_spacing, label=sheet.name(line_style.index), **sheet.line_properties(line_style)
        )
        response_lines.append(y)
        line_ends.append(find_line_end(x, y, sheet.label(line_style), line_style))
        if curve.reference is not None:
            x, y = insert_gaps(time[samples], factor * sheet.until_arrival(curve.reference, line_style), jump_max)
            axes.plot(x, y, **sheet.reference_properties())
            reference_lines.append(y)
    visible = _visible_range(response_lines, reference_lines, factor * _SPAN_MIN[str(values.attrs["units"])])
    margin = _MARGIN * (visible[1] - visible[0])
    axes.set_ylim(visible[0] - margin, visible[1] + margin)
    hidden_limits = draw_limits(axes, _limits(sheet, curve, line_styles, factor, unit), visible)
    axes.set_ylabel(axis_label(values, curve.label, unit, sheet.label_capacity(sheet.panel_height)))
    axes.set_xlim(float(time[0]), float(time[sheet.arrival_index.max()]))
    if sheet.has_line_names:
        label_line_ends(axes, line_ends, sheet.panel_height)
    hidden_text = ", ".join(limit.label for limit in sorted(hidden_limits, key=lambda hidden: hidden.value))
    return [f"not shown: {str(values.attrs['long_name']).lower()}, {hidden_text}"] if hidden_limits else []


def _visible_range(
    response_lines: Sequence[np.ndarray], reference_lines: Sequence[np.ndarray], span_min: float
) -> tuple[float, float]:
    """Return the range of a panel's axis: all responses, and commands unless they exceed the responses by far.

    The range is at least `span_min`.
    """
    responses, values = np.concatenate(response_lines), np.concatenate([*response_lines, *reference_lines])
    low, high = float(np.nanmin(responses)), float(np.nanmax(responses))
    size = max(high - low, span_min)
    excess = _COMMAND_EXCESS_MAX * size
    low, high = max(float(np.nanmin(values)), low - excess), min(float(np.nanmax(values)), high + excess)
    missing = max(span_min - (high - low), 0.0)
    return low - missing / 2, high + missing / 2


def _magnitude_until_arrival(sheet: FlightSheet, name: str, line_styles: Sequence[LineStyle]) -> float:
    """Return the greatest magnitude of a variable up to the arrivals."""
    return max(float(np.nanmax(np.abs(sheet.until_arrival(name, line_style)))) for line_style in line_styles)


def _limits(
    sheet: FlightSheet, curve: Curve, line_styles: Sequence[LineStyle], factor: float, unit: str
) -> list[Limit]:
    """Return the distinct values of a curve's limits, each labelled with the aircraft concerned.

    `factor` and `unit` convert the values to the unit of the axis.
    """
    owners: dict[tuple[float, bool], list[str]] = {}
    limits = aircraft_limits(sheet.dataset)
    for line_style in line_styles:
        aircraft_table = limits[line_style.index]
        if curve.stop_surface is not None:
            bounds = aircraft_table.get("surfaces_deg", {}).get(curve.stop_surface, [None, None])
        else:
            bounds = [_limit(aircraft_table, key) for key in (curve.low, curve.high)]
        for value, is_upper in zip(bounds, (False, True), strict=True):
            if value is not None:
                owners.setdefault((factor * float(value), is_upper), []).append(sheet.label(line_style))
    noun = "limit" if curve.stop_surface is None else "stop"
    result = []
    for (value, is_upper), names in owners.items():
        number = f"{float(f'{value:.4g}'):,g}".replace("-", "\u2212")
        number += unit if unit == "°" else f" {unit}".rstrip()
        owner_text = format_owners(names, len(line_styles))
        result.append(Limit(value, is_upper, f"{noun} {number}" + (f" ({owner_text})" if owner_text else "")))
    return result


def _limit(limits: Mapping[str, Any], key: str | None) -> float | None:
    """Return a limit by key, None if missing; a minus sign in front of the key gives the opposite value."""
    value = None if key is None else limits.get(key.removeprefix("-"))
    return None if key is None or value is None else -value if key.startswith("-") else value


def marker_interval(samples: int, index: int, count: int) -> tuple[int, int]:
    """Return the first marked sample of a line and the interval between marked samples.

    The lines of a figure start at different samples, so that markers distinguish coincident lines.
    """
    step = max(samples // _MARKERS_PER_LINE, 1)
    return index * step // count, step


def insert_gaps(x: np.ndarray, y: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Insert a gap (NaN) at each jump of y by more than `jump`: no line is then drawn across a wrapped angle.

    Parameters
    ----------
    x, y
        Samples, shape (samples,).
    jump
        Greatest difference of neighbouring samples that is still drawn, in the unit of y.

    Returns
    -------
    The samples x and y with the gaps.
    """
    differences = np.abs(np.diff(y))
    indices = np.flatnonzero(np.where(np.isfinite(differences), differences, 0.0) > jump) + 1
    return np.insert(x, indices, x[indices]), np.insert(y, indices, np.nan)


_AXES = ("north", "east", "down")
GOAL_VELOCITIES = tuple(Curve(f"goal_estimate_velocity_{axis}_m_s", f"goal_velocity_{axis}_m_s") for axis in _AXES)
"""Estimated goal velocities, with the true ones as reference."""
_CHANGE_MIN_M_S = 0.02  # smaller changes are not drawn
_STANDSTILL_M_S = 0.05


def has_changing_goals(dataset: xr.Dataset) -> bool:
    """Whether the true or the estimated velocity of a goal changes before the arrival."""
    return any(_changing_goals(FlightSheet.with_default_format(dataset), curve) for curve in GOAL_VELOCITIES)


def draw_goal_velocities(sheet: FlightSheet) -> "Figure":
    """Draw the changing components of the goal velocities, and list the constant velocities in the note."""
    panel_curves = [(curve, line_styles) for curve in GOAL_VELOCITIES if (line_styles := _changing_goals(sheet, curve))]
    figure, panels = sheet.panels(len(panel_curves))
    notes = [f"lines: recovered from the line of sight; {sheet.reference_text}: true"]
    for axes, (curve, line_styles) in zip(panels, panel_curves, strict=True):
        draw_curve(axes, sheet, curve, line_styles)
    plotted = {line_style.index for _, line_styles in panel_curves for line_style in line_styles}
    steady = dict.fromkeys(
        _steady_velocity_text(sheet, line_style) for line_style in sheet.line_styles if line_style.index not in plotted
    )
    return sheet.finish(
        figure, panels, "velocities of the goals as the aircraft estimate them", "; ".join([*notes, *steady])
    )


def _changing_goals(sheet: FlightSheet, curve: Curve) -> list[LineStyle]:
    """Return the line styles of the aircraft for whose goal the velocity component of the curve changes."""
    names = [name for name in (curve.name, curve.reference) if name is not None]
    return [
        line_style
        for line_style in sheet.line_styles
        if any(float(np.ptp(sheet.until_arrival(name, line_style))) > _CHANGE_MIN_M_S for name in names)
    ]


def _steady_velocity_text(sheet: FlightSheet, line_style: LineStyle) -> str:
    north, east, down = (float(sheet.until_arrival(f"goal_velocity_{axis}_m_s", line_style)[-1]) for axis in _AXES)
    speed, goal = np.hypot(north, east), sheet.goal_name(line_style)
    if np.hypot(speed, down) < _STANDSTILL_M_S:
        return f"{goal} stands"
    text = f"{goal} keeps {speed:.3g} m/s on course {np.degrees(np.arctan2(east, north)) % 360.0:.0f}°"
    return text if abs(down) < _STANDSTILL_M_S else f"{text}, {abs(down):.2g} m/s {'down' if down > 0.0 else 'up'}"


_RANGE = "range_to_rendezvous_m"
_POSITION, _VELOCITY = ("north_m", "east_m", "altitude_m"), ("north_m_s", "east_m_s", "down_m_s")
_DISTANCE_FLOOR_M = 1e-3  # below the accuracy of the simulation; keeps the logarithm finite


def zero_effort_miss_m(dataset: xr.Dataset) -> np.ndarray:
    """Compute the zero-effort miss, m: the least distance to the rendezvous if all velocities stay constant.

    After the closest approach it is the present distance; at the arrival it is the miss of the summary.

    Parameters
    ----------
    dataset
        A flight, dimensions (time, aircraft).

    Returns
    -------
    np.ndarray
        Shape (time, aircraft).
    """
    offset = np.stack([(dataset[f"rendezvous_{a}"] - dataset[a]).values for a in _POSITION], axis=-1)
    rate_components = [(dataset[f"goal_velocity_{a}"] - dataset[f"velocity_{a}"]).values for a in _VELOCITY]
    rate = np.stack([*rate_components[:2], -rate_components[2]], axis=-1)
    squared = np.sum(rate**2, axis=-1)
    time_to_go = np.divide(-np.sum(offset * rate, axis=-1), squared, out=np.zeros_like(squared), where=squared > 0.0)
    return np.linalg.norm(offset + np.maximum(time_to_go, 0.0)[..., np.newaxis] * rate, axis=-1)


def draw_miss(sheet: FlightSheet) -> "Figure":
    """Draw the zero-effort miss up to the arrivals on a logarithmic axis, with the greatest miss that is allowed."""
    figure, (axes,) = sheet.panels(1)
    _draw_lines(axes, sheet, np.maximum(zero_effort_miss_m(sheet.dataset), _DISTANCE_FLOOR_M), sheet.arrival_index)
    axes.set_ylabel("Zero-effort miss (m)")
    _make_logarithmic(axes, sheet, _requirement(sheet, "miss_max_m", is_upper=True))
    note = "least distance to the rendezvous if aircraft and goal kept their velocities from here on"
    return sheet.finish(figure, [axes], "predicted miss of the rendezvous", note)


def draw_ranges(sheet: FlightSheet) -> "Figure":
    """Draw the ranges to the rendezvous in two panels: the upper with a linear, the lower with a logarithmic axis."""
    figure, panels = sheet.panels(2)
    values = sheet.dataset[_RANGE]
    factor, unit = axis_scale(values, float(np.nanmax(values.values[: sheet.arrival_index.max() + 1])))
    _draw_lines(panels[0], sheet, factor * values.values, sheet.arrival_index)
    panels[0].set_ylim(bottom=0.0)
    _draw_lines(panels[1], sheet, np.maximum(values.values, _DISTANCE_FLOOR_M), sheet.arrival_index)
    label_length = sheet.label_capacity(sheet.panel_height)
    panels[0].set_ylabel(axis_label(values, unit=unit, length=label_length))
    panels[1].set_ylabel(axis_label(values, length=label_length))
    _make_logarithmic(panels[1], sheet, None)
    _label_lines(panels[0], sheet)
    return sheet.finish(figure, panels, "ranges to the rendezvous", "above linear, below logarithmic")


def draw_separation(sheet: FlightSheet) -> "Figure":
    """Draw the distance of each aircraft to its nearest neighbour, and its ratio to the required separation."""
    required = required_separation(sheet.scenario)
    positions = np.stack([sheet.dataset[name].values for name in _POSITION], axis=-1)
    end_index = np.full(sheet.count, len(sheet.time) - 1)
    figure, panels = sheet.panels(1 if required is None else 2)
    _draw_lines(panels[0], sheet, nearest_aircraft_distance(positions), end_index)
    panels[0].set_ylabel(_short(sheet, "Least distance to another (m)", "Distance (m)"))
    _make_logarithmic(panels[0], sheet, _requirement(sheet, "separation_min_m", is_upper=False))
    note = ""
    if required is not None:
        _draw_lines(panels[1], sheet, nearest_aircraft_distance(positions, required), end_index)
        panels[1].set_ylabel(_short(sheet, "Distance over separation", "Distance over\nseparation"))
        above = f", or {required[1]:g} m in altitude" if required[1] else " in the plane"
        _make_logarithmic(panels[1], sheet, Limit(1.0, False, "asked for"))
        note = f"separation asked for: {required[0]:g} m{above}"
    return sheet.finish(figure, panels, "distances between the aircraft", note)


def _requirement(sheet: FlightSheet, key: str, *, is_upper: bool) -> Limit | None:
    """Return the limit line of a distance that the scenario requires, m; None without the requirement."""
    value = sheet.scenario.get("requirements", {}).get(key)
    return None if value is None else Limit(float(value), is_upper, f"required: {value:g} m")


def _short(sheet: FlightSheet, label: str, short: str) -> str:
    return label if len(label) <= sheet.label_capacity(sheet.panel_height) else short


def _draw_lines(axes: "Axes", sheet: FlightSheet, values: np.ndarray, end_index: np.ndarray) -> None:
    """Draw a line for each aircraft up to its end index; `values` has the shape (time, aircraft)."""
    for line_style in sheet.line_styles:
        samples = slice(0, int(end_index[line_style.index]) + 1)
        marker_spacing = (
            marker_interval(int(end_index[line_style.index]) + 1, line_style.index, sheet.count)
            if sheet.has_few_aircraft
            else None
        )
        label = sheet.name(line_style.index)
        axes.plot(
            sheet.time[samples],
            values[samples, line_style.index],
            label=label,
            markevery=marker_spacing,
            **sheet.line_properties(line_style),
        )
    axes.set_xlim(float(sheet.time[0]), float(sheet.time[end_index.max()]))


def _make_logarithmic(axes: "Axes", sheet: FlightSheet, limit: Limit | None) -> None:
    """Make the axis logarithmic, draw a limit with its label, and name the lines."""
    axes.set_yscale("log")
    if limit is not None:
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, 0.6 * limit.value), max(high, 1.5 * limit.value))
        draw_labelled_limit(axes, limit)
    _label_lines(axes, sheet)


def _label_lines(axes: "Axes", sheet: FlightSheet) -> None:
    if sheet.has_line_names:
        lines = zip(axes.lines, sheet.line_styles, strict=False)  # the remaining lines are limits
        line_data = [(line_style, *(np.asarray(values) for values in line.get_data())) for line, line_style in lines]
        line_ends = [find_line_end(x, y, sheet.label(line_style), line_style) for line_style, x, y in line_data]
        label_line_ends(axes, line_ends, sheet.panel_height)
