"""Figure of a campaign: how surely by now, how the worst of each flight is distributed, and against what varied."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.print_style import PRINT_STYLE, SMALL, line_of, new_figure, save_drawings
from anser.results import order_statistic_interval, wilson_interval
from anser.results.flight_columns import of_this_fleet, worst_of_fleet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-campaign"}
_QUANTITIES = {"miss_m": ("greatest miss", "m"), "arrival_spread_s": ("arrival spread", "s")}
_MILLISECONDS_BELOW_S = 0.01
_ONE_END = "the 95 % point is at least this;\ntoo few flights met all for an upper end"
_ACROSS_MAX = 6
"""Inputs that flights are drawn against at most."""
_POINTS = 200
"""Numbers of flights at which the convergence is drawn."""
_MANY = 5_000
"""Flights of which more are drawn as pixels, or the figure as SVG would be too large."""
_ENOUGH = 2
"""Flights that there is something to draw of."""


def draw_campaign(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a campaign as SVG and PNG files `campaign`, which take the place of former ones.

    Parameters
    ----------
    dataset
        From `anser.campaigns.CampaignStore.dataset`; with the attributes `varied`, `confidence` and `title`.
    folder
        To write into; returns the paths of its files, none of fewer than two flights.
    """
    if dataset.sizes["flight"] < _ENOUGH:
        return ()
    return save_drawings({"campaign": _drawn}, dataset, _STYLE, folder, overwrite=True)


def _drawn(dataset: xr.Dataset) -> "Figure":
    across = [path for path in json.loads(dataset.attrs["varied"]) if dataset[path].dtype.kind in "fiu"][:_ACROSS_MAX]
    rows = 1 + -(-len(across) // 3)
    _, figure = new_figure((9.6, 2.9 * rows + 0.5))
    axes = figure.subplots(rows, 3, squeeze=False)
    _draw_convergence(axes[0, 0], dataset)
    shown = of_this_fleet(_QUANTITIES, dataset)
    for place, name in zip(axes[0, 1:], shown, strict=False):
        _draw_distribution(place, dataset, name, *_QUANTITIES[name])
    for place in axes[0, 1 + len(shown) :]:
        place.set_visible(False)
    places = axes[1:].ravel() if rows > 1 else np.empty(0, dtype=object)
    for place, path in zip(places, across, strict=False):
        _draw_against(place, dataset, path)
    for place in places[len(across) :]:
        place.set_visible(False)
    figure.suptitle(f"{dataset.attrs['title']}: {dataset.sizes['flight']} flights", fontsize=SMALL + 2)
    return figure


def _draw_convergence(axes: "Axes", dataset: xr.Dataset) -> None:
    """Share of the flights that met every requirement, with its interval, against how many were flown."""
    met = dataset["met"].values
    counts = np.unique(np.linspace(1, met.size, min(met.size, _POINTS)).round().astype(int))
    successes = np.cumsum(met)[counts - 1]
    confidence = float(dataset.attrs["confidence"])
    pairs = zip(successes.tolist(), counts.tolist(), strict=True)
    ends = np.array([wilson_interval(one, count, confidence) for one, count in pairs])
    color = line_of(0)["color"]
    axes.fill_between(counts, 100 * ends[:, 0], 100 * ends[:, 1], alpha=0.2, color=color, linewidth=0)
    axes.plot(counts, 100 * successes / counts, color=color)
    axes.set_xlabel("flights")
    axes.set_ylabel(f"meet every requirement (%),\nand the interval at {100 * confidence:g} %")


def _draw_distribution(axes: "Axes", dataset: xr.Dataset, name: str, words: str, unit: str) -> None:
    """Share of the flights below each value; the 95 % point with its interval. Failures are never below."""
    values = worst_of_fleet(dataset, name)
    if unit == "s" and np.all(values[np.isfinite(values)] < _MILLISECONDS_BELOW_S):
        values, unit = 1000.0 * values, "ms"
    ordered = np.sort(values)
    shares = 100.0 * np.arange(1, ordered.size + 1) / ordered.size
    known = np.isfinite(ordered)
    axes.step(ordered[known], shares[known], where="post", color=line_of(0)["color"], rasterized=values.size > _MANY)
    low, high = order_statistic_interval(values, 0.95, float(dataset.attrs["confidence"]))
    ends = [end for end in (low, high) if np.isfinite(end)]
    label = "interval of the 95 % point" if len(ends) == 2 else _ONE_END
    for k, end in enumerate(ends):
        axes.axvline(end, color=line_of(1)["color"], linewidth=0.9, linestyle="--", label=None if k else label)
    axes.axhline(95.0, color="0.6", linewidth=0.7)
    axes.set_ylim(0.0, 102.0)
    axes.set_xlabel(f"{words} ({unit})")
    axes.set_ylabel("flights below (%)")
    axes.ticklabel_format(axis="x", style="plain")
    axes.locator_params(axis="x", nbins=5)
    if ends:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False, fontsize=SMALL)


def _draw_against(axes: "Axes", dataset: xr.Dataset, path: str) -> None:
    """Greatest miss of each flight against an input; those that failed are crosses, at the top without a miss."""
    x, y, met = dataset[path].values, worst_of_fleet(dataset, "miss_m"), dataset["met"].values
    known = np.isfinite(y)
    many = x.size > _MANY
    axes.plot(x[met & known], y[met & known], ".", markersize=3.0, color=line_of(0)["color"], rasterized=many)
    axes.plot(x[~met & known], y[~met & known], "x", markersize=5.0, color=line_of(1)["color"], rasterized=many)
    for value in x[~known]:
        axes.plot(value, 0.98, "x", markersize=5.0, color=line_of(1)["color"], transform=axes.get_xaxis_transform())
    axes.set_xlabel(path)
    axes.set_ylabel("greatest miss (m)")
    axes.ticklabel_format(style="plain")
    axes.locator_params(axis="x", nbins=5)
