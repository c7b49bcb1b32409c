"""Variables of a flight against time up to the arrivals, each with what was asked for and with its limits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.report.aircraft_pens import Pen
from anser.report.flight_paper import Sheet
from anser.report.flown_beside_plan import limits_of_each
from anser.report.labels import axis_label, shown_in
from anser.report.limit_lines import Limit, draw_limits, whose
from anser.report.line_ends import end_of, tell_ends

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
        Keys of its limits in `limits_of_each`; of `low` a minus sign before it takes the opposite value.
    stops_of
        Name of a control surface whose stops are the limits.
    words
        Of the axis; None: those of the variable.
    """

    name: str
    wanted: str | None = None
    low: str | None = None
    high: str | None = None
    stops_of: str | None = None
    words: str | None = None


def draw_over_time(sheet: Sheet, curves: Sequence[Curve], words: str, asked: str = "") -> "Figure":
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
    told = [f"{sheet.wanted_words}: {asked}"] if asked else []
    for axes, curve in zip(panels, there, strict=True):
        told += draw_curve(axes, sheet, curve)
    return sheet.finish(figure, panels, words, "; ".join(told))


def draw_curve(axes: "Axes", sheet: Sheet, curve: Curve, pens: Sequence[Pen] | None = None) -> list[str]:
    """Draw one variable of all aircraft, or of some; returns words about limits that are too far to be shown."""
    values, time = sheet.dataset[curve.name], sheet.time
    pens = [pen for pen in pens or sheet.pens if np.isfinite(values.values[:, pen.index]).any()]
    factor, unit = shown_in(values, _up_to_arrival(sheet, curve.name, pens))
    jump = 180.0 if values.attrs["units"] == "degree" else np.inf
    drawn, asked, ends = [], [], []
    for pen in pens:
        until = slice(0, int(sheet.meetings[pen.index]) + 1)
        x, y = with_gaps(time[until], factor * sheet.flown(curve.name, pen), jump)
        every = marked_every(x.size, pen.index, sheet.count) if sheet.are_few else None
        axes.plot(x, y, markevery=every, label=sheet.name(pen.index), **sheet.look(pen))
        drawn.append(y)
        ends.append(end_of(x, y, sheet.label(pen), pen))
        if curve.wanted is not None:
            x, y = with_gaps(time[until], factor * sheet.flown(curve.wanted, pen), jump)
            axes.plot(x, y, **sheet.wanted_look())
            asked.append(y)
    shown = _shown(drawn, asked, factor * _SPAN_MIN[str(values.attrs["units"])])
    room = _MARGIN * (shown[1] - shown[0])
    axes.set_ylim(shown[0] - room, shown[1] + room)
    far = draw_limits(axes, _limits(sheet, curve, pens, factor, unit), shown)
    axes.set_ylabel(axis_label(values, curve.words, unit, sheet.letters(sheet.panel_height)))
    axes.set_xlim(float(time[0]), float(time[sheet.meetings.max()]))
    if sheet.are_named:
        tell_ends(axes, ends, sheet.panel_height)
    beyond = ", ".join(limit.words for limit in sorted(far, key=lambda one: one.value))
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


def _up_to_arrival(sheet: Sheet, name: str, pens: Sequence[Pen]) -> float:
    """Greatest size of a variable up to the arrivals."""
    return max(float(np.nanmax(np.abs(sheet.flown(name, pen)))) for pen in pens)


def _limits(sheet: Sheet, curve: Curve, pens: Sequence[Pen], factor: float, unit: str) -> list[Limit]:
    """Each value of a limit once, with those whose it is."""
    found: dict[tuple[float, bool], list[str]] = {}
    limits = limits_of_each(sheet.dataset)
    for pen in pens:
        own = limits[pen.index]
        if curve.stops_of is not None:
            ends = own.get("surfaces_deg", {}).get(curve.stops_of, [None, None])
        else:
            ends = [_limit(own, key) for key in (curve.low, curve.high)]
        for value, is_upper in zip(ends, (False, True), strict=True):
            if value is not None:
                found.setdefault((factor * float(value), is_upper), []).append(sheet.label(pen))
    what = "limit" if curve.stops_of is None else "stop"
    result = []
    for (value, is_upper), names in found.items():
        number = f"{float(f'{value:.4g}'):,g}".replace("-", "\u2212")
        number += unit if unit == "°" else f" {unit}".rstrip()
        of = whose(names, len(pens))
        result.append(Limit(value, is_upper, f"{what} {number}" + (f" ({of})" if of else "")))
    return result


def _limit(limits: Mapping[str, Any], key: str | None) -> float | None:
    """Value of a limit by its key; a minus sign before it stands for the opposite value."""
    value = None if key is None else limits.get(key.removeprefix("-"))
    return None if key is None or value is None else -value if key.startswith("-") else value


def marked_every(samples: int, index: int, count: int) -> tuple[int, int]:
    """Which samples of one line of some bear a mark: in turn, so that equal lines show all their marks."""
    step = max(samples // _MARKS, 1)
    return index * step // count, step


def with_gaps(x: np.ndarray, y: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
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
