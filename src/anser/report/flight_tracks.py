"""Figure of a flight as a map up to the arrivals: flown and planned tracks, tracks of the goals, rendezvous points."""

from typing import TYPE_CHECKING

import numpy as np

from anser.report.derived_variables import HOLD
from anser.report.flight_sheet import FlightSheet
from anser.report.labels import (
    END_FONT_SIZE,
    MARKER_SIZE,
    NAMES_MAX,
    annotate_position,
    axis_label,
    axis_scale,
    clear_direction,
    escape_mathtext,
    unit_vector,
)
from anser.report.style import INK, SMALL, LineStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_DOTTED = (0, (1, 1.2))
_ASPECT_MIN, _ASPECT_MAX = 0.55, 1.0  # height of the map relative to its width
_GOAL_SPEED_MAX_M_S = 1000.0  # a faster motion is a change of the goal
_WIND_ARROW = 14.0  # width of the map over the length of the longest arrow of wind
_DEFAULT_WIDTH = 6.5  # inches; labels are relatively larger in a narrower figure


def draw_tracks(sheet: FlightSheet) -> "Figure":
    """Return a figure with the map of a flight up to the arrivals, east to the right and north up, in m or km."""
    extent, height = _extent(sheet)
    figure = sheet.figure(0.3 + height * sheet.figure_format.width)
    axes = figure.subplots()
    magnitude = max(
        float(np.nanmax(np.abs(sheet.until_arrival(f"{axis}_m", line_style))))
        for axis in _AXES
        for line_style in sheet.line_styles
    )
    factor, unit = axis_scale(sheet.dataset["east_m"], max(magnitude, extent))
    period = _round_up(float(sheet.time[sheet.arrival_index.max()]) / 12)
    for line_style in sheet.line_styles:
        _draw_track(axes, sheet, line_style, factor, period)
    greatest_m_s = _draw_wind(axes, sheet, factor, period) if _has_wind_field(sheet) else 0.0
    label_extent = factor * extent * _DEFAULT_WIDTH / sheet.figure_format.width
    _draw_names(axes, sheet, factor, label_extent)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set_xlabel(axis_label(sheet.dataset["east_m"], unit=unit))
    axes.set_ylabel(axis_label(sheet.dataset["north_m"], unit=unit))
    planned = "dashed: planned; " if sheet.has_few_aircraft else ""
    note = f"marks every {period:g} s; {planned}dotted: goal, from its square; star: rendezvous at the arrival"
    note += f"; arrows: wind at the aircraft, up to {greatest_m_s:.1f} m/s" if greatest_m_s else ""
    sheet.finish(figure, [axes], "tracks over ground up to the arrival", note)
    figure.draw_without_rendering()  # equal scales change the ticks, and the layout needs the final ones
    return figure


_AXES = ("east", "north")


def _extent(sheet: FlightSheet) -> tuple[float, float]:
    extents = []
    for axis in _AXES:
        names = (f"{axis}_m", f"goal_{axis}_m")
        tracks = [sheet.until_arrival(name, line_style) for line_style in sheet.line_styles for name in names]
        extents.append(float(max(map(np.nanmax, tracks)) - min(map(np.nanmin, tracks))))
    extent_east, extent_north = extents
    aspect = float(np.clip(extent_north / max(extent_east, 1.0), _ASPECT_MIN, _ASPECT_MAX))
    return max(extent_east, extent_north, 1.0), aspect


def _draw_track(axes: "Axes", sheet: FlightSheet, line_style: LineStyle, factor: float, period: float) -> None:
    east, north = (factor * sheet.until_arrival(f"{axis}_m", line_style) for axis in _AXES)
    times, properties = sheet.time[: east.size], sheet.line_properties(line_style)
    first_s = 0.0 if sheet.has_few_aircraft else period
    marks = np.searchsorted(times, np.arange(first_s, float(times[-1]) + period / 2, period))
    marks = np.unique(marks[marks < east.size])
    if sheet.has_few_aircraft:
        axes.plot(east, north, markevery=list(marks), label=sheet.name(line_style.index), **properties)
        planned = [factor * sheet.until_arrival(f"reference_{axis}_m", line_style) for axis in _AXES]
        axes.plot(*planned, **sheet.reference_properties())
    else:
        axes.plot(east, north, color=line_style.color, linewidth=line_style.width)
        axes.plot(east[marks], north[marks], ".", color=line_style.color, markersize=3.0)
        axes.plot(east[0], north[0], "o", color=line_style.color, markersize=3.0)
    goal = [factor * sheet.until_arrival(f"goal_{axis}_m", line_style) for axis in _AXES]
    goal_track = [np.where(_has_new_goal(sheet, line_style), np.nan, part) for part in goal]
    mark_size = 1.0 if sheet.has_few_aircraft else 0.6
    goal_color = line_style.color if sheet.has_few_aircraft else INK
    axes.plot(*goal_track, color=goal_color, linestyle=_DOTTED, linewidth=1.3 * mark_size)
    square = {"marker": "s", "fillstyle": "none", "color": INK, "markersize": 5 * mark_size, "mew": mark_size}
    axes.plot(goal[0][0], goal[1][0], linestyle="none", **square)
    if np.any(sheet.dataset["phase"].values[:, line_style.index] == HOLD):
        rendezvous = [factor * sheet.until_arrival(f"rendezvous_{axis}_m", line_style)[-1] for axis in _AXES]
        axes.plot(*rendezvous, linestyle="none", marker="*", color=INK, markersize=8 * mark_size, zorder=4)


