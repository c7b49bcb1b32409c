"""Panels over Mach number and altitude, one row for each steady flight of a survey."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


EMPTY_COLOR = "#e6e6e6"
"""Colour of what is not there."""


def map_panels(
    dataset: xr.Dataset, columns: int, width: float, title: str, notes: Sequence[str]
) -> tuple["Figure", np.ndarray, np.ndarray]:
    """Panels with a row for each condition, labelled at the edges; below each column a place for its colours.

    Parameters
    ----------
    dataset
        Over condition, altitude and mach, with `condition_meaning` and the attributes of a survey.
    columns
        Number of panels in a row.
    width
        Of the figure, inches.
    title, notes
        First line, to which aircraft and inversion are added, and what stands below it.

    Returns
    -------
    figure, panels of shape (conditions, columns), places of shape (columns,)
    """
    from matplotlib.figure import Figure

    conditions = dataset["condition_meaning"].values
    rows = len(conditions)
    figure = Figure(figsize=(width, 1.6 + 2.0 * rows), layout="constrained")
    grid = figure.add_gridspec(rows + 1, columns, height_ratios=[1.0] * rows + [0.07])
    axes = np.empty((rows, columns), dtype=object)
    for c, k in np.ndindex(rows, columns):
        axes[c, k] = one = figure.add_subplot(grid[c, k])
        one.set_facecolor(EMPTY_COLOR)
        one.tick_params(labelbottom=c == rows - 1, labelleft=k == 0)
        if k == 0:
            one.set_ylabel(f"{conditions[c]}\naltitude (km)")
        if c == rows - 1:
            one.set_xlabel("Mach number")
    below = np.array([figure.add_subplot(grid[rows, k]) for k in range(columns)])
    of = dataset.attrs
    name = " ".join(str(of[key]) for key in ("aircraft", "variant") if key in of)
    figure.suptitle("\n".join([f"{title}: {name}, {of['inversion']} inversion", *notes]), fontsize=10)
    return figure, axes, below


def draw_column(
    figure: "Figure",
    panels: np.ndarray,
    below: "Axes",
    dataset: xr.Dataset,
    values: np.ndarray,
    label: str,
    extend: str | None = None,
    **style: Any,
) -> None:
    """One figure (condition, altitude, mach) over all conditions, with its colours below; `extend` of the colours."""
    for axes, cells in zip(panels, values, strict=True):
        draw_cells(axes, dataset, cells, **style)
    figure.colorbar(panels[0].collections[0], cax=below, orientation="horizontal", label=label, extend=extend)


def draw_cells(axes: "Axes", dataset: xr.Dataset, values: np.ndarray, **style: Any) -> None:
    """Cells about the points of the grid; nothing where the value is no number."""
    shown = np.ma.masked_invalid(values)
    mach, altitude = _edges(dataset["mach"].values), _edges(dataset["altitude"].values / 1000.0)
    axes.pcolormesh(mach, altitude, shown, linewidth=0.2, edgecolors="white", **style)
    axes.set_xlim(mach[0], mach[-1])
    axes.set_ylim(altitude[0], altitude[-1])


def draw_marks(axes: "Axes", dataset: xr.Dataset, mask: np.ndarray, **style: Any) -> None:
    """A mark at each point of the grid that is chosen."""
    altitude, mach = np.nonzero(mask)
    axes.scatter(dataset["mach"].values[mach], dataset["altitude"].values[altitude] / 1000.0, **style)


def _edges(centres: np.ndarray) -> np.ndarray:
    if centres.size == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    between = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - between[0]], between, [2 * centres[-1] - between[-1]]])
