"""Figure of an airframe: coefficients against the flow angles, thrust and steady flights against airspeed."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.labels import plain
from anser.report.print_style import SMALL, drawn, line_of, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LONGITUDINAL, _LATERAL = ("CL", "CD", "Cm"), ("CY", "Cl", "Cn")


def draw_airframe(dataset: xr.Dataset, path: Path) -> None:
    """Draw an airframe into a new file, PNG, SVG or PDF.

    Parameters
    ----------
    dataset
        As `anser.results.airframe_dataset` makes it.
    path
        Where; FileExistsError where it exists.
    """
    save_figure(drawn(_drawn, dataset), [path])


def _drawn(dataset: xr.Dataset) -> "Figure":
    _, figure = new_figure((9.2, 6.4))
    grid = figure.subplots(2, 3)
    title = " ".join(str(dataset.attrs[key]) for key in ("aircraft", "variant") if key in dataset.attrs)
    words = f"{plain(title)} at an altitude of {dataset.attrs['altitude_m']:g} m"
    below = "Below, level flight at each airspeed. Lines: within all limits of the airframe; dots: beyond one of them."
    figure.suptitle(f"{words}\n{below}", fontsize=SMALL + 2)
    sized = bool(dataset.attrs["dimensionless"])
    what = "coefficient" if sized else "force (m²), moment (m³) over dynamic pressure"
    _lines(grid[0, 0], dataset["over_alpha"], _LONGITUDINAL, "alpha", what)
    _lines(grid[0, 1], dataset["over_beta"], _LATERAL, "beta", what)
    _thrust(grid[0, 2], dataset)
    _trim(grid[1, 0], dataset, dataset["trim_alpha_deg"], "angle of attack (°)")
    _trim(grid[1, 1], dataset, dataset["trim_power"], "power (%)")
    for k, name in enumerate(dataset["surface"].values):
        _trim(grid[1, 2], dataset, dataset["trim_surface_deg"].sel(surface=name), "deflection (°)", k, str(name))
    _legend(grid[1, 2])
    return figure


def _lines(axes: "Axes", values: xr.DataArray, names: tuple[str, ...], across: str, what: str) -> None:
    for k, name in enumerate(names):
        axes.plot(values[across], values.sel(coefficient=name), label=name, **line_of(k))
    axes.set_xlabel({"alpha": "angle of attack α (°), no sideslip", "beta": "sideslip β (°), α = 2°"}[across])
    axes.set_ylabel(what)
    _legend(axes)


def _legend(axes: "Axes") -> None:
    """Above the panel, where no curve is; three columns at most."""
    columns = min(3, len(axes.get_legend_handles_labels()[0]))
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, frameon=False, columnspacing=1.0)


def _thrust(axes: "Axes", dataset: xr.Dataset) -> None:
    for k, power in enumerate(dataset["power"].values):
        thrust = dataset["thrust"].sel(power=power)
        axes.plot(dataset["airspeed"], thrust, label=f"{power:g} % power", **line_of(k))
    axes.set_xlabel("airspeed (m/s)")
    axes.set_ylabel("thrust (N)")
    _legend(axes)


def _trim(
    axes: "Axes", dataset: xr.Dataset, values: xr.DataArray, what: str, k: int = 0, label: str | None = None
) -> None:
    """Level flight: a full line where it is within the limits, dots beyond."""
    speeds, within = dataset["airspeed"].values, dataset["trimmable"].values
    line = line_of(k)
    axes.plot(speeds, np.where(within, values, np.nan), label=label, **line)
    axes.plot(speeds[~within], values.values[~within], ".", color=line["color"], markersize=3)
    axes.set_xlabel("airspeed (m/s), level flight")
    axes.set_ylabel(what)
