"""Figure of two campaigns with paired seeds: each flight in the one against the other, and the differences."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.print_style import PRINT_STYLE, line_of, new_figure, save_drawings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-paired"}
_QUANTITIES = (("miss_m", "greatest miss", "m"), ("arrival_spread_s", "arrival spread", "s"))
_ENOUGH = 2


def draw_paired(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw two campaigns beside each other as new SVG and PNG files `comparison`.

    Parameters
    ----------
    dataset
        Pairs, from `anser.campaigns.compare_campaigns`.
    folder
        To write into; returns the paths of its new files, none of fewer than two pairs.
    """
    if dataset.sizes["flight"] < _ENOUGH:
        return ()
    return save_drawings({"comparison": _drawn}, dataset, _STYLE, folder)


def _drawn(dataset: xr.Dataset) -> "Figure":
    shown = [one for one in _QUANTITIES if one[0] in dataset]
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
    axes.plot(first[good], second[good], ".", markersize=3.0, color=line_of(0)["color"])
    axes.plot(first[bad], second[bad], "x", markersize=5.0, color=line_of(1)["color"])
    axes.axline((0.0, 0.0), slope=1.0, color="0.6", linewidth=0.7)


def _draw_differences(axes: "Axes", first: np.ndarray, second: np.ndarray) -> None:
    """Share of the flights below each difference; what is infinite lies beyond the ends."""
    alike = first == second
    off = np.sort(np.where(alike, 0.0, np.where(alike, 0.0, second) - np.where(alike, 0.0, first)))
    shares = 100.0 * np.arange(1, off.size + 1) / off.size
    known = np.isfinite(off)
    axes.step(off[known], shares[known], where="post", color=line_of(0)["color"])
    axes.axvline(0.0, color="0.6", linewidth=0.7)
    axes.axhline(50.0, color="0.6", linewidth=0.7)
    axes.set_ylim(0.0, 102.0)
    axes.set_ylabel("flights below (%)")
