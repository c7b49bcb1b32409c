"""Panels of a plan against time, with the limits of its scenario."""

import textwrap
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.aircraft_pens import Pen
from anser.report.labels import unit
from anser.report.limit_lines import CLOSED, limit_line
from anser.report.plan_map import named_pair
from anser.report.print_style import INK, QUIET, SMALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LABEL_WIDTH = 26
_FAR = 2.0  # a ceiling that is farther above the paths than so many times their range only has its number


def draw_over_time(
    axes: "Axes", dataset: xr.Dataset, pens: list[Pen], name: str, limits: tuple[str, ...], both: bool
) -> None:
    """Draw one variable of all aircraft, and its limits by their names without `limit_` (`both`: with either sign)."""
    _lines(axes, dataset, pens, name)
    values = [float(value) for limit in limits for value in np.unique(dataset[f"limit_{limit}"].values)]
    for value in [sign * value for value in values if np.isfinite(value) for sign in ((1.0, -1.0) if both else (1.0,))]:
        _limit(axes, value)
    axes.margins(y=0.08)


def draw_altitude(axes: "Axes", dataset: xr.Dataset, pens: list[Pen]) -> None:
    """Draw the altitudes, floor and ceiling; a ceiling far above is only told."""
    _lines(axes, dataset, pens, "altitude_m")
    floor, ceiling = (float(dataset[f"limit_altitude_{end}_m"].values[0]) for end in ("min", "max"))
    altitudes = dataset["altitude_m"].values
    highest = float(np.max(altitudes[np.isfinite(altitudes)], initial=floor))
    if np.isfinite(floor):
        _limit(axes, floor)
    if np.isfinite(ceiling):
        if ceiling - highest <= _FAR * (highest - floor):
            _limit(axes, ceiling)
        else:
            _annotate(axes, f"ceiling {ceiling:,.0f} m", 0.98)
            axes.set_ylim(top=highest + 0.22 * max(highest - floor, 1.0))
            return
    axes.margins(y=0.08)


def draw_separation(axes: "Axes", dataset: xr.Dataset) -> None:
    """Draw the least separation where one is asked for, else the least distance, and name the closest pair."""
    of = dataset.attrs
    asked = "separation_m" in dataset
    what, name = ("separation", "separation_m") if asked else ("distance", "distance_min_m")
    axes.set_ylabel(_label(dataset[name]))
    if dataset[f"least_{what}_pair"].values[0] < 0:
        axes.set_yticks([])
        _annotate(axes, "a single aircraft", 0.55)
        return
    times = dataset["time"].values
    axes.set_yscale("log")
    axes.plot(times, dataset[name].values, color=INK, linewidth=1.3)
    shown = [dataset[name].values]
    if asked:
        _limit(axes, of["separation_horizontal_m"])
    if "distance_limit_m" in of:
        if asked:
            axes.plot(times, dataset["distance_min_m"].values, color=QUIET, linewidth=0.9, label="in space")
            shown.append(dataset["distance_min_m"].values)
            axes.legend(loc="lower left")
        _limit(axes, of["distance_limit_m"])
    least, at = dataset[f"least_{what}_m"].item(), dataset[f"least_{what}_at_s"].item()
    axes.plot([at], [least], "x", color=INK, markersize=5, mew=1.2, clip_on=False)
    level, height = (dataset[f"least_{what}_{part}_m"].item() for part in ("level", "height"))
    one, other = named_pair(dataset, what) or ("", "")
    axes.set_title(
        f"closest: {one} and {other} at {at:.1f} s, {level:,.0f} m in the plane, {height:,.0f} m in altitude",
        fontsize=SMALL,
        loc="left",
        pad=3.0,
    )
    if asked and of["separation_vertical_m"] > 0.0:
        words = f"{of['separation_vertical_m']:g} m in altitude count as {of['separation_horizontal_m']:g} m"
        _annotate(axes, words, 0.97)
    _decades(axes, np.concatenate(shown))


def _decades(axes: "Axes", values: np.ndarray) -> None:
    """Plain numbers at the ticks of a logarithmic axis, with room above for words."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    axes.set_ylim(low * 0.9, max(high, 1.6 * float(np.nanmax(values))))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _lines(axes: "Axes", dataset: xr.Dataset, pens: list[Pen], name: str) -> None:
    times, values = dataset["time"].values, dataset[name].values
    for pen in pens:
        axes.plot(times, values[:, pen.index], color=pen.color, linestyle=pen.dashes, linewidth=pen.width, zorder=3)
        end = np.flatnonzero(np.isfinite(values[:, pen.index]))[-1]
        axes.plot(
            times[end],
            values[end, pen.index],
            "D",
            color=pen.color,
            markersize=3.0 + pen.width,
            zorder=4,
            clip_on=False,
        )
    axes.set_ylabel(_label(dataset[name]))


def _limit(axes: "Axes", value: float) -> None:
    limit_line(axes, value)
    axes.annotate(
        f"{value:,.6g}".replace("-", "\u2212"),
        (1.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(8, 0),
        textcoords="offset points",
        va="center",
        color=CLOSED,
        fontsize=SMALL,
    )


def _annotate(axes: "Axes", words: str, height: float) -> None:
    axes.text(0.99, height, words, transform=axes.transAxes, ha="right", va="top", color=QUIET, fontsize=SMALL)


def _label(values: xr.DataArray) -> str:
    return textwrap.fill(f"{values.attrs['long_name']} ({unit(values)})", _LABEL_WIDTH)
