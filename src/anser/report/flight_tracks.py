"""Tracks over ground up to the arrivals: flown and planned, the goals with their names and ways, the rendezvous."""

from typing import TYPE_CHECKING

import numpy as np

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
)
from anser.report.style import INK, SMALL, LineStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_DOTTED = (0, (1, 1.2))
_LEAST, _MOST = 0.55, 1.0  # height of the map, in its width
_GOAL_FASTEST_M_S = 1000.0  # what moves faster has become another goal
_TINY = 1e-12
_USUAL = 6.5  # inches: the width for which labels have their usual part of a map


def draw_tracks(sheet: FlightSheet) -> "Figure":
    """Draw the map, east to the right."""
    extent, height = _extent(sheet)
    figure = sheet.figure(0.3 + height * sheet.figure_format.width)
    axes = figure.subplots()
    greatest = max(
        float(np.nanmax(np.abs(sheet.until_arrival(f"{axis}_m", line_style))))
        for axis in _AXES
        for line_style in sheet.line_styles
    )
    factor, unit = axis_scale(sheet.dataset["east_m"], max(greatest, extent))
    period = _nice(float(sheet.time[sheet.arrival_index.max()]) / 12)
    for line_style in sheet.line_styles:
        _track(axes, sheet, line_style, factor, period)
    room = factor * extent * _USUAL / sheet.figure_format.width
    _names(axes, sheet, factor, room)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set_xlabel(axis_label(sheet.dataset["east_m"], in_unit=unit))
    axes.set_ylabel(axis_label(sheet.dataset["north_m"], in_unit=unit))
    planned = "dashed: planned; " if sheet.has_few_aircraft else ""
    note = f"marks every {period:g} s; {planned}dotted: goal, from its square; star: rendezvous at the arrival"
    sheet.finish(figure, [axes], "tracks over ground up to the arrival", note)
    figure.draw_without_rendering()  # equal scales change the ticks, of which the next layout has to know
    return figure


_AXES = ("east", "north")


def _extent(sheet: FlightSheet) -> tuple[float, float]:
    """Greatest extent of what is shown, m, and the height of its map in its width."""
    wide, tall = (
        float(
            np.ptp(
                np.concatenate([ends for line_style in sheet.line_styles for ends in _ends(sheet, axis, line_style)])
            )
        )
        for axis in _AXES
    )
    return max(wide, tall, 1.0), float(np.clip(tall / max(wide, 1.0), _LEAST, _MOST))


def _ends(sheet: FlightSheet, axis: str, line_style: LineStyle) -> list[np.ndarray]:
    found = []
    for place in ("", "goal_"):
        values = sheet.until_arrival(f"{place}{axis}_m", line_style)
        found.append(np.array([np.nanmin(values), np.nanmax(values)]))
    return found


def _track(axes: "Axes", sheet: FlightSheet, line_style: LineStyle, factor: float, period: float) -> None:
    east, north = (factor * sheet.until_arrival(f"{axis}_m", line_style) for axis in _AXES)
    times, look = sheet.time[: east.size], sheet.line_properties(line_style)
    at = np.searchsorted(
        times, np.arange(period if not sheet.has_few_aircraft else 0.0, float(times[-1]) + period / 2, period)
    )
    at = np.unique(at[at < east.size])
    if sheet.has_few_aircraft:
        axes.plot(east, north, markevery=list(at), label=sheet.name(line_style.index), **look)
        planned = [factor * sheet.until_arrival(f"reference_{axis}_m", line_style) for axis in _AXES]
        axes.plot(*planned, **sheet.reference_properties())
    else:
        axes.plot(east, north, color=line_style.color, linewidth=line_style.width)
        axes.plot(east[at], north[at], ".", color=line_style.color, markersize=3.0)
        axes.plot(east[0], north[0], "o", color=line_style.color, markersize=3.0)
    goal = [factor * sheet.until_arrival(f"goal_{axis}_m", line_style) for axis in _AXES]
    way = [np.where(_becomes_another(sheet, line_style), np.nan, part) for part in goal]
    mark = 1.0 if sheet.has_few_aircraft else 0.6
    axes.plot(*way, color=line_style.color if sheet.has_few_aircraft else INK, linestyle=_DOTTED, linewidth=1.3 * mark)
    square = {"marker": "s", "fillstyle": "none", "color": INK, "markersize": 5 * mark, "markeredgewidth": mark}
    axes.plot(goal[0][0], goal[1][0], linestyle="none", **square)
    met = [factor * sheet.until_arrival(f"rendezvous_{axis}_m", line_style)[-1] for axis in _AXES]
    axes.plot(*met, linestyle="none", marker="*", color=INK, markersize=8 * mark, zorder=4)


