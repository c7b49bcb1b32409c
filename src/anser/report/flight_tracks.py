"""Tracks over ground up to the arrivals: flown and planned, the goals with their names and ways, the rendezvous."""

from typing import TYPE_CHECKING

import numpy as np

from anser.report.aircraft_pens import Pen
from anser.report.flight_paper import Sheet
from anser.report.labels import axis_label, plain, shown_in
from anser.report.line_ends import END_POINTS
from anser.report.place_labels import MARK, MOST_NAMES, free_side, tell_place
from anser.report.print_style import INK, SMALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DOTTED = (0, (1, 1.2))
_LEAST, _MOST = 0.55, 1.0  # height of the map, in its width
_GOAL_FASTEST_M_S = 1000.0  # what moves faster has become another goal
_TINY = 1e-12
_USUAL = 6.5  # inches: the width for which labels have their usual part of a map


def draw_tracks(sheet: Sheet) -> "Figure":
    """Draw the map, east to the right."""
    extent, height = _extent(sheet)
    figure = sheet.figure(0.3 + height * sheet.paper.width)
    axes = figure.subplots()
    greatest = max(float(np.nanmax(np.abs(sheet.flown(f"{axis}_m", pen)))) for axis in _AXES for pen in sheet.pens)
    factor, unit = shown_in(sheet.dataset["east_m"], max(greatest, extent))
    period = _nice(float(sheet.time[sheet.meetings.max()]) / 12)
    for pen in sheet.pens:
        _track(axes, sheet, pen, factor, period)
    room = factor * extent * _USUAL / sheet.paper.width
    _names(axes, sheet, factor, room)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set_xlabel(axis_label(sheet.dataset["east_m"], in_unit=unit))
    axes.set_ylabel(axis_label(sheet.dataset["north_m"], in_unit=unit))
    planned = "dashed: planned; " if sheet.are_few else ""
    note = f"marks every {period:g} s; {planned}dotted: goal, from its square; star: rendezvous at the arrival"
    sheet.finish(figure, [axes], "tracks over ground up to the arrival", note)
    figure.draw_without_rendering()  # equal scales change the ticks, of which the next layout has to know
    return figure


_AXES = ("east", "north")


def _extent(sheet: Sheet) -> tuple[float, float]:
    """Greatest extent of what is shown, m, and the height of its map in its width."""
    wide, tall = (
        float(np.ptp(np.concatenate([ends for pen in sheet.pens for ends in _ends(sheet, axis, pen)])))
        for axis in _AXES
    )
    return max(wide, tall, 1.0), float(np.clip(tall / max(wide, 1.0), _LEAST, _MOST))


def _ends(sheet: Sheet, axis: str, pen: Pen) -> list[np.ndarray]:
    found = []
    for place in ("", "goal_"):
        values = sheet.flown(f"{place}{axis}_m", pen)
        found.append(np.array([np.nanmin(values), np.nanmax(values)]))
    return found


def _track(axes: "Axes", sheet: Sheet, pen: Pen, factor: float, period: float) -> None:
    east, north = (factor * sheet.flown(f"{axis}_m", pen) for axis in _AXES)
    times, look = sheet.time[: east.size], sheet.look(pen)
    at = np.searchsorted(times, np.arange(period if not sheet.are_few else 0.0, float(times[-1]) + period / 2, period))
    at = np.unique(at[at < east.size])
    if sheet.are_few:
        axes.plot(east, north, markevery=list(at), label=sheet.name(pen.index), **look)
        planned = [factor * sheet.flown(f"reference_{axis}_m", pen) for axis in _AXES]
        axes.plot(*planned, **sheet.wanted_look())
    else:
        axes.plot(east, north, color=pen.color, linewidth=pen.width)
        axes.plot(east[at], north[at], ".", color=pen.color, markersize=3.0)
        axes.plot(east[0], north[0], "o", color=pen.color, markersize=3.0)
    goal = [factor * sheet.flown(f"goal_{axis}_m", pen) for axis in _AXES]
    way = [np.where(_becomes_another(sheet, pen), np.nan, part) for part in goal]
    mark = 1.0 if sheet.are_few else 0.6
    axes.plot(*way, color=pen.color if sheet.are_few else INK, linestyle=_DOTTED, linewidth=1.3 * mark)
    square = {"marker": "s", "fillstyle": "none", "color": INK, "markersize": 5 * mark, "markeredgewidth": mark}
    axes.plot(goal[0][0], goal[1][0], linestyle="none", **square)
    met = [factor * sheet.flown(f"rendezvous_{axis}_m", pen)[-1] for axis in _AXES]
    axes.plot(*met, linestyle="none", marker="*", color=INK, markersize=8 * mark, zorder=4)


def _names(axes: "Axes", sheet: Sheet, factor: float, extent: float) -> None:
    """Name each goal of the start once, behind it, and many aircraft, behind them."""
    taken = [(_place(sheet, "rendezvous_", pen, factor, -1), MARK) for pen in sheet.pens]
    if sheet.are_named:
        for pen in sheet.pens:
            start = _place(sheet, "", pen, factor, 0)
            away = _unit(start - _place(sheet, "", pen, factor, min(5, len(sheet.time) - 1)))
            side = free_side(start, away, extent, taken)
            tell_place(axes, sheet.label(pen), (start[0], start[1]), side, pen.color, END_POINTS)
    first = {sheet.goal(pen): pen for pen in reversed(sheet.pens)}
    if len(first) > MOST_NAMES or "aircraft" not in sheet.scenario:
        return
    ends = {name: _place(sheet, "goal_", pen, factor, _goal_end(sheet, pen)) for name, pen in first.items()}
    taken += [(_place(sheet, "goal_", pen, factor, 0), MARK) for pen in first.values()]
    for name, pen in reversed(first.items()):
        ahead = ends[name] - _place(sheet, "goal_", pen, factor, 0)
        if np.hypot(*ahead) < factor:  # it stands: on from where the aircraft comes
            ahead = ends[name] - _place(sheet, "", pen, factor, 0)
        side = free_side(ends[name], _unit(ahead), extent, taken)
        tell_place(axes, plain(name), (ends[name][0], ends[name][1]), side, INK, SMALL if sheet.are_few else END_POINTS)


def _goal_end(sheet: Sheet, pen: Pen) -> int:
    """Index of the last time before the arrival at which an aircraft has its first goal."""
    return int(np.argmax(np.append(_becomes_another(sheet, pen), True))) - 1


def _becomes_another(sheet: Sheet, pen: Pen) -> np.ndarray:
    """Whether what is recorded as the goal is another one from a time on."""
    way = [sheet.flown(f"goal_{axis}_m", pen) for axis in _AXES]
    steps = np.hypot(*(np.diff(part, prepend=part[0]) for part in way))
    return steps > _GOAL_FASTEST_M_S * np.diff(sheet.time[: steps.size], prepend=-np.inf)


def _place(sheet: Sheet, of: str, pen: Pen, factor: float, at: int) -> np.ndarray:
    """Place of an aircraft, its goal or its rendezvous: east, north; -1: at the arrival."""
    return factor * np.array([sheet.flown(f"{of}{axis}_m", pen)[at] for axis in _AXES])


def _unit(away: np.ndarray) -> tuple[float, float]:
    east, north = away / max(float(np.hypot(*away)), _TINY)
    return float(east), float(north)


def _nice(least: float) -> float:
    """Smallest of 1, 2, 5, 10, 20, ... that is no smaller."""
    scale = 10.0 ** np.floor(np.log10(max(least, 1e-3)))
    return float(next(step for step in (scale, 2 * scale, 5 * scale, 10 * scale) if step >= least))
