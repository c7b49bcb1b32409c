"""Figure of a rare event: how probable it is that a threshold is breached, against the threshold."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.print_style import PRINT_STYLE, SMALL, line_of, new_figure, save_drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-rare"}


def draw_rare(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a rare event as SVG and PNG files `rare`, which take the place of former ones.

    Parameters
    ----------
    dataset
        From `anser.campaigns.RareEvent.dataset`.
    folder
        To write into; returns the paths of its files.
    """
    return save_drawings({"rare": _drawn}, dataset, _STYLE, folder, overwrite=True)


def _drawn(dataset: xr.Dataset) -> "Figure":
    _, figure = new_figure((6.4, 4.0))
    axes, about = figure.subplots(), dataset.attrs
    x, probability = dataset["threshold"].values, dataset["probability"].values
    sure = f"interval at {100 * about['confidence']:g} %"
    axes.fill_between(x, dataset["low"], dataset["high"], alpha=0.2, color=line_of(0)["color"], linewidth=0, label=sure)
    axes.plot(x, probability, color=line_of(0)["color"], label="probability")
    bounds = np.asarray(about["bounds"], dtype=float)
    bounds = bounds[np.isfinite(bounds)]
    axes.plot(
        bounds, np.full(bounds.size, 0.02), "|", color="0.4", transform=axes.get_xaxis_transform(), label="levels"
    )
    axes.axvline(about["asked"], color=line_of(1)["color"], linewidth=0.9, linestyle="--", label="threshold")
    axes.set_yscale("log")
    known = dataset["threshold"].attrs
    axes.set_xlabel(f"{known['long_name'].lower()} ({known['units']})")
    axes.set_ylabel(f"probability of a flight {about['breached']} it")
    axes.legend(loc="lower left" if about["breached"] == "above" else "lower right", fontsize=SMALL)
    figure.suptitle(about["title"], fontsize=SMALL + 2)
    return figure