def _names(axes: "Axes", sheet: FlightSheet, factor: float, extent: float) -> None:
    """Name each goal of the start once, behind it, and many aircraft, behind them."""
    taken = [(_place(sheet, "rendezvous_", line_style, factor, -1), MARKER_SIZE) for line_style in sheet.line_styles]
    if sheet.has_line_names:
        for line_style in sheet.line_styles:
            start = _place(sheet, "", line_style, factor, 0)
            away = _unit(start - _place(sheet, "", line_style, factor, min(5, len(sheet.time) - 1)))
            side = clear_direction(start, away, extent, taken)
            annotate_position(
                axes, sheet.label(line_style), (start[0], start[1]), side, line_style.color, END_FONT_SIZE
            )
    first = {sheet.goal_name(line_style): line_style for line_style in reversed(sheet.line_styles)}
    if len(first) > NAMES_MAX or "aircraft" not in sheet.scenario:
        return
    ends = {
        name: _place(sheet, "goal_", line_style, factor, _goal_end(sheet, line_style))
        for name, line_style in first.items()
    }
    taken += [(_place(sheet, "goal_", line_style, factor, 0), MARKER_SIZE) for line_style in first.values()]
    for name, line_style in reversed(first.items()):
        ahead = ends[name] - _place(sheet, "goal_", line_style, factor, 0)
        if np.hypot(*ahead) < factor:  # it stands: on from where the aircraft comes
            ahead = ends[name] - _place(sheet, "", line_style, factor, 0)
        side = clear_direction(ends[name], _unit(ahead), extent, taken)
        annotate_position(
            axes,
            escape_mathtext(name),
            (ends[name][0], ends[name][1]),
            side,
            INK,
            SMALL if sheet.has_few_aircraft else END_FONT_SIZE,
        )


def _goal_end(sheet: FlightSheet, line_style: LineStyle) -> int:
    """Index of the last time before the arrival at which an aircraft has its first goal."""
    return int(np.argmax(np.append(_becomes_another(sheet, line_style), True))) - 1


def _becomes_another(sheet: FlightSheet, line_style: LineStyle) -> np.ndarray:
    """Whether what is recorded as the goal is another one from a time on."""
    way = [sheet.until_arrival(f"goal_{axis}_m", line_style) for axis in _AXES]
    steps = np.hypot(*(np.diff(part, prepend=part[0]) for part in way))
    return steps > _GOAL_FASTEST_M_S * np.diff(sheet.time[: steps.size], prepend=-np.inf)


def _place(sheet: FlightSheet, of: str, line_style: LineStyle, factor: float, at: int) -> np.ndarray:
    """Place of an aircraft, its goal or its rendezvous: east, north; -1: at the arrival."""
    return factor * np.array([sheet.until_arrival(f"{of}{axis}_m", line_style)[at] for axis in _AXES])


def _unit(away: np.ndarray) -> tuple[float, float]:
    east, north = away / max(float(np.hypot(*away)), _TINY)
    return float(east), float(north)


def _nice(least: float) -> float:
    """Smallest of 1, 2, 5, 10, 20, ... that is no smaller."""
    scale = 10.0 ** np.floor(np.log10(max(least, 1e-3)))
    return float(next(step for step in (scale, 2 * scale, 5 * scale, 10 * scale) if step >= least))
