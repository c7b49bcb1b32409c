"""Figures of many flights for print: campaign, comparison of two campaigns, rare event, sweep of parameters."""

import itertools
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.campaign_data import success_convergence
from anser.report.style import PRINT_STYLE, SMALL, color_of, new_figure, save_drawings, series_style
from anser.results.flight_rows import applicable_quantities, worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_QUANTITIES = {"miss_m": ("greatest miss", "m"), "arrival_spread_s": ("arrival spread", "s")}
_MILLISECONDS_BELOW_S = 0.01
_OPEN_INTERVAL = "the 95 % point is at least this;\ntoo few flights met all for an upper end"
_INPUTS_MAX = 6
"""Greatest number of varied inputs over which the misses are plotted."""
_CONVERGENCE_POINTS = 200
"""Greatest number of points of the curve of the success rate over the number of flights."""
_VECTOR_FLIGHTS_MAX = 5_000
"""Greatest number of flights drawn as vectors in a figure; more flights are drawn as pixels, for a smaller file."""
_FLIGHTS_MIN = 2
"""Least number of flights for which a figure is drawn."""


def _style(name: str) -> dict[str, Any]:
    return {**PRINT_STYLE, "svg.hashsalt": f"anser-{name}"}


def draw_campaign(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw success rate, distributions of miss and spread, and misses over inputs into `campaign.svg` and `.png`.

    `dataset` must have only the independent flights of a `CampaignStore`. Existing files are replaced. Returns the
    paths; if the dataset has fewer than two flights, no file is written.
    """
    if dataset.sizes["flight"] < _FLIGHTS_MIN:
        return ()
    return save_drawings({"campaign": _draw_campaign}, dataset, _style("campaign"), folder, overwrite=True)


def _draw_campaign(dataset: xr.Dataset) -> "Figure":
    input_paths = [path for path in json.loads(dataset.attrs["varied"]) if dataset[path].dtype.kind in "fiu"][
        :_INPUTS_MAX
    ]
    row_count = 1 + -(-len(input_paths) // 3)
    _, figure = new_figure((9.6, 2.9 * row_count + 0.5))
    axes = figure.subplots(row_count, 3, squeeze=False)
    _draw_convergence(axes[0, 0], dataset)
    quantities = applicable_quantities(_QUANTITIES, dataset)
    for panel, name in zip(axes[0, 1:], quantities, strict=False):
        _draw_distribution(panel, dataset, name, *_QUANTITIES[name])
    for panel in axes[0, 1 + len(quantities) :]:
        panel.set_visible(False)
    input_panels = axes[1:].ravel() if row_count > 1 else np.empty(0, dtype=object)
    for panel, path in zip(input_panels, input_paths, strict=False):
        _draw_miss_against_input(panel, dataset, path)
    for panel in input_panels[len(input_paths) :]:
        panel.set_visible(False)
    figure.suptitle(f"{dataset.attrs['title']}: {dataset.sizes['flight']} flights", fontsize=SMALL + 2)
    return figure


def _draw_convergence(axes: "Axes", dataset: xr.Dataset) -> None:
    confidence, color = float(dataset.attrs["confidence"]), color_of(0)
    curve = success_convergence(dataset["met"].values, confidence, _CONVERGENCE_POINTS)
    axes.fill_between(curve["n"], curve["low"], curve["high"], alpha=0.2, color=color, linewidth=0)
    axes.plot(curve["n"], curve["value"], color=color)
    axes.set_xlabel("flights")
    axes.set_ylabel(f"meet every requirement (%),\nand the interval at {100 * confidence:g} %")


def _draw_distribution(axes: "Axes", dataset: xr.Dataset, name: str, quantity_label: str, unit: str) -> None:
    values = worst_of_fleet(dataset, name)
    if unit == "s" and np.all(values[np.isfinite(values)] < _MILLISECONDS_BELOW_S):
        values, unit = 1000.0 * values, "ms"
    _draw_shares_below(axes, values)
    low, high = order_statistic_interval(values, 0.95, float(dataset.attrs["confidence"]))
    bounds = [bound for bound in (low, high) if np.isfinite(bound)]
    label = "interval of the 95 % point" if len(bounds) == 2 else _OPEN_INTERVAL
    for k, bound in enumerate(bounds):
        axes.axvline(bound, color=color_of(1), linewidth=0.9, linestyle="--", label=None if k else label)
    axes.axhline(95.0, color="0.6", linewidth=0.7)
    axes.set_xlabel(f"{quantity_label} ({unit})")
    axes.ticklabel_format(axis="x", style="plain")
    axes.locator_params(axis="x", nbins=5)
    if bounds:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False, fontsize=SMALL)


def _draw_shares_below(axes: "Axes", values: np.ndarray) -> None:
    ordered = np.sort(values)
    shares = 100.0 * np.arange(1, ordered.size + 1) / ordered.size
    is_finite, is_large = np.isfinite(ordered), values.size > _VECTOR_FLIGHTS_MAX
    axes.step(ordered[is_finite], shares[is_finite], where="post", color=color_of(0), rasterized=is_large)
    axes.set_ylim(0.0, 102.0)
    axes.set_ylabel("flights below (%)")


def _draw_outcomes(axes: "Axes", x: np.ndarray, y: np.ndarray, succeeded: np.ndarray) -> None:
    """Draw a dot for each successful and a cross for each failed flight whose `x` and `y` are finite."""
    is_finite, is_large = np.isfinite(x) & np.isfinite(y), x.size > _VECTOR_FLIGHTS_MAX
    for k, (mask, marker, size) in enumerate(((succeeded, ".", 3.0), (~succeeded, "x", 5.0))):
        selected = mask & is_finite
        axes.plot(x[selected], y[selected], marker, markersize=size, color=color_of(k), rasterized=is_large)


def _draw_miss_against_input(axes: "Axes", dataset: xr.Dataset, path: str) -> None:
    """Draw each flight's greatest miss over the input `path`; a cross at the upper edge marks an infinite miss."""
    x, y, succeeded = dataset[path].values, worst_of_fleet(dataset, "miss_m"), dataset["met"].values
    _draw_outcomes(axes, x, y, succeeded)
    for value in x[~np.isfinite(y)]:
        axes.plot(value, 0.98, "x", markersize=5.0, color=color_of(1), transform=axes.get_xaxis_transform())
    axes.set_xlabel(path)
    axes.set_ylabel("greatest miss (m)")
    axes.ticklabel_format(style="plain")
    axes.locator_params(axis="x", nbins=5)


def draw_paired(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw miss and arrival spread of two campaigns' paired flights into new files `comparison.svg` and `.png`.

    Returns the paths; if there are fewer than two pairs, no file is written.
    """
    if dataset.sizes["flight"] < _FLIGHTS_MIN:
        return ()
    return save_drawings({"comparison": _draw_paired}, dataset, _style("paired"), folder)


def _draw_paired(dataset: xr.Dataset) -> "Figure":
    quantities = [(name, *text) for name, text in _QUANTITIES.items() if name in dataset]
    _, figure = new_figure((7.6, 3.2 * len(quantities)))
    axes = figure.subplots(len(quantities), 2, squeeze=False)
    for panels, (name, label, unit) in zip(axes, quantities, strict=True):
        first_values, second_values = dataset[name].values
        _draw_outcomes(panels[0], first_values, second_values, np.asarray(dataset["met"].values.all(axis=0)))
        panels[0].axline((0.0, 0.0), slope=1.0, color="0.6", linewidth=0.7)
        panels[0].set_xlabel(f"{label}, first ({unit})")
        panels[0].set_ylabel(f"{label}, second ({unit})")
        _draw_differences(panels[1], first_values, second_values)
        panels[1].set_xlabel(f"{label}, second less first ({unit})")
    return figure


def _draw_differences(axes: "Axes", first_values: np.ndarray, second_values: np.ndarray) -> None:
    """Draw the distribution function (%) of the pairs' differences, second less first, infinite ones included."""
    is_equal = first_values == second_values
    differences = np.where(is_equal, 0.0, second_values) - np.where(is_equal, 0.0, first_values)
    _draw_shares_below(axes, differences)
    axes.axvline(0.0, color="0.6", linewidth=0.7)
    axes.axhline(50.0, color="0.6", linewidth=0.7)


def draw_rare(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw the exceedance probability of a rare event into `rare.svg` and `rare.png`; existing files are replaced."""
    return save_drawings({"rare": _draw_rare}, dataset, _style("rare"), folder, overwrite=True)


def _draw_rare(dataset: xr.Dataset) -> "Figure":
    _, figure = new_figure((6.4, 4.0))
    axes, attributes = figure.subplots(), dataset.attrs
    x, probability = dataset["threshold"].values, dataset["probability"].values
    interval_label = f"interval at {100 * attributes['confidence']:g} %"
    axes.fill_between(
        x, dataset["low"], dataset["high"], alpha=0.2, color=color_of(0), linewidth=0, label=interval_label
    )
    axes.plot(x, probability, color=color_of(0), label="probability")
    bounds = np.asarray(attributes["bounds"], dtype=float)
    bounds = bounds[np.isfinite(bounds)]
    axes.plot(
        bounds, np.full(bounds.size, 0.02), "|", color="0.4", transform=axes.get_xaxis_transform(), label="levels"
    )
    axes.axvline(attributes["asked"], color=color_of(1), linewidth=0.9, linestyle="--", label="threshold")
    axes.set_yscale("log")
    threshold = dataset["threshold"].attrs
    axes.set_xlabel(f"{threshold['long_name'].lower()} ({threshold['units']})")
    axes.set_ylabel(f"probability of a flight {attributes['breached']} it")
    axes.legend(loc="lower left" if attributes["breached"] == "above" else "lower right", fontsize=SMALL)
    figure.suptitle(attributes["title"], fontsize=SMALL + 2)
    return figure


_SWEEP_PANELS = (
    ("arrival_s", "last arrival (s)"),
    ("arrival_spread_s", "arrival spread (s)"),
    ("miss_m", "greatest miss (m)"),
)
_LEGEND_LINES_MAX = 12
"""Greatest number of lines in a figure with a legend; with more lines, the figure has no legend."""


def draw_sweep(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw last arrival, arrival spread and greatest miss of a sweep into new files `sweep.svg` and `sweep.png`.

    The abscissa is the swept numeric key with the most values; each combination of the remaining keys is a line. If no
    numeric key has several values, no file is written. Returns the paths. Raises FileExistsError if a file exists.
    """
    if _abscissa_path(dataset) is None:
        return ()
    return save_drawings({"sweep": _draw_sweep}, dataset, _style("sweep"), folder)


def _abscissa_path(dataset: xr.Dataset) -> str | None:
    """Return the swept numeric key path with the most values; None if no numeric key has two values."""
    paths = [path for path in json.loads(dataset.attrs["swept"]) if dataset[path].dtype.kind == "f"]
    longest = max(paths, key=lambda path: dataset[path].size, default=None)
    return longest if longest is not None and dataset[longest].size > 1 else None


def _draw_sweep(dataset: xr.Dataset) -> "Figure":
    abscissa = str(_abscissa_path(dataset))
    line_paths = [path for path in json.loads(dataset.attrs["swept"]) if path != abscissa]
    panels = [(name, label) for name, label in _SWEEP_PANELS if name in dataset]
    _, figure = new_figure((7.2, 1.9 * len(panels) + 0.6))
    all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, label) in zip(all_axes, panels, strict=True):
        _draw_panel(axes, dataset, name, abscissa, line_paths)
        axes.set_ylabel(label)
    all_axes[-1].set_xlabel(abscissa)
    lines = int(np.prod([dataset[path].size for path in line_paths]))
    if 1 < lines <= _LEGEND_LINES_MAX:
        figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.suptitle(f"sweep of {dataset.attrs['title']}", fontsize=SMALL + 2)
    return figure


def _draw_panel(axes: "Axes", dataset: xr.Dataset, name: str, abscissa: str, line_paths: list[str]) -> None:
    values = dataset[name]
    if "aircraft" in values.dims:
        values = values.max("aircraft", skipna=False)
    x = dataset[abscissa].values
    for k, combination in enumerate(itertools.product(*(range(dataset[path].size) for path in line_paths))):
        selection = dict(zip(line_paths, combination, strict=True))
        y, succeeded = (variable.isel(selection).transpose(abscissa).values for variable in (values, dataset["met"]))
        label = ", ".join(f"{path} = {dataset[path].values[j]}" for path, j in selection.items())
        axes.plot(x, y, label=label, **series_style(k))
        axes.plot(x[succeeded], y[succeeded], "o", markersize=3.5, color=color_of(k))
        axes.plot(x[~succeeded], y[~succeeded], "x", markersize=6.0, color=color_of(k))
    axes.margins(y=0.12)
