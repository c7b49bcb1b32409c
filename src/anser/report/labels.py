"""Labels of figures and pages: variables, limits, positions on a map, ends of lines."""

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
"""Characters per line of a label, and how many of them are reserved for a symbol with its unit."""
_KILOMETRES_FROM_M = 10_000.0


def printed_unit(unit: str) -> str:
    """Return the unit as printed, from its name in datasets; empty for a number without a unit."""
    return _PRINTED_UNITS.get(unit, unit)


def html_label(values: xr.DataArray) -> dict[str, str]:
    """Return the label of a variable: `words` (long name), `unit` as text, and `symbol` as HTML with a subscript."""
    base, _, subscript = html.escape(str(values.attrs["symbol"])).partition("_")
    return {
        "words": str(values.attrs["long_name"]),
        "unit": printed_unit(str(values.attrs["units"])),
        "symbol": f"<i>{base}</i>" + (f"<sub>{subscript}</sub>" if subscript else ""),
    }


def axis_label(
    values: xr.DataArray, name: str | None = None, unit: str | None = None, length: int = _LINE_LENGTH
) -> str:
    """Return an axis label, wrapped to `length` characters: name (default: long name), symbol and unit."""
    lines = textwrap.wrap(str(values.attrs["long_name"]) if name is None else name, length)
    printed = display_unit(values) if unit is None else unit
    symbol = math_symbol(values) + (f" ({printed})" if printed else "")
    # the symbol continues the last line if it fits
    label, separator = "\n".join(lines), " " if len(lines[-1]) <= length - _SYMBOL_LENGTH else "\n"
    return f"{label}{separator}{symbol}"


def axis_scale(values: xr.DataArray, magnitude: float) -> tuple[float, str]:
    """Return the factor and unit of an axis for values up to `magnitude`: km instead of m from 10,000 m on."""
    if str(values.attrs["units"]) == "m" and magnitude >= _KILOMETRES_FROM_M:
        return 1e-3, "km"
    return 1.0, display_unit(values)


def math_symbol(values: xr.DataArray) -> str:
    """Return the symbol of a variable for matplotlib; the part after an underscore becomes a subscript."""
    base, _, subscript = str(values.attrs["symbol"]).partition("_")
    return f"${base}_{{{subscript}}}$" if subscript else f"${base}$"


def display_unit(values: xr.DataArray) -> str:
    """Return the unit of a variable as printed; empty for a number without a unit."""
    return printed_unit(str(values.attrs["units"]))


def aircraft_title(dataset: xr.Dataset) -> str:
    """Return the name of a survey's aircraft, with its variant if the survey has one."""
    return " ".join(str(dataset.attrs[key]) for key in ("aircraft", "variant") if key in dataset.attrs)


def escape_mathtext(text: object) -> str:
    """Return text from a file, escaped so that matplotlib does not read it as a formula."""
    return str(text).replace("$", r"\$")


LIMIT_COLOR = "#b3261e"
"""Colour of keep-outs and of limits."""
_DATA_HEIGHT_MIN = 0.2  # least share of the panel's height for the data when the axis extends to a limit
_LIMIT_LABEL_HEIGHT = 0.13  # relative to the panel's height
_OWNERS_MAX = 3  # greatest number of aircraft that are listed


@dataclass(frozen=True)
class Limit:
    """A limit of one or more aircraft, drawn as a labelled line in a panel; `value` is in the unit of the panel."""

    value: float
    is_upper: bool
    label: str


def format_owners(names: Sequence[str], fleet_size: int) -> str:
    """Return the names of the aircraft that a limit concerns; empty if it concerns the whole fleet.

    Of more than `_OWNERS_MAX` names, the last ones are replaced by their number.
    """
    if len(names) == fleet_size:
        return ""
    if len(names) <= _OWNERS_MAX:
        return ", ".join(names)
    return f"{', '.join(names[: _OWNERS_MAX - 1])} and {len(names) - _OWNERS_MAX + 1} more"


def draw_limit_line(axes: "Axes", value: float) -> None:
    """Draw a limit line."""
    axes.axhline(value, color=LIMIT_COLOR, linestyle=DASHED, linewidth=1.0, zorder=2)


def draw_labelled_limit(axes: "Axes", limit: Limit, *, right: bool = False) -> None:
    """Draw a limit line with its label at the left or right, on the forbidden side of the line."""
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
    """Draw limits, nearest first, and extend the linear axis to them while the data keep enough height.

    `data_range` is the range of the data in the panel. Returns the limits that are too far away and were not drawn.
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
"""Size of a marker on a map, relative to the size of a label."""
_OFFSET, _SLANT = 9.0, 0.3  # points; least sine for an alignment to a side
_LABEL_SIZE = (0.16, 0.045)  # width and height of a label relative to the map


def annotate_position(
    axes: "Axes", label: str, position: np.ndarray, towards: tuple[float, float], color: str, points: float
) -> None:
    """Write a label beside a position, on the side of the unit vector `towards`; `points` is the font size."""
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
    """Return the unit vector in the direction of a vector in the plane; (0, 0) for the zero vector."""
    x, y = vector / max(float(np.hypot(*vector)), 1e-12)
    return float(x), float(y)


def clear_direction(
    position: np.ndarray, towards: tuple[float, float], extent: float, occupied: list[tuple[np.ndarray, float]]
) -> tuple[float, float]:
    """Return the direction from a position in which a label is written, a unit vector.

    It is `towards`, or else the nearest of eight directions in which the label overlaps nothing; `towards` if none is
    clear. `extent` is the greatest extent of the map in its unit. `occupied` holds areas that the label must not
    overlap, as (centre, size relative to a label); the label is added.
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
    """End of a line in a panel, in data coordinates, and the name to be written there.

    Of lines with equal ends, the one with the higher `approach_y` (mean of its last part) is named above.
    """

    x: float
    y: float
    approach_y: float
    label: str
    line_style: LineStyle


def find_line_end(x: np.ndarray, y: np.ndarray, label: str, line_style: LineStyle) -> LineEnd:
    """Return the end of a line at its last finite sample."""
    finite = np.flatnonzero(np.isfinite(y))
    if finite.size == 0:
        return LineEnd(float(x[-1]), np.nan, np.nan, label, line_style)
    approach_y = float(np.nanmean(y[-(y.size // _APPROACH_DIVISOR) - 1 :]))
    return LineEnd(float(x[finite[-1]]), float(y[finite[-1]]), approach_y, label, line_style)


def minimum_panel_height(count: int) -> float:
    """Return the least height of a panel, inches, beside which `count` names have room."""
    return count * END_FONT_SIZE * _LINE_PITCH / 72.0


def label_line_ends(axes: "Axes", line_ends: Sequence[LineEnd], height: float) -> None:
    """Write names at the right of a panel, each close to the end of the line and connected to it, without overlap.

    `axes` has its final limits; `height` is its approximate height, inches.
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
    """Return positions from 0 to 1 with a least gap, nearest to increasing target positions in the least-squares sense.

    If the range is too small, the positions exceed it evenly on both sides.
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
