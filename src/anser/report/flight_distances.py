"""Distances of a flight against time: to the rendezvous, what they would be at the arrival, to other aircraft."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.flight_curves import marked_every
from anser.report.flight_paper import Sheet
from anser.report.flown_beside_plan import asked_separation
from anser.report.labels import axis_label, shown_in
from anser.report.limit_lines import Limit, told_limit
from anser.report.line_ends import end_of, tell_ends
from anser.results import nearest_other

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_RANGE = "range_to_rendezvous_m"
_PLACE, _VELOCITY = ("north_m", "east_m", "altitude_m"), ("north_m_s", "east_m_s", "down_m_s")
_LEAST_SHOWN_M = 1e-3  # less than any of these flights is known to


def closest_approach_m(dataset: xr.Dataset) -> np.ndarray:
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


def draw_miss(sheet: Sheet) -> "Figure":
    """Draw the zero-effort miss up to the arrivals, logarithmic, with the greatest that the scenario allows."""
    figure, (axes,) = sheet.panels(1)
    _lines(axes, sheet, np.maximum(closest_approach_m(sheet.dataset), _LEAST_SHOWN_M), sheet.meetings)
    axes.set_ylabel("Zero-effort miss (m)")
    _logarithmic(axes, sheet, _required(sheet, "miss_max_m", is_upper=True))
    note = "least distance to the rendezvous if aircraft and goal kept their velocities from here on"
    return sheet.finish(figure, [axes], "predicted miss of the rendezvous", note)


def draw_ranges(sheet: Sheet) -> "Figure":
    """Draw the ranges to the rendezvous, linear above and logarithmic below."""
    figure, panels = sheet.panels(2)
    values = sheet.dataset[_RANGE]
    factor, unit = shown_in(values, float(np.nanmax(values.values[: sheet.meetings.max() + 1])))
    _lines(panels[0], sheet, factor * values.values, sheet.meetings)
    panels[0].set_ylim(bottom=0.0)
    _lines(panels[1], sheet, np.maximum(values.values, _LEAST_SHOWN_M), sheet.meetings)
    letters = sheet.letters(sheet.panel_height)
    panels[0].set_ylabel(axis_label(values, in_unit=unit, length=letters))
    panels[1].set_ylabel(axis_label(values, length=letters))
    _logarithmic(panels[1], sheet, None)
    _named(panels[0], sheet)
    return sheet.finish(figure, panels, "ranges to the rendezvous", "above linear, below logarithmic")


def draw_separation(sheet: Sheet) -> "Figure":
    """Draw the least distance of each aircraft to any other until the flight ends, and its ratio to that asked for."""
    asked = asked_separation(sheet.scenario)
    places = np.stack([sheet.dataset[name].values for name in _PLACE], axis=-1)
    end = np.full(sheet.count, len(sheet.time) - 1)
    figure, panels = sheet.panels(1 if asked is None else 2)
    _lines(panels[0], sheet, nearest_other(places), end)
    panels[0].set_ylabel(_short(sheet, "Least distance to another (m)", "Distance (m)"))
    _logarithmic(panels[0], sheet, _required(sheet, "separation_min_m", is_upper=False))
    note = ""
    if asked is not None:
        _lines(panels[1], sheet, nearest_other(places, asked), end)
        panels[1].set_ylabel(_short(sheet, "Distance over separation", "Distance over\nseparation"))
        above = f", or {asked[1]:g} m in altitude" if asked[1] else " in the plane"
        _logarithmic(panels[1], sheet, Limit(1.0, False, "asked for"))
        note = f"separation asked for: {asked[0]:g} m{above}"
    return sheet.finish(figure, panels, "distances between the aircraft", note)


def _required(sheet: Sheet, key: str, *, is_upper: bool) -> Limit | None:
    """What a scenario requires of a distance; None where it requires nothing."""
    value = sheet.scenario.get("requirements", {}).get(key)
    return None if value is None else Limit(float(value), is_upper, f"required: {value:g} m")


def _short(sheet: Sheet, words: str, short: str) -> str:
    return words if len(words) <= sheet.letters(sheet.panel_height) else short


def _lines(axes: "Axes", sheet: Sheet, values: np.ndarray, until: np.ndarray) -> None:
    """One line for each aircraft up to an index of its own."""
    for pen in sheet.pens:
        upto = slice(0, int(until[pen.index]) + 1)
        every = marked_every(int(until[pen.index]) + 1, pen.index, sheet.count) if sheet.are_few else None
        label = sheet.name(pen.index)
        axes.plot(sheet.time[upto], values[upto, pen.index], label=label, markevery=every, **sheet.look(pen))
    axes.set_xlim(float(sheet.time[0]), float(sheet.time[until.max()]))


def _logarithmic(axes: "Axes", sheet: Sheet, limit: Limit | None) -> None:
    """Make the scale of a panel logarithmic, draw a limit with its words, and name the lines."""
    axes.set_yscale("log")
    if limit is not None:
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, 0.6 * limit.value), max(high, 1.5 * limit.value))
        told_limit(axes, limit)
    _named(axes, sheet)


def _named(axes: "Axes", sheet: Sheet) -> None:
    if sheet.are_named:
        lines = zip(axes.lines, sheet.pens, strict=False)  # further lines are limits
        drawn = [(pen, *(np.asarray(values) for values in line.get_data())) for line, pen in lines]
        ends = [end_of(x, y, sheet.label(pen), pen) for pen, x, y in drawn]
        tell_ends(axes, ends, sheet.panel_height)