def _has_wind_field(sheet: FlightSheet) -> bool:
    return bool((sheet.scenario.get("wind") or {}).get("field"))


def _draw_wind(axes: "Axes", sheet: FlightSheet, factor: float, period: float) -> float:
    """Draw arrows of the horizontal wind, without gusts, along the tracks; return the greatest wind speed, m/s.

    `period` is the time between two arrows, s; `factor` converts m to the unit of the map.
    """
    through_air = "airspeed_mean_wind_m_s" if "airspeed_mean_wind_m_s" in sheet.dataset else "airspeed_m_s"
    arrows = []
    for line_style in sheet.line_styles:
        airspeed, path_angle_deg, course_deg, *ground, east, north = (
            sheet.until_arrival(name, line_style)
            for name in (
                through_air,
                "path_angle_deg",
                "course_deg",
                "velocity_east_m_s",
                "velocity_north_m_s",
                "east_m",
                "north_m",
            )
        )
        level, course = airspeed * np.cos(np.radians(path_angle_deg)), np.radians(course_deg)
        wind = [ground[0] - level * np.sin(course), ground[1] - level * np.cos(course)]
        marks = np.searchsorted(sheet.time[: east.size], np.arange(0.0, float(sheet.time[east.size - 1]), period))
        arrows.append(np.stack([factor * east, factor * north, *wind])[:, marks])
    east, north, *wind = np.concatenate(arrows, axis=1)
    greatest_m_s = float(np.nanmax(np.hypot(*wind)))
    axes.quiver(
        east, north, *wind, angles="xy", scale=_WIND_ARROW * max(greatest_m_s, 1.0), color=INK, alpha=0.5, width=0.002
    )
    return greatest_m_s


def _draw_names(axes: "Axes", sheet: FlightSheet, factor: float, extent: float) -> None:
    """Write the names of the aircraft's first goals and, in a large fleet, of the aircraft, away from the tracks.

    `factor` converts m to the unit of the map; `extent` is the size of the map in this unit.
    """
    rendezvous = [_position(sheet, "rendezvous_", line_style, factor, -1) for line_style in sheet.line_styles]
    occupied = [(position, MARKER_SIZE) for position in rendezvous]
    if sheet.has_line_names:
        for line_style in sheet.line_styles:
            start = _position(sheet, "", line_style, factor, 0)
            direction = unit_vector(start - _position(sheet, "", line_style, factor, min(5, len(sheet.time) - 1)))
            label_direction = clear_direction(start, direction, extent, occupied)
            annotate_position(axes, sheet.label(line_style), start, label_direction, line_style.color, END_FONT_SIZE)
    goals = {sheet.goal_name(line_style): line_style for line_style in reversed(sheet.line_styles)}
    if len(goals) > NAMES_MAX or "aircraft" not in sheet.scenario:
        return
    goal_positions = {
        name: _position(sheet, "goal_", line_style, factor, _last_sample_of_first_goal(sheet, line_style))
        for name, line_style in goals.items()
    }
    occupied += [(_position(sheet, "goal_", line_style, factor, 0), MARKER_SIZE) for line_style in goals.values()]
    for name, line_style in reversed(goals.items()):
        goal_direction = goal_positions[name] - _position(sheet, "goal_", line_style, factor, 0)
        if np.hypot(*goal_direction) < factor:  # goal at rest: continue the aircraft's direction
            goal_direction = goal_positions[name] - _position(sheet, "", line_style, factor, 0)
        label_direction = clear_direction(goal_positions[name], unit_vector(goal_direction), extent, occupied)
        points = SMALL if sheet.has_few_aircraft else END_FONT_SIZE
        annotate_position(axes, escape_mathtext(name), goal_positions[name], label_direction, INK, points)


def _last_sample_of_first_goal(sheet: FlightSheet, line_style: LineStyle) -> int:
    """Return the index of the last sample, up to the arrival, at which the aircraft flies to its first goal."""
    return int(np.argmax(np.append(_has_new_goal(sheet, line_style), True))) - 1


def _has_new_goal(sheet: FlightSheet, line_style: LineStyle) -> np.ndarray:
    """Return a mask, shape (samples,), of the samples up to the arrival at which the goal is replaced by a new goal.

    A horizontal motion of the goal faster than `_GOAL_SPEED_MAX_M_S` since the previous sample means a new goal.
    """
    goal_track = [sheet.until_arrival(f"goal_{axis}_m", line_style) for axis in _AXES]
    steps = np.hypot(*(np.diff(part, prepend=part[0]) for part in goal_track))
    return steps > _GOAL_SPEED_MAX_M_S * np.diff(sheet.time[: steps.size], prepend=-np.inf)


def _position(sheet: FlightSheet, prefix: str, line_style: LineStyle, factor: float, sample: int) -> np.ndarray:
    """Return east and north of an aircraft (empty prefix), its goal or its rendezvous at a sample, times `factor`."""
    return factor * np.array([sheet.until_arrival(f"{prefix}{axis}_m", line_style)[sample] for axis in _AXES])


def _round_up(value: float) -> float:
    """Return the least number of the series ..., 0.5, 1, 2, 5, 10, 20, ... that is not below a value."""
    scale = 10.0 ** np.floor(np.log10(max(value, 1e-3)))
    return float(next(step for step in (scale, 2 * scale, 5 * scale, 10 * scale) if step >= value))
