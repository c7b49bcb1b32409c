"""Names at the ends of lines, right of a panel: what a key is for a few lines, for many."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from anser.report.aircraft_pens import Pen

if TYPE_CHECKING:
    from matplotlib.axes import Axes

END_POINTS = 6.0
"""Size of the letters, points."""
_PITCH = 1.15  # from one line of letters to the next, in their size
_AWAY = 1.07  # where names begin, in the width of the panel
_WAY = 4  # part of a line that is its way to the end: one in so many


@dataclass(frozen=True)
class LineEnd:
    """Where a line ends, and what is to be written there.

    Attributes
    ----------
    x, y
        In the units of the axes.
    before
        The line's height on its way there: of lines that end at one height, the higher is named above.
    words
        Its name.
    pen
        How it is drawn: the name is joined to it by a line of the same look.
    """

    x: float
    y: float
    before: float
    words: str
    pen: Pen


def end_of(x: np.ndarray, y: np.ndarray, words: str, pen: Pen) -> LineEnd:
    """End of a line of samples, which may have gaps."""
    there = np.flatnonzero(np.isfinite(y))
    if there.size == 0:
        return LineEnd(float(x[-1]), np.nan, np.nan, words, pen)
    return LineEnd(float(x[there[-1]]), float(y[there[-1]]), float(np.nanmean(y[-(y.size // _WAY) - 1 :])), words, pen)


def height_for(count: int) -> float:
    """Least height of a panel, inches, beside which so many names stand."""
    return count * END_POINTS * _PITCH / 72.0


def tell_ends(axes: "Axes", ends: Sequence[LineEnd], height: float) -> None:
    """Write names right of a panel, each as near to its line's end as the others let it, and joined to it.

    Parameters
    ----------
    axes
        Its limits are final.
    ends
        One for each line.
    height
        Of the panel, inches, as nearly as it is known.
    """
    inside = [end for end in ends if np.isfinite(end.y)]
    if not inside:
        return
    # from the data to the part of the axes' height, whatever the scale
    to_part = axes.transScale + axes.transLimits
    wanted = np.array([to_part.transform((end.x, end.y))[1] for end in inside])
    gap = END_POINTS * _PITCH / 72.0 / height
    before = np.array([end.before for end in inside])
    order = np.lexsort((before, np.round(wanted / gap)))  # by the last key first
    places = spread(np.maximum.accumulate(wanted[order]), gap)
    for k, place in zip(order, places, strict=True):
        end = inside[k]
        axes.annotate(
            end.words,
            (end.x, end.y),
            xytext=(_AWAY, place),
            textcoords="axes fraction",
            color=end.pen.color,
            fontsize=END_POINTS,
            va="center",
            ha="left",
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": end.pen.color,
                "linestyle": end.pen.dashes,
                "linewidth": 0.8,
                "shrinkA": 0.5,
                "shrinkB": 0.0,
            },
        )


def spread(wanted: np.ndarray, gap: float) -> np.ndarray:
    """Places from 0 to 1 nearest to those wanted (least squares) that keep a gap between neighbours.

    Parameters
    ----------
    wanted
        Increasing, shape (n,).
    gap
        Least difference of neighbours. Where not all find room, they reach beyond 0 and 1 alike.
    """
    # without its gaps a place must not be less than the one before: groups of equal values, each the mean of its own
    groups: list[list[float]] = []
    for k, value in enumerate(wanted):
        groups.append([float(value) - k * gap, 1.0])
        while len(groups) > 1 and groups[-2][0] >= groups[-1][0]:
            (one, n), (other, m) = groups[-2:]
            groups[-2:] = [[(one * n + other * m) / (n + m), n + m]]
    even = np.concatenate([np.full(int(n), value) for value, n in groups])
    room = 1.0 - gap * (len(wanted) - 1)
    return np.clip(even, min(0.0, room / 2.0), max(room, room / 2.0)) + gap * np.arange(len(wanted))
