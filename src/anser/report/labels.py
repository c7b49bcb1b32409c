"""Labels of figures and pages.

Words, symbols and units of variables, limit lines with their values, names beside positions on a map and at the ends
of lines.
"""

import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.style import DASHED, SMALL, LineStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_PRINTED = {
    "m s-1": "m/s",
    "m s-2": "m/s²",
    "m s-4": "m/s⁴",
    "degree": "°",
    "degree s-1": "°/s",
    "percent": "%",
    "1": "",
}
_LINE_LENGTH, _SIGN_LENGTH = 26, 8
"""Characters of a label before it goes on in another line; those that a symbol with its unit takes of them."""
_FIVE_DIGITS = 10_000.0


def printed_unit(unit: str) -> str:
    """Print a unit as people write it; empty where there is none."""
    return _PRINTED.get(unit, unit)


def html_label(values: xr.DataArray) -> dict[str, str]:
    """Label of a variable: `words`, `unit` as text, and `symbol` as HTML with its subscript.

    Parameters
    ----------
    values
        Variable with the attributes `long_name`, `units`, `symbol`.
    """
    base, _, subscript = html.escape(str(values.attrs["symbol"])).partition("_")
    return {
        "words": str(values.attrs["long_name"]),
        "unit": printed_unit(str(values.attrs["units"])),
        "symbol": f"<i>{base}</i>" + (f"<sub>{subscript}</sub>" if subscript else ""),
    }


def axis_label(
    values: xr.DataArray, words: str | None = None, in_unit: str | None = None, length: int = _LINE_LENGTH
) -> str:
    """Words, symbol and unit of a variable, long ones in several lines; other words or another unit where given."""
    lines = textwrap.wrap(str(values.attrs["long_name"]) if words is None else words, length)
    printed = display_unit(values) if in_unit is None else in_unit
    sign = math_symbol(values) + (f" ({printed})" if printed else "")
    # The symbol goes on in the last line where there is room for it.
    text, between = "\n".join(lines), " " if len(lines[-1]) <= length - _SIGN_LENGTH else "\n"
    return f"{text}{between}{sign}"


def axis_scale(values: xr.DataArray, greatest: float) -> tuple[float, str]:
    """Factor and printed unit in which an axis up to `greatest` is drawn: kilometres where metres have five digits."""
    if str(values.attrs["units"]) == "m" and greatest >= _FIVE_DIGITS:
        return 1e-3, "km"
    return 1.0, display_unit(values)


def math_symbol(values: xr.DataArray) -> str:
    """Symbol of a variable as matplotlib sets it: `p_N` with a subscript."""
    base, _, subscript = str(values.attrs["symbol"]).partition("_")
    return f"${base}_{{{subscript}}}$" if subscript else f"${base}$"


def display_unit(values: xr.DataArray) -> str:
    """Unit of a variable as it is printed; empty where there is none."""
    return printed_unit(str(values.attrs["units"]))


def escape_mathtext(text: object) -> str:
    """Text from a file, of which matplotlib is to read nothing as mathematics."""
    return str(text).replace("$", r"\$")


LIMIT_COLOR = "#b3261e"
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
    label: str


def format_owners(names: Sequence[str], fleet_size: int) -> str:
    """Words for some of the aircraft of a fleet; empty for all of them."""
    if len(names) == fleet_size:
        return ""
    if len(names) <= _NAMES:
        return ", ".join(names)
    return f"{', '.join(names[: _NAMES - 1])} and {len(names) - _NAMES + 1} more"


def draw_limit_line(axes: "Axes", value: float) -> None:
    """Draw the line of a limit."""
    axes.axhline(value, color=LIMIT_COLOR, linestyle=DASHED, linewidth=1.0, zorder=2)


