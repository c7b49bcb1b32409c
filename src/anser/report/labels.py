"""Labels in figures and pages: of variables, limits, positions on a map, and line ends."""

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


_PRINTED_UNITS = {
    "m s-1": "m/s",
    "m s-2": "m/s²",
    "m s-4": "m/s⁴",
    "degree": "°",
    "degree s-1": "°/s",
    "percent": "%",
    "1": "",
}
_LINE_LENGTH, _SYMBOL_LENGTH = 26, 8
"""Characters per line of a label, and the number of these that a symbol with its unit needs."""
_KILOMETRES_FROM_M = 10_000.0


def printed_unit(unit: str) -> str:
    """Return a unit of datasets as printed, such as "m/s" for "m s-1"; empty for the unit "1"."""
    return _PRINTED_UNITS.get(unit, unit)


def html_label(values: xr.DataArray) -> dict[str, str]:
    """Return the parts of a variable's label: `words` (long name), `unit` as printed, `symbol` as HTML."""
    base, _, subscript = html.escape(str(values.attrs["symbol"])).partition("_")
    return {
        "words": str(values.attrs["long_name"]),
        "unit": printed_unit(str(values.attrs["units"])),
        "symbol": f"<i>{base}</i>" + (f"<sub>{subscript}</sub>" if subscript else ""),
    }


def axis_label(
    values: xr.DataArray, name: str | None = None, unit: str | None = None, length: int = _LINE_LENGTH
) -> str:
    """Return an axis label: `name` (None: long name) in lines of at most `length` characters, symbol, and unit."""
    lines = textwrap.wrap(str(values.attrs["long_name"]) if name is None else name, length)
    printed = display_unit(values) if unit is None else unit
    symbol = math_symbol(values) + (f" ({printed})" if printed else "")
    # the symbol continues the last line if it fits
    label, separator = "\n".join(lines), " " if len(lines[-1]) <= length - _SYMBOL_LENGTH else "\n"
    return f"{label}{separator}{symbol}"


def axis_scale(values: xr.DataArray, magnitude: float) -> tuple[float, str]:
    """Return the factor from a variable's unit to the unit of the axis, and the unit of the axis as printed.

    The axis of a variable in m is in km if `magnitude`, the greatest absolute value, is 10,000 m or more.
    """
    if str(values.attrs["units"]) == "m" and magnitude >= _KILOMETRES_FROM_M:
        return 1e-3, "km"
    return 1.0, display_unit(values)


def math_symbol(values: xr.DataArray) -> str:
    """Return a variable's symbol as mathematical text for matplotlib, with the letters after "_" as subscript."""
    base, _, subscript = str(values.attrs["symbol"]).partition("_")
    return f"${base}_{{{subscript}}}$" if subscript else f"${base}$"


def display_unit(values: xr.DataArray) -> str:
    """Return the unit of a variable as printed, such as "m/s" or "°"; empty for a dimensionless variable."""
    return printed_unit(str(values.attrs["units"]))


def aircraft_title(dataset: xr.Dataset) -> str:
    """Return the aircraft's name and, if present, its variant, from the attributes of a survey's dataset."""
    return " ".join(str(dataset.attrs[key]) for key in ("aircraft", "variant") if key in dataset.attrs)


def escape_mathtext(text: object) -> str:
    """Return a text with its dollar signs escaped, so that matplotlib does not read a formula."""
    return str(text).replace("$", r"\$")


LIMIT_COLOR = "#b3261e"
"""Colour of limits and keep-outs in figures."""
_DATA_HEIGHT_MIN = 0.2  # least share of the panel's height for the data when the axis extends to a limit
_LIMIT_LABEL_HEIGHT = 0.13  # relative to the panel's height
_OWNERS_MAX = 3  # greatest number of aircraft that are listed


@dataclass(frozen=True)
class Limit:
    """A limit of one or more aircraft, to be drawn as a labelled line."""

    value: float  # in the unit of the axis
    is_upper: bool
    label: str


