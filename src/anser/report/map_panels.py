"""Panels over Mach number and altitude, one row for each steady flight condition of a survey."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.labels import aircraft_title
from anser.report.style import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


EMPTY_COLOR = "#e6e6e6"
"""Colour of grid cells without a value."""


def map_panels(
    dataset: xr.Dataset, columns: int, width: float, title: str, notes: Sequence[str]
) -> tuple["Figure", np.ndarray, np.ndarray]:
    """Return a new figure with a row of panels for each condition, and axes for a colour bar below each column.

    Parameters
    ----------
    dataset
        Survey over condition, altitude and mach, with `condition_meaning` and the survey's attributes.
    columns
        Number of panels in a row.
    width
        Width of the figure, inches.
    title, notes
        First line of the heading, extended by aircraft and inversion, and the lines below.

    Returns
    -------
    figure, panels of shape (conditions, columns), colour bar axes of shape (columns,)
    """
    conditions = dataset["condition_meaning"].values
    row_count = len(conditions)
    _, figure = new_figure((width, 1.6 + 2.0 * row_count))
    grid = figure.add_gridspec(row_count + 1, columns, height_ratios=[1.0] * row_count + [0.07])
    axes = np.empty((row_count, columns), dtype=object)
    for c, k in np.ndindex(row_count, columns):
        axes[c, k] = panel = figure.add_subplot(grid[c, k])
        panel.set_facecolor(EMPTY_COLOR)
        panel.tick_params(labelbottom=c == row_count - 1, labelleft=k == 0)
        if k == 0:
            panel.set_ylabel(f"{conditions[c]}\naltitude (km)")
        if c == row_count - 1:
            panel.set_xlabel("Mach number")
    colorbar_axes = np.array([figure.add_subplot(grid[row_count, k]) for k in range(columns)])
    attributes = dataset.attrs
    figure.suptitle(
        "\n".join([f"{title}: {aircraft_title(dataset)}, {attributes['inversion']} inversion", *notes]), fontsize=10
    )
    return figure, axes, colorbar_axes


def draw_column(
    figure: "Figure",
    panels: np.ndarray,
    colorbar_axes: "Axes",
    dataset: xr.Dataset,
    values: np.ndarray,
    label: str,
    extend: str | None = None,
    **style: Any,
) -> None:
    """Draw a quantity in one column of panels, one panel for each condition, with a colour bar below.

    `values` has the shape (condition, altitude, mach).
    """
    for axes, cells in zip(panels, values, strict=True):
        draw_cells(axes, dataset, cells, **style)
    figure.colorbar(panels[0].collections[0], cax=colorbar_axes, orientation="horizontal", label=label, extend=extend)


def draw_cells(axes: "Axes", dataset: xr.Dataset, values: np.ndarray, **style: Any) -> None:
    """Draw a coloured cell around each grid point; a cell without a finite value stays empty.

    `values` has the shape (altitude, mach).
    """
    finite_values = np.ma.masked_invalid(values)
    mach, altitude = _edges(dataset["mach"].values), _edges(dataset["altitude"].values / 1000.0)
    axes.pcolormesh(mach, altitude, finite_values, linewidth=0.2, edgecolors="white", **style)
    axes.set_xlim(mach[0], mach[-1])
    axes.set_ylim(altitude[0], altitude[-1])


def draw_marks(axes: "Axes", dataset: xr.Dataset, mask: np.ndarray, **style: Any) -> None:
    """Draw a mark at each grid point selected by a mask (altitude, mach)."""
    altitude, mach = np.nonzero(mask)
    axes.scatter(dataset["mach"].values[mach], dataset["altitude"].values[altitude] / 1000.0, **style)


def _edges(centres: np.ndarray) -> np.ndarray:
    if centres.size == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    between = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - between[0]], between, [2 * centres[-1] - between[-1]]])
