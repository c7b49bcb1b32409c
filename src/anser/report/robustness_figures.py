"""Figures of a robustness study: success rates, final errors, and failures due to a change of one factor alone."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.style import MAP_STYLE, new_figure, save_drawings
from anser.results.robustness_statistics import FirstBreak, first_breaks, flights_in_part, success

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_STYLE = {**MAP_STYLE, "svg.hashsalt": "anser-robustness", "axes.spines.top": False, "axes.spines.right": False}
_COLORS = {"model": "#0072b2", "incremental": "#d55e00", "adaptive": "#009e73"}
"""Colour of each type of inversion: Okabe and Ito's blue, vermilion and green, also for colour-blind readers."""
_INVERSION_NAMES = {"model": "model-based", "incremental": "incremental", "adaptive": "adaptive"}
_CHANNELS = (
    ("airspeed_final_error_max_m_s", "airspeed (m/s)", "tolerance_airspeed_m_s"),
    ("path_angle_final_error_max_deg", "path angle (deg)", "tolerance_path_angle_deg"),
    ("course_final_error_max_deg", "course (deg)", "tolerance_course_deg"),
)
_PERCENT = 100.0
_CHANGE_RANGE_MIN = 0.1  # least half-width of the axis


def draw_robustness(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a robustness study into new files `success`, `errors`, `spread` and `alone`, SVG and PNG; return the paths.

    `dataset` must be a result of `anser.analysis.robustness`. A part of the study that was not flown has no figure.
    Raises FileExistsError if one of the files exists.
    """
    drawings = {
        "success": ("dispersed", _success_by_condition),
        "errors": ("dispersed", _error_distributions),
        "spread": ("spread", _success_by_spread),
        "alone": ("alone", _single_factors),
    }
    flown = {name: draw for name, (part, draw) in drawings.items() if flights_in_part(dataset, part).any()}
    return save_drawings(flown, dataset, _STYLE, folder)


def _figure(dataset: xr.Dataset, title: str, size: tuple[float, float]) -> "Figure":
    _, figure = new_figure(size)
    attributes = dataset.attrs
    figure.suptitle(
        f"{title}\n{attributes['aircraft']} {attributes['variant']}, command {attributes['command']}", fontsize=10
    )
    return figure


def _draw_success(
    axes: "Axes", dataset: xr.Dataset, positions: np.ndarray, groups: list[np.ndarray], offset: float
) -> None:
    for k, inversion in enumerate(map(str, dataset["inversion"].values)):
        rates = [success(dataset, inversion, group) for group in groups]
        share = np.array([rate.share for rate in rates])
        error_bars = np.array([[rate.share - rate.low for rate in rates], [rate.high - rate.share for rate in rates]])
        x, yerr = positions + (k - (dataset.sizes["inversion"] - 1) / 2) * offset, _PERCENT * np.nan_to_num(error_bars)
        look: dict[str, Any] = {"color": _COLORS[inversion], "label": _INVERSION_NAMES[inversion]}
        axes.errorbar(x, _PERCENT * share, yerr=yerr, fmt="o", ms=4, capsize=3, **look)
    axes.set_ylabel("success (percent, interval of 95 %)")
    axes.grid(axis="y", color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_ylim(min(axes.get_ylim()[0], 89.0), 101.0)
    axes.legend(frameon=False, loc="lower left")


def _success_by_condition(dataset: xr.Dataset) -> "Figure":
    is_dispersed = flights_in_part(dataset, "dispersed")
    conditions = dataset["condition_meaning"].values.tolist()
    figure = _figure(dataset, f"Everything dispersed by {dataset.attrs['spread_percent']:g} %", (7.0, 3.6))
    axes = figure.subplots()
    condition = dataset["condition"].values
    groups = [is_dispersed, *(is_dispersed & (condition == k) for k in range(len(conditions)))]
    labels = ["all", *(name.replace(", ", "\n") for name in conditions)]
    axes.set_xticks(np.arange(len(groups)), labels)
    _draw_success(axes, dataset, np.arange(len(groups), dtype=float), groups, 0.2)
    axes.set_xlabel("steady flight that is left")
    return figure


def _success_by_spread(dataset: xr.Dataset) -> "Figure":
    part, spread = flights_in_part(dataset, "spread"), dataset["spread_percent"].values
    levels = np.unique(spread[part])
    figure = _figure(dataset, "Success against the spread of everything", (6.0, 3.6))
    axes = figure.subplots()
    _draw_success(axes, dataset, levels, [part & (spread == level) for level in levels], 1.0)
    axes.set_xticks(levels)
    axes.set_xlabel("greatest change of every factor (percent)")
    return figure


def _error_distributions(dataset: xr.Dataset) -> "Figure":
    is_dispersed = flights_in_part(dataset, "dispersed")
    figure = _figure(dataset, "Largest error in the last tenth of the flight", (9.0, 3.2))
    panels = figure.subplots(1, len(_CHANNELS), sharey=True)
    for axes, (name, label, limit) in zip(panels, _CHANNELS, strict=True):
        for inversion in map(str, dataset["inversion"].values):
            error = dataset[name].sel(inversion=inversion).values[is_dispersed]
            is_flown = dataset["outcome"].sel(inversion=inversion).values[is_dispersed] > 0
            # A flight that diverged has no finite error: the curve ends below 100 percent.
            error = np.sort(error[is_flown & np.isfinite(error)])
            percentage = _PERCENT * np.arange(1, len(error) + 1) / max(np.sum(is_flown), 1)
            axes.step(error, percentage, where="post", color=_COLORS[inversion], label=_INVERSION_NAMES[inversion])
        axes.axvline(dataset.attrs[limit], color="#595959", linewidth=0.8, linestyle="--", label="tolerance")
        axes.set_xscale("log")
        axes.set_xlabel(label)
        axes.grid(color="#e6e6e6", linewidth=0.6)
    panels[0].set_ylabel("flights with less (percent)")
    panels[0].legend(frameon=False, loc="upper left")
    return figure


def _single_factors(dataset: xr.Dataset) -> "Figure":
    """Return a figure of bars: for each factor, the largest change up and down with which no flight fails.

    Factors that cause no failure are named below the figure.
    """
    breaks = first_breaks(dataset)
    inversions = [str(name) for name in dataset["inversion"].values]

    def failure_order(factor: str) -> tuple[float, float]:
        members = [first_break for first_break in breaks if first_break.factor == factor]
        changes = [abs(first_break.change) if first_break.reason else np.inf for first_break in members]
        return min(changes), float(np.mean([min(change, 10.0) for change in changes]))

    order = {name: failure_order(name) for name in dict.fromkeys(first_break.factor for first_break in breaks)}
    unbroken = [name for name, (smallest_change, _) in order.items() if not np.isfinite(smallest_change)]
    factors = sorted(set(order) - set(unbroken), key=lambda name: (order[name], name), reverse=True)
    breaks = [first_break for first_break in breaks if first_break.factor in factors]
    figure = _figure(dataset, "One factor changed alone, at every condition", (9.0, 2.0 + 0.32 * len(factors)))
    axes = figure.subplots()
    height = 0.8 / len(inversions)
    for first_break in breaks:
        # the first inversion stands above the second
        offset = height * (inversions.index(first_break.inversion) - (len(inversions) - 1) / 2)
        _draw_bar(axes, first_break, factors.index(first_break.factor) - offset, height)
    axes.axvline(0.0, color="#595959", linewidth=0.8)
    axes.set_yticks(range(len(factors)), [_factor_label(dataset, name) for name in factors])
    axes.set_ylim(-0.6, len(factors) - 0.4)
    withstood = [abs(first_break.survived if first_break.reason else first_break.change) for first_break in breaks]
    largest = _PERCENT * max([_CHANGE_RANGE_MIN, *withstood])
    axes.set_xlim(-1.6 * largest, 1.6 * largest)
    lines = [
        "change (percent) that all flights stand; beside it the next change flown, what it ends in, where (m/s, m)",
        "cross: nothing breaks up to here",
    ]
    if unbroken:
        lines += textwrap.wrap("nothing breaks, either way: " + ", ".join(n.replace("_", " ") for n in unbroken), 130)
    axes.set_xlabel("\n".join(lines))
    from matplotlib.patches import Patch

    handles = [Patch(color=_COLORS[name], label=_INVERSION_NAMES[name]) for name in inversions]
    axes.legend(handles=handles, frameon=False, loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0))
    return figure


def _draw_bar(axes: "Axes", first_break: FirstBreak, middle: float, height: float) -> None:
    withstood = first_break.change if first_break.reason is None else first_break.survived
    axes.barh(middle, _PERCENT * withstood, height=0.9 * height, color=_COLORS[first_break.inversion])
    if first_break.reason is None:
        axes.plot(_PERCENT * withstood, middle, marker="x", color="#595959", ms=3)
        return
    condition = (first_break.condition or "").replace(" m/s", "").replace(" m", "")
    axes.annotate(
        f"{_PERCENT * first_break.change:+.0f} %: {first_break.reason.replace('_', ' ')} ({condition})",
        (_PERCENT * withstood, middle),
        xytext=(3 * first_break.sign, 0),
        textcoords="offset points",
        ha="left" if first_break.sign > 0 else "right",
        va="center",
        fontsize=5.5,
    )


def _factor_label(dataset: xr.Dataset, factor: str) -> str:
    """Return the name of a factor; if the nominal value is 0, add the value that counts as a change of 100 %."""
    factor_data = dataset.sel(factor=factor)
    scale, unit = float(factor_data["factor_scale"]), str(factor_data["factor_unit"].item())
    name = factor.replace("_", " ")
    if float(factor_data["factor_nominal"]) != 0.0:
        return name
    return f"{name} (100 %: {scale:g} {'chord' if unit == '1' else unit})"
