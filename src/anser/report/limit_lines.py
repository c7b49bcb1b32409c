"""Limits as lines in panels against time: which there are, whose, and those that are too far to be shown."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from anser.report.print_style import DASHED, SMALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CLOSED = "#b3261e"
"""Colour of keep-outs and of limits."""
_LEAST_PART = 0.2  # of a panel's height that the data keep when it reaches to a limit
_ROOM = 0.13  # beyond a limit, for its words; part of the height
_NAMES = 3  # of aircraft that are told one by one


@dataclass(frozen=True)
class Limit:
    """A limit of some aircraft.

    Attributes
    ----------
    value
        In the unit of the panel.
    is_upper
        Whether what is drawn is to stay below it.
    words
        What is written at its line.
    """

    value: float
    is_upper: bool
    words: str


def whose(names: Sequence[str], of: int) -> str:
    """Words for some of the aircraft of a fleet; empty for all of them."""
    if len(names) == of:
        return ""
    if len(names) <= _NAMES:
        return ", ".join(names)
    return f"{', '.join(names[: _NAMES - 1])} and {len(names) - _NAMES + 1} more"


def limit_line(axes: "Axes", value: float) -> None:
    """Draw the line of a limit."""
    axes.axhline(value, color=CLOSED, linestyle=DASHED, linewidth=1.0, zorder=2)


def told_limit(axes: "Axes", limit: Limit, *, right: bool = False) -> None:
    """Draw the line of a limit, with its words at the left or the right, on the side where nothing is to be."""
    limit_line(axes, limit.value)
    axes.annotate(
        limit.words,
        (1.0 if right else 0.0, limit.value),
        xycoords=("axes fraction", "data"),
        xytext=(-3 if right else 3, 1.5 if limit.is_upper else -1.5),
        textcoords="offset points",
        ha="right" if right else "left",
        va="bottom" if limit.is_upper else "top",
        color=CLOSED,
        fontsize=SMALL,
        bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.3},
        zorder=6,
    )


def draw_limits(axes: "Axes", limits: Sequence[Limit], shown: tuple[float, float]) -> list[Limit]:
    """Draw limits and reach to them, the nearest first, as long as the data keep some height; returns the others.

    Parameters
    ----------
    axes
        Of a linear scale, its limits as the data have them.
    limits
        All that there are.
    shown
        Least and greatest value of the data that the panel shows.
    """
    far: list[Limit] = []
    told = {True: 0, False: 0}
    low, high = axes.get_ylim()
    size = shown[1] - shown[0]
    for limit in sorted(limits, key=lambda one: max(shown[0] - one.value, one.value - shown[1])):
        reach = min(low, limit.value), max(high, limit.value)
        if size < _LEAST_PART * (reach[1] - reach[0]):
            far.append(limit)
            continue
        low, high = reach
        told_limit(axes, limit, right=told[limit.is_upper] % 2 == 1)  # in turn: neighbours may be close
        told[limit.is_upper] += 1
    room = _ROOM * (high - low)
    near = [limit for limit in limits if limit not in far]
    axes.set_ylim(
        min([low, *(limit.value - room for limit in near if not limit.is_upper)]),
        max([high, *(limit.value + room for limit in near if limit.is_upper)]),
    )
    return far