def format_owners(names: Sequence[str], fleet_size: int) -> str:
    """Return the names of the aircraft that a limit concerns, as text; empty if the limit concerns the whole fleet.

    More than `_OWNERS_MAX` names are shortened, as in "a, b and 5 more".
    """
    if len(names) == fleet_size:
        return ""
    if len(names) <= _OWNERS_MAX:
        return ", ".join(names)
    return f"{', '.join(names[: _OWNERS_MAX - 1])} and {len(names) - _OWNERS_MAX + 1} more"


def draw_limit_line(axes: "Axes", value: float) -> None:
    """Draw a dashed horizontal line across a panel at the value of a limit."""
    axes.axhline(value, color=LIMIT_COLOR, linestyle=DASHED, linewidth=1.0, zorder=2)


def draw_labelled_limit(axes: "Axes", limit: Limit, *, right: bool = False) -> None:
    """Draw a limit line with a label at the left or right end, on the side beyond the limit."""
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


def draw_limits(axes: "Axes", limits: Sequence[Limit], data_range: tuple[float, float]) -> list[Limit]:
    """Draw limits, nearest first, and extend the axis to each limit; return the limits that are not drawn.

    `data_range` is the least and greatest value of the data. A limit is not drawn if the data would then take less than
    the fraction `_DATA_HEIGHT_MIN` of the axis.
    """
    hidden: list[Limit] = []
    label_counts = {True: 0, False: 0}
    low, high = axes.get_ylim()
    size = data_range[1] - data_range[0]
    for limit in sorted(limits, key=lambda limit: max(data_range[0] - limit.value, limit.value - data_range[1])):
        extended = min(low, limit.value), max(high, limit.value)
        if size < _DATA_HEIGHT_MIN * (extended[1] - extended[0]):
            hidden.append(limit)
            continue
        low, high = extended
        # alternate sides: neighbouring limits may be close
        draw_labelled_limit(axes, limit, right=label_counts[limit.is_upper] % 2 == 1)
        label_counts[limit.is_upper] += 1
    label_height = _LIMIT_LABEL_HEIGHT * (high - low)
    visible_limits = [limit for limit in limits if limit not in hidden]
    axes.set_ylim(
        min([low, *(limit.value - label_height for limit in visible_limits if not limit.is_upper)]),
        max([high, *(limit.value + label_height for limit in visible_limits if limit.is_upper)]),
    )
    return hidden


NAMES_MAX = 40
"""Greatest number of names in a figure; with more aircraft, no names are written."""
MARKER_SIZE = 0.6
"""Size of a marker on a map, relative to the size of a label, for `clear_direction`."""
_OFFSET, _SLANT = 9.0, 0.3  # points; least sine for an alignment to a side
_LABEL_SIZE = (0.16, 0.045)  # width and height of a label relative to the map


