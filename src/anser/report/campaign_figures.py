"""Figures of many flights for print.

A campaign, two campaigns with paired seeds, the probability of a rare event, and a sweep.
"""

import itertools
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.style import PRINT_STYLE, SMALL, new_figure, save_drawings, series_style
from anser.results.flight_rows import applicable_quantities, worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, wilson_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_CAMPAIGN_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-campaign"}
_CAMPAIGN_QUANTITIES = {"miss_m": ("greatest miss", "m"), "arrival_spread_s": ("arrival spread", "s")}
_MILLISECONDS_BELOW_S = 0.01
_ONE_END = "the 95 % point is at least this;\ntoo few flights met all for an upper end"
_ACROSS_MAX = 6
"""Inputs that flights are drawn against at most."""
_CONVERGENCE_POINTS = 200
"""Numbers of flights at which the convergence is drawn."""
_MANY = 5_000
"""Flights of which more are drawn as pixels, or the figure as SVG would be too large."""
_FLIGHTS_MIN = 2
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
    if dataset.sizes["flight"] < _FLIGHTS_MIN:
        return ()
    return save_drawings({"campaign": _draw_campaign}, dataset, _CAMPAIGN_STYLE, folder, overwrite=True)


def _draw_campaign(dataset: xr.Dataset) -> "Figure":
    across = [path for path in json.loads(dataset.attrs["varied"]) if dataset[path].dtype.kind in "fiu"][:_ACROSS_MAX]
    rows = 1 + -(-len(across) // 3)
    _, figure = new_figure((9.6, 2.9 * rows + 0.5))
    axes = figure.subplots(rows, 3, squeeze=False)
    _draw_convergence(axes[0, 0], dataset)
    shown = applicable_quantities(_CAMPAIGN_QUANTITIES, dataset)
    for place, name in zip(axes[0, 1:], shown, strict=False):
        _draw_distribution(place, dataset, name, *_CAMPAIGN_QUANTITIES[name])
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
    counts = np.unique(np.linspace(1, met.size, min(met.size, _CONVERGENCE_POINTS)).round().astype(int))
    successes = np.cumsum(met)[counts - 1]
    confidence = float(dataset.attrs["confidence"])
    pairs = zip(successes.tolist(), counts.tolist(), strict=True)
    ends = np.array([wilson_interval(one, count, confidence) for one, count in pairs])
    color = series_style(0)["color"]
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
    axes.step(
        ordered[known], shares[known], where="post", color=series_style(0)["color"], rasterized=values.size > _MANY
    )
    low, high = order_statistic_interval(values, 0.95, float(dataset.attrs["confidence"]))
    ends = [end for end in (low, high) if np.isfinite(end)]
    label = "interval of the 95 % point" if len(ends) == 2 else _ONE_END
    for k, end in enumerate(ends):
        axes.axvline(end, color=series_style(1)["color"], linewidth=0.9, linestyle="--", label=None if k else label)
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
    axes.plot(x[met & known], y[met & known], ".", markersize=3.0, color=series_style(0)["color"], rasterized=many)
    axes.plot(x[~met & known], y[~met & known], "x", markersize=5.0, color=series_style(1)["color"], rasterized=many)
    for value in x[~known]:
        axes.plot(
            value, 0.98, "x", markersize=5.0, color=series_style(1)["color"], transform=axes.get_xaxis_transform()
        )
    axes.set_xlabel(path)
    axes.set_ylabel("greatest miss (m)")
    axes.ticklabel_format(style="plain")
    axes.locator_params(axis="x", nbins=5)


_PAIRED_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-paired"}
_PAIRED_QUANTITIES = (("miss_m", "greatest miss", "m"), ("arrival_spread_s", "arrival spread", "s"))
_PAIRS_MIN = 2


def draw_paired(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw two campaigns beside each other as new SVG and PNG files `comparison`.

    Parameters
    ----------
    dataset
        Pairs, from `anser.campaigns.compare_campaigns`.
    folder
        To write into; returns the paths of its new files, none of fewer than two pairs.
    """
    if dataset.sizes["flight"] < _PAIRS_MIN:
        return ()
    return save_drawings({"comparison": _draw_paired}, dataset, _PAIRED_STYLE, folder)


def _draw_paired(dataset: xr.Dataset) -> "Figure":
    shown = [one for one in _PAIRED_QUANTITIES if one[0] in dataset]
    _, figure = new_figure((7.6, 3.2 * len(shown)))
    axes = figure.subplots(len(shown), 2, squeeze=False)
    for row, (name, words, unit) in zip(axes, shown, strict=True):
        first, second = dataset[name].values
        _draw_pairs(row[0], first, second, dataset["met"].values)
        row[0].set_xlabel(f"{words}, first ({unit})")
        row[0].set_ylabel(f"{words}, second ({unit})")
        _draw_differences(row[1], first, second)
        row[1].set_xlabel(f"{words}, second less first ({unit})")
    return figure


def _draw_pairs(axes: "Axes", first: np.ndarray, second: np.ndarray, met: np.ndarray) -> None:
    """Each flight in both; below the line the second is better. Crosses: one of them did not meet every requirement."""
    known = np.isfinite(first) & np.isfinite(second)
    good = known & met.all(axis=0)
    bad = known & ~met.all(axis=0)
    axes.plot(first[good], second[good], ".", markersize=3.0, color=series_style(0)["color"])
    axes.plot(first[bad], second[bad], "x", markersize=5.0, color=series_style(1)["color"])
    axes.axline((0.0, 0.0), slope=1.0, color="0.6", linewidth=0.7)


def _draw_differences(axes: "Axes", first: np.ndarray, second: np.ndarray) -> None:
    """Share of the flights below each difference; what is infinite lies beyond the ends."""
    alike = first == second
    off = np.sort(np.where(alike, 0.0, np.where(alike, 0.0, second) - np.where(alike, 0.0, first)))
    shares = 100.0 * np.arange(1, off.size + 1) / off.size
    known = np.isfinite(off)
    axes.step(off[known], shares[known], where="post", color=series_style(0)["color"])
    axes.axvline(0.0, color="0.6", linewidth=0.7)
    axes.axhline(50.0, color="0.6", linewidth=0.7)
    axes.set_ylim(0.0, 102.0)
    axes.set_ylabel("flights below (%)")


_RARE_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-rare"}


def draw_rare(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a rare event as SVG and PNG files `rare`, which take the place of former ones.

    Parameters
    ----------
    dataset
        From `anser.campaigns.RareEvent.dataset`.
    folder
        To write into; returns the paths of its files.
    """
    return save_drawings({"rare": _draw_rare}, dataset, _RARE_STYLE, folder, overwrite=True)


def _draw_rare(dataset: xr.Dataset) -> "Figure":
    _, figure = new_figure((6.4, 4.0))
    axes, about = figure.subplots(), dataset.attrs
    x, probability = dataset["threshold"].values, dataset["probability"].values
    sure = f"interval at {100 * about['confidence']:g} %"
    axes.fill_between(
        x, dataset["low"], dataset["high"], alpha=0.2, color=series_style(0)["color"], linewidth=0, label=sure
    )
    axes.plot(x, probability, color=series_style(0)["color"], label="probability")
    bounds = np.asarray(about["bounds"], dtype=float)
    bounds = bounds[np.isfinite(bounds)]
    axes.plot(
        bounds, np.full(bounds.size, 0.02), "|", color="0.4", transform=axes.get_xaxis_transform(), label="levels"
    )
    axes.axvline(about["asked"], color=series_style(1)["color"], linewidth=0.9, linestyle="--", label="threshold")
    axes.set_yscale("log")
    known = dataset["threshold"].attrs
    axes.set_xlabel(f"{known['long_name'].lower()} ({known['units']})")
    axes.set_ylabel(f"probability of a flight {about['breached']} it")
    axes.legend(loc="lower left" if about["breached"] == "above" else "lower right", fontsize=SMALL)
    figure.suptitle(about["title"], fontsize=SMALL + 2)
    return figure


_SWEEP_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-sweep"}
_SWEEP_PANELS = (
    ("arrival_s", "last arrival (s)"),
    ("arrival_spread_s", "arrival spread (s)"),
    ("miss_m", "greatest miss (m)"),
)
_LEGEND_LINES_MAX = 12
"""Lines that a key names at most."""


def draw_sweep(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a sweep as SVG and PNG files `sweep`: against the first path with several numbers, one line for each rest.

    Parameters
    ----------
    dataset
        As `anser.missions.sweeps` makes it.
    folder
        To write into; returns the paths of its new files, none where no path has several numbers.
    """
    if _abscissa_path(dataset) is None:
        return ()
    return save_drawings({"sweep": _draw_sweep}, dataset, _SWEEP_STYLE, folder)


def _abscissa_path(dataset: xr.Dataset) -> str | None:
    """The path that is drawn from left to right: the one with the most values, if they are numbers."""
    paths = [path for path in json.loads(dataset.attrs["swept"]) if dataset[path].dtype.kind == "f"]
    longest = max(paths, key=lambda path: dataset[path].size, default=None)
    return longest if longest is not None and dataset[longest].size > 1 else None


def _draw_sweep(dataset: xr.Dataset) -> "Figure":
    across = str(_abscissa_path(dataset))
    others = [path for path in json.loads(dataset.attrs["swept"]) if path != across]
    panels = [(name, label) for name, label in _SWEEP_PANELS if name in dataset]
    _, figure = new_figure((7.2, 1.9 * len(panels) + 0.6))
    all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, label) in zip(all_axes, panels, strict=True):
        _draw_panel(axes, dataset, name, across, others)
        axes.set_ylabel(label)
    all_axes[-1].set_xlabel(across)
    lines = int(np.prod([dataset[path].size for path in others]))
    if 1 < lines <= _LEGEND_LINES_MAX:
        figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.suptitle(f"sweep of {dataset.attrs['title']}", fontsize=SMALL + 2)
    return figure


def _draw_panel(axes: "Axes", dataset: xr.Dataset, name: str, across: str, others: list[str]) -> None:
    values = dataset[name]
    if "aircraft" in values.dims:
        values = values.max("aircraft", skipna=False)
    x = dataset[across].values
    for k, at in enumerate(itertools.product(*(range(dataset[path].size) for path in others))):
        where = dict(zip(others, at, strict=True))
        y, met = (one.isel(where).transpose(across).values for one in (values, dataset["met"]))
        label = ", ".join(f"{path} = {dataset[path].values[j]}" for path, j in where.items())
        axes.plot(x, y, label=label, **series_style(k))
        axes.plot(x[met], y[met], "o", markersize=3.5, color=series_style(k)["color"])
        axes.plot(x[~met], y[~met], "x", markersize=6.0, color=series_style(k)["color"])
    axes.margins(y=0.12)
