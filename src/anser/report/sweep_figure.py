"""Figure of a sweep: arrival, spread and miss against what was swept."""

import itertools
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.print_style import PRINT_STYLE, SMALL, line_of, new_figure, save_drawings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-sweep"}
_PANELS = (
    ("arrival_s", "last arrival (s)"),
    ("arrival_spread_s", "arrival spread (s)"),
    ("miss_m", "greatest miss (m)"),
)
_NAMED = 12
"""Lines that a key names at most."""


def draw_sweep(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a sweep as SVG and PNG files `sweep`: against the first path with several numbers, one line for each rest.

    Parameters
    ----------
    dataset
        As `anser.results.sweep_dataset` makes it.
    folder
        To write into; returns the paths of its new files, none where no path has several numbers.
    """
    if _across(dataset) is None:
        return ()
    return save_drawings({"sweep": _drawn}, dataset, _STYLE, folder)


def _across(dataset: xr.Dataset) -> str | None:
    """The path that is drawn from left to right: the one with the most values, if they are numbers."""
    paths = [path for path in json.loads(dataset.attrs["swept"]) if dataset[path].dtype.kind == "f"]
    longest = max(paths, key=lambda path: dataset[path].size, default=None)
    return longest if longest is not None and dataset[longest].size > 1 else None


def _drawn(dataset: xr.Dataset) -> "Figure":
    across = str(_across(dataset))
    others = [path for path in json.loads(dataset.attrs["swept"]) if path != across]
    panels = [(name, label) for name, label in _PANELS if name in dataset]
    _, figure = new_figure((7.2, 1.9 * len(panels) + 0.6))
    all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, label) in zip(all_axes, panels, strict=True):
        _draw_panel(axes, dataset, name, across, others)
        axes.set_ylabel(label)
    all_axes[-1].set_xlabel(across)
    lines = int(np.prod([dataset[path].size for path in others]))
    if 1 < lines <= _NAMED:
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
        axes.plot(x, y, label=label, **line_of(k))
        axes.plot(x[met], y[met], "o", markersize=3.5, color=line_of(k)["color"])
        axes.plot(x[~met], y[~met], "x", markersize=6.0, color=line_of(k)["color"])
    axes.margins(y=0.12)