def annotate_position(
    axes: "Axes",
    label: str,
    position: np.ndarray,
    towards: tuple[float, float],
    color: str,
    points: float,  # font size
) -> None:
    """Write a label beside a position on a map, on the side of the unit vector `towards` (right, up)."""
    side, up = towards
    axes.annotate(
        label,
        (float(position[0]), float(position[1])),
        xytext=(_OFFSET * side, _OFFSET * up),
        textcoords="offset points",
        color=color,
        fontsize=points,
        ha="left" if side > _SLANT else "right" if side < -_SLANT else "center",
        va="bottom" if up > _SLANT else "top" if up < -_SLANT else "center",
        bbox={"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.4},  # a halo would turn text into paths
        zorder=8,
    )


def unit_vector(vector: np.ndarray) -> tuple[float, float]:
    """Return the unit vector in the direction of a plane vector; (0, 0) for the zero vector."""
    x, y = vector / max(float(np.hypot(*vector)), 1e-12)
    return float(x), float(y)


def clear_direction(
    position: np.ndarray, towards: tuple[float, float], extent: float, occupied: list[tuple[np.ndarray, float]]
) -> tuple[float, float]:
    """Return the direction, a unit vector (right, up), from a position on a map to its label.

    Eight directions are tried: `towards`, and directions at multiples of 45 deg from it. The result is the one nearest
    to `towards` in which the label overlaps no area in `occupied`; `towards` if there is none. `extent` is the greatest
    extent of the map. `occupied` lists areas as (centre, size relative to a label); the label's own area is appended.
    """
    azimuth = np.arctan2(towards[1], towards[0])
    turns = np.radians([0, 45, -45, 90, -90, 135, -135, 180])
    sides = [(float(np.cos(azimuth + turn)), float(np.sin(azimuth + turn))) for turn in turns]
    box = extent * np.array(_LABEL_SIZE)
    centres = [position + box * np.array([0.75 * side, 0.9 * up]) for side, up in sides]
    is_clear = [
        all(np.any(np.abs(centre - occupied_centre) > size * box) for occupied_centre, size in occupied)
        for centre in centres
    ]
    k = is_clear.index(True) if True in is_clear else 0
    occupied.append((centres[k], 1.0))
    return sides[k]


END_FONT_SIZE = 6.0
"""Font size of the names at line ends, points."""
_LINE_PITCH = 1.15  # distance of text lines relative to the font size
_NAME_POSITION = 1.07  # left edge of the names relative to the panel's width
_APPROACH_DIVISOR = 4  # the last quarter of a line is its approach


@dataclass(frozen=True)
class LineEnd:
    """End of a line in a panel, with the name to be written there."""

    x: float  # data coordinates
    y: float
    approach_y: float  # mean of the line's last quarter, which orders the names of lines with equal ends
    label: str  # name
    line_style: LineStyle


def find_line_end(x: np.ndarray, y: np.ndarray, label: str, line_style: LineStyle) -> LineEnd:
    """Return the end of a line at its last finite sample; y is NaN if no sample is finite."""
    finite = np.flatnonzero(np.isfinite(y))
    if finite.size == 0:
        return LineEnd(float(x[-1]), np.nan, np.nan, label, line_style)
    approach_y = float(np.nanmean(y[-(y.size // _APPROACH_DIVISOR) - 1 :]))
    return LineEnd(float(x[finite[-1]]), float(y[finite[-1]]), approach_y, label, line_style)


def minimum_panel_height(count: int) -> float:
    """Return the least height of a panel, inches, with room for `count` names beside the panel."""
    return count * END_FONT_SIZE * _LINE_PITCH / 72.0


def label_line_ends(axes: "Axes", line_ends: Sequence[LineEnd], height: float) -> None:
    """Write the names of lines at the right of a panel, connected to the line ends, without overlap.

    The limits of `axes` must be final; `height` is the approximate height of the panel, inches.
    """
    inside = [end for end in line_ends if np.isfinite(end.y)]
    if not inside:
        return
    # valid for linear and logarithmic axes
    to_axes_fraction = axes.transScale + axes.transLimits
    end_heights = np.array([to_axes_fraction.transform((end.x, end.y))[1] for end in inside])
    gap = END_FONT_SIZE * _LINE_PITCH / 72.0 / height
    approach_heights = np.array([end.approach_y for end in inside])
    order = np.lexsort((approach_heights, np.round(end_heights / gap)))  # the last key has priority
    name_heights = spread_positions(np.maximum.accumulate(end_heights[order]), gap)
    for k, name_height in zip(order, name_heights, strict=True):
        end = inside[k]
        axes.annotate(
            end.label,
            (end.x, end.y),
            xytext=(_NAME_POSITION, name_height),
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
    """Return the positions, 0..1 and at least `gap` apart, that are nearest to the targets (least squares).

    Targets must increase. If the range is too small, the positions exceed 0 and 1 by equal amounts.
    """
    # isotonic regression: less the gaps, positions must not decrease; pool adjacent violators to their mean
    groups: list[list[float]] = []
    for k, value in enumerate(target_positions):
        groups.append([float(value) - k * gap, 1.0])
        while len(groups) > 1 and groups[-2][0] >= groups[-1][0]:
            (mean_below, count_below), (mean_above, count_above) = groups[-2:]
            count = count_below + count_above
            groups[-2:] = [[(mean_below * count_below + mean_above * count_above) / count, count]]
    ordered = np.concatenate([np.full(int(count), mean) for mean, count in groups])
    highest = 1.0 - gap * (len(target_positions) - 1)
    clipped = np.clip(ordered, min(0.0, highest / 2.0), max(highest, highest / 2.0))
    return clipped + gap * np.arange(len(target_positions))