def draw_labelled_limit(axes: "Axes", limit: Limit, *, right: bool = False) -> None:
    """Draw the line of a limit, with its words at the left or the right, on the side where nothing is to be."""
    draw_limit_line(axes, limit.value)
    axes.annotate(
        limit.label,
        (1.0 if right else 0.0, limit.value),
        xycoords=("axes fraction", "data"),
        xytext=(-3 if right else 3, 1.5 if limit.is_upper else -1.5),
        textcoords="offset points",
        ha="right" if right else "left",
        va="bottom" if limit.is_upper else "top",
        color=LIMIT_COLOR,
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
        draw_labelled_limit(axes, limit, right=told[limit.is_upper] % 2 == 1)  # in turn: neighbours may be close
        told[limit.is_upper] += 1
    room = _ROOM * (high - low)
    near = [limit for limit in limits if limit not in far]
    axes.set_ylim(
        min([low, *(limit.value - room for limit in near if not limit.is_upper)]),
        max([high, *(limit.value + room for limit in near if limit.is_upper)]),
    )
    return far


NAMES_MAX = 40
"""Of more, none is written."""
MARKER_SIZE = 0.6
"""What a mark takes of a label's room."""
_OFFSET, _SLANT = 9.0, 0.3  # points, sines
_LABEL = (0.16, 0.045)  # width and height of a label, as parts of the map


def annotate_position(
    axes: "Axes", label: str, position: tuple[float, float], towards: tuple[float, float], color: str, points: float
) -> None:
    """Words in letters of some points beside a place, on the side that a unit vector points to."""
    side, up = towards
    axes.annotate(
        label,
        position,
        xytext=(_OFFSET * side, _OFFSET * up),
        textcoords="offset points",
        color=color,
        fontsize=points,
        ha="left" if side > _SLANT else "right" if side < -_SLANT else "center",
        va="bottom" if up > _SLANT else "top" if up < -_SLANT else "center",
        bbox={"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.4},  # a halo would make paths of text
        zorder=8,
    )


def clear_direction(
    position: np.ndarray, towards: tuple[float, float], extent: float, occupied: list[tuple[np.ndarray, float]]
) -> tuple[float, float]:
    """The wanted side, or the one next to it where a label meets nothing: middles, and what they keep off in labels."""
    wanted = np.arctan2(towards[1], towards[0])
    turns = np.radians([0, 45, -45, 90, -90, 135, -135, 180])
    sides = [(float(np.cos(wanted + turn)), float(np.sin(wanted + turn))) for turn in turns]
    box = extent * np.array(_LABEL)
    middles = [position + box * np.array([0.75 * side, 0.9 * up]) for side, up in sides]
    clear = [all(np.any(np.abs(middle - other) > size * box) for other, size in occupied) for middle in middles]
    k = clear.index(True) if True in clear else 0
    occupied.append((middles[k], 1.0))
    return sides[k]


END_FONT_SIZE = 6.0
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
    approach_y: float
    label: str
    line_style: LineStyle


def find_line_end(x: np.ndarray, y: np.ndarray, label: str, line_style: LineStyle) -> LineEnd:
    """End of a line of samples, which may have gaps."""
    there = np.flatnonzero(np.isfinite(y))
    if there.size == 0:
        return LineEnd(float(x[-1]), np.nan, np.nan, label, line_style)
    return LineEnd(
        float(x[there[-1]]), float(y[there[-1]]), float(np.nanmean(y[-(y.size // _WAY) - 1 :])), label, line_style
    )


def minimum_panel_height(count: int) -> float:
    """Least height of a panel, inches, beside which so many names stand."""
    return count * END_FONT_SIZE * _PITCH / 72.0


def label_line_ends(axes: "Axes", line_ends: Sequence[LineEnd], height: float) -> None:
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
    inside = [end for end in line_ends if np.isfinite(end.y)]
    if not inside:
        return
    # from the data to the part of the axes' height, whatever the scale
    to_part = axes.transScale + axes.transLimits
    wanted = np.array([to_part.transform((end.x, end.y))[1] for end in inside])
    gap = END_FONT_SIZE * _PITCH / 72.0 / height
    before = np.array([end.approach_y for end in inside])
    order = np.lexsort((before, np.round(wanted / gap)))  # by the last key first
    places = spread_positions(np.maximum.accumulate(wanted[order]), gap)
    for k, place in zip(order, places, strict=True):
        end = inside[k]
        axes.annotate(
            end.label,
            (end.x, end.y),
            xytext=(_AWAY, place),
            textcoords="axes fraction",
            color=end.line_style.color,
            fontsize=END_FONT_SIZE,
            va="center",
            ha="left",
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": end.line_style.color,
                "linestyle": end.line_style.dashes,
                "linewidth": 0.8,
                "shrinkA": 0.5,
                "shrinkB": 0.0,
            },
        )


def spread_positions(target_positions: np.ndarray, gap: float) -> np.ndarray:
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
    for k, value in enumerate(target_positions):
        groups.append([float(value) - k * gap, 1.0])
        while len(groups) > 1 and groups[-2][0] >= groups[-1][0]:
            (one, n), (other, m) = groups[-2:]
            groups[-2:] = [[(one * n + other * m) / (n + m), n + m]]
    even = np.concatenate([np.full(int(n), value) for value, n in groups])
    room = 1.0 - gap * (len(target_positions) - 1)
    return np.clip(even, min(0.0, room / 2.0), max(room, room / 2.0)) + gap * np.arange(len(target_positions))
