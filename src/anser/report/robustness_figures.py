"""Figures of a robustness study: success, errors that are left, and what each factor alone breaks."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.style import MAP_STYLE, save_drawings
from anser.results.robustness_statistics import FirstBreak, first_breaks, flights_in_part, success

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_STYLE = {
    **MAP_STYLE,
    "svg.hashsalt": "anser-robustness",
    "axes.spines.top": False,
    "axes.spines.right": False,
}
_COLORS = {"model": "#0072b2", "incremental": "#d55e00"}
"""Okabe and Ito's blue and vermilion, which colour-blind readers can tell apart."""
_WORDS = {"model": "model-based", "incremental": "incremental"}
_CHANNELS = (
    ("airspeed_final_error_max_m_s", "airspeed (m/s)", "tolerance_airspeed_m_s"),
    ("path_angle_final_error_max_deg", "path angle (deg)", "tolerance_path_angle_deg"),
    ("course_final_error_max_deg", "course (deg)", "tolerance_course_deg"),
)
_PERCENT = 100.0
_WIDTH_MIN = 0.1  # change shown either way, however little is stood


def draw_robustness(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a study as SVG and PNG files: `success`, `errors`, and of a sweep also `spread` and `alone`.

    Parameters
    ----------
    dataset
        As `anser.analysis.robustness` makes it; what a part of the study shows is drawn where it was flown.
    folder
        To write into; returns the paths of its new files.
    """
    drawings = {
        "success": ("dispersed", _by_condition),
        "errors": ("dispersed", _errors),
        "spread": ("spread", _against_spread),
        "alone": ("alone", _alone),
    }
    flown = {name: draw for name, (part, draw) in drawings.items() if flights_in_part(dataset, part).any()}
    return save_drawings(flown, dataset, _STYLE, folder)


def _figure(dataset: xr.Dataset, title: str, size: tuple[float, float]) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    of = dataset.attrs
    figure.suptitle(f"{title}\n{of['aircraft']} {of['variant']}, command {of['command']}", fontsize=10)
    return figure


def _rates(axes: "Axes", dataset: xr.Dataset, at: np.ndarray, groups: list[np.ndarray], apart: float) -> None:
    """Success with its interval at each place, both inversions side by side."""
    for k, inversion in enumerate(dataset["inversion"].values):
        found = [success(dataset, str(inversion), chosen) for chosen in groups]
        share = np.array([one.share for one in found])
        bars = np.array([[one.share - one.low for one in found], [one.high - one.share for one in found]])
        axes.errorbar(
            at + (k - 0.5) * apart,
            _PERCENT * share,
            yerr=_PERCENT * np.where(np.isnan(bars), 0.0, bars),
            fmt="o",
            ms=4,
            capsize=3,
            color=_COLORS[str(inversion)],
            label=_WORDS[str(inversion)],
        )
    axes.set_ylabel("success (percent, interval of 95 %)")
    axes.grid(axis="y", color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_ylim(min(axes.get_ylim()[0], 89.0), 101.0)
    axes.legend(frameon=False, loc="lower left")


def _by_condition(dataset: xr.Dataset) -> "Figure":
    main = flights_in_part(dataset, "dispersed")
    places = dataset["condition_meaning"].values.tolist()
    figure = _figure(dataset, f"Everything dispersed by {dataset.attrs['spread_percent']:g} %", (7.0, 3.6))
    axes = figure.subplots()
    condition = dataset["condition"].values
    groups = [main, *(main & (condition == k) for k in range(len(places)))]
    labels = ["all", *(place.replace(", ", "\n") for place in places)]
    axes.set_xticks(np.arange(len(groups)), labels)
    _rates(axes, dataset, np.arange(len(groups), dtype=float), groups, 0.2)
    axes.set_xlabel("steady flight that is left")
    return figure


def _against_spread(dataset: xr.Dataset) -> "Figure":
    part, spread = flights_in_part(dataset, "spread"), dataset["spread_percent"].values
    levels = np.unique(spread[part])
    figure = _figure(dataset, "Success against the spread of everything", (6.0, 3.6))
    axes = figure.subplots()
    _rates(axes, dataset, levels, [part & (spread == level) for level in levels], 1.0)
    axes.set_xticks(levels)
    axes.set_xlabel("greatest change of every factor (percent)")
    return figure


def _errors(dataset: xr.Dataset) -> "Figure":
    main = flights_in_part(dataset, "dispersed")
    figure = _figure(dataset, "Largest error in the last tenth of the flight", (9.0, 3.2))
    panels = figure.subplots(1, len(_CHANNELS), sharey=True)
    for axes, (name, words, limit) in zip(panels, _CHANNELS, strict=True):
        for inversion in dataset["inversion"].values:
            error = dataset[name].sel(inversion=inversion).values[main]
            error = np.sort(error[np.isfinite(error)])
            part = _PERCENT * np.arange(1, len(error) + 1) / max(len(error), 1)
            axes.step(error, part, where="post", color=_COLORS[str(inversion)], label=_WORDS[str(inversion)])
        axes.axvline(dataset.attrs[limit], color="#595959", linewidth=0.8, linestyle="--", label="tolerance")
        axes.set_xscale("log")
        axes.set_xlabel(words)
        axes.grid(color="#e6e6e6", linewidth=0.6)
    panels[0].set_ylabel("flights with less (percent)")
    panels[0].legend(frameon=False, loc="upper left")
    return figure


def _alone(dataset: xr.Dataset) -> "Figure":
    """Bars up to the largest change that nothing breaks, the factors that break soonest at the top.

    Factors that break nothing have no bars and are named below.
    """
    breaks = first_breaks(dataset)
    inversions = [str(name) for name in dataset["inversion"].values]

    def soonest(factor: str) -> tuple[float, float]:
        of = [abs(b.change) if b.reason else np.inf for b in breaks if b.factor == factor]
        return min(of), float(np.mean([min(change, 10.0) for change in of]))

    unbroken = [name for name in dict.fromkeys(b.factor for b in breaks) if not np.isfinite(soonest(name)[0])]
    factors = sorted({b.factor for b in breaks} - set(unbroken), key=lambda name: (soonest(name), name), reverse=True)
    breaks = [b for b in breaks if b.factor in factors]
    figure = _figure(dataset, "One factor changed alone, at every condition", (9.0, 2.0 + 0.32 * len(factors)))
    axes = figure.subplots()
    height = 0.8 / len(inversions)
    for b in breaks:
        middle = factors.index(b.factor) + height * (inversions.index(b.inversion) - (len(inversions) - 1) / 2)
        # the first inversion stands above the second
        middle = 2 * factors.index(b.factor) - middle
        _bar(axes, b, middle, height)
    axes.axvline(0.0, color="#595959", linewidth=0.8)
    axes.set_yticks(range(len(factors)), [_named(dataset, name) for name in factors])
    axes.set_ylim(-0.6, len(factors) - 0.4)
    stood = [abs(b.survived if b.reason else b.change) for b in breaks]
    largest = _PERCENT * max([_WIDTH_MIN, *stood])
    axes.set_xlim(-1.6 * largest, 1.6 * largest)
    lines = [
        "change (percent) that all flights stand; beside it the next change flown, what it ends in, where (m/s, m)",
        "cross: nothing breaks up to here",
    ]
    if unbroken:
        lines += textwrap.wrap("nothing breaks, either way: " + ", ".join(n.replace("_", " ") for n in unbroken), 130)
    axes.set_xlabel("\n".join(lines))
    from matplotlib.patches import Patch

    handles = [Patch(color=_COLORS[name], label=_WORDS[name]) for name in inversions]
    axes.legend(handles=handles, frameon=False, loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0))
    return figure


def _bar(axes: "Axes", b: FirstBreak, middle: float, height: float) -> None:
    stood = b.change if b.reason is None else b.survived
    axes.barh(middle, _PERCENT * stood, height=0.9 * height, color=_COLORS[b.inversion])
    if b.reason is None:
        axes.plot(_PERCENT * stood, middle, marker="x", color="#595959", ms=3)
        return
    place = (b.condition or "").replace(" m/s", "").replace(" m", "")
    axes.annotate(
        f"{_PERCENT * b.change:+.0f} %: {b.reason.replace('_', ' ')} ({place})",
        (_PERCENT * stood, middle),
        xytext=(3 * b.sign, 0),
        textcoords="offset points",
        ha="left" if b.sign > 0 else "right",
        va="center",
        fontsize=5.5,
    )


def _named(dataset: xr.Dataset, factor: str) -> str:
    """Name of a factor, with what 100 % mean where that is not the factor itself."""
    of = dataset.sel(factor=factor)
    scale, unit = float(of["factor_scale"]), str(of["factor_unit"].item())
    words = factor.replace("_", " ")
    if float(of["factor_nominal"]) != 0.0:
        return words
    return f"{words} (100 %: {scale:g} {'chord' if unit == '1' else unit})"
