"""Figures of an airframe: coefficients, thrust and level flight, and the pitch trims of its deep stall."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.labels import escape_mathtext
from anser.report.style import (
    INK,
    MUTED,
    PRINT_STYLE,
    SMALL,
    color_of,
    draw_for_print,
    new_figure,
    save_figure,
    series_style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_LONGITUDINAL, _LATERAL = ("CL", "CD", "Cm"), ("CY", "Cl", "Cn")


def draw_airframe(dataset: xr.Dataset, path: Path) -> None:
    """Draw an airframe into a new file, PNG, SVG or PDF.

    Parameters
    ----------
    dataset
        As `anser.analysis.airframe_dataset` makes it.
    path
        Where; FileExistsError where it exists.
    """
    save_figure(draw_for_print(_draw_airframe, dataset), [path])


def _draw_airframe(dataset: xr.Dataset) -> "Figure":
    _, figure = new_figure((9.2, 6.4))
    grid = figure.subplots(2, 3)
    title = " ".join(str(dataset.attrs[key]) for key in ("aircraft", "variant") if key in dataset.attrs)
    words = f"{escape_mathtext(title)} at an altitude of {dataset.attrs['altitude_m']:g} m"
    below = "Below, level flight at each airspeed. Lines: within all limits of the airframe; dots: beyond one of them."
    figure.suptitle(f"{words}\n{below}", fontsize=SMALL + 2)
    sized = bool(dataset.attrs["dimensionless"])
    what = "coefficient" if sized else "force (m²), moment (m³) over dynamic pressure"
    _draw_coefficients(grid[0, 0], dataset["over_alpha"], _LONGITUDINAL, "alpha", what)
    _draw_coefficients(grid[0, 1], dataset["over_beta"], _LATERAL, "beta", what)
    _draw_thrust(grid[0, 2], dataset)
    _draw_trim(grid[1, 0], dataset, dataset["trim_alpha_deg"], "angle of attack (°)")
    _draw_trim(grid[1, 1], dataset, dataset["trim_power"], "power (%)")
    for k, name in enumerate(dataset["surface"].values):
        _draw_trim(grid[1, 2], dataset, dataset["trim_surface_deg"].sel(surface=name), "deflection (°)", k, str(name))
    _draw_legend(grid[1, 2])
    return figure


def _draw_coefficients(axes: "Axes", values: xr.DataArray, names: tuple[str, ...], across: str, what: str) -> None:
    for k, name in enumerate(names):
        axes.plot(values[across], values.sel(coefficient=name), label=name, **series_style(k))
    axes.set_xlabel({"alpha": "angle of attack α (°), no sideslip", "beta": "sideslip β (°), α = 2°"}[across])
    axes.set_ylabel(what)
    _draw_legend(axes)


def _draw_legend(axes: "Axes") -> None:
    """Above the panel, where no curve is; three columns at most."""
    columns = min(3, len(axes.get_legend_handles_labels()[0]))
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, frameon=False, columnspacing=1.0)


def _draw_thrust(axes: "Axes", dataset: xr.Dataset) -> None:
    for k, power in enumerate(dataset["power"].values):
        thrust = dataset["thrust"].sel(power=power)
        axes.plot(dataset["airspeed"], thrust, label=f"{power:g} % power", **series_style(k))
    axes.set_xlabel("airspeed (m/s)")
    axes.set_ylabel("thrust (N)")
    _draw_legend(axes)


def _draw_trim(
    axes: "Axes", dataset: xr.Dataset, values: xr.DataArray, what: str, k: int = 0, label: str | None = None
) -> None:
    """Level flight: a full line where it is within the limits, dots beyond."""
    speeds, within = dataset["airspeed"].values, dataset["trimmable"].values
    line = series_style(k)
    axes.plot(speeds, np.where(within, values, np.nan), label=label, **line)
    axes.plot(speeds[~within], values.values[~within], ".", color=line["color"], markersize=3)
    axes.set_xlabel("airspeed (m/s), level flight")
    axes.set_ylabel(what)


def draw_deep_stall(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw Cm against alpha for each centre of gravity, trims marked, and the followed curve of trims.

    Parameters
    ----------
    dataset
        As `anser.analysis.deep_stall` makes it.
    paths
        New files, with one of the suffixes of a figure.
    """
    mpl, figure = new_figure((9.0, 4.2))
    with mpl.rc_context(PRINT_STYLE):
        left, right = figure.subplots(1, 2)
        alphas = dataset["alpha"].values
        for k, x_cg in enumerate(dataset["x_cg"].values):
            left.plot(alphas, dataset["pitching_moment"].values[k], color=color_of(k), label=f"{x_cg:g} of chord")
        left.axhline(0.0, color=INK, linewidth=0.8)
        for stable, fill, name in ((1, INK, "stable trim"), (0, "white", "unstable trim")):
            which = dataset["trim_stable"].values == stable
            marks = {"linestyle": "none", "marker": "o", "color": INK, "markerfacecolor": fill, "zorder": 5}
            left.plot(dataset["trim_alpha"].values[which], np.zeros(which.sum()), label=name, **marks)
            right.plot(dataset["trim_x_cg"].values[which], dataset["trim_alpha"].values[which], **marks)
        left.set_xlabel("angle of attack (deg)")
        left.set_ylabel("pitching moment coefficient $C_m$")
        left.legend(title="centre of gravity")
        x_cg, alpha = dataset["branch_x_cg"].values, dataset["branch_alpha"].values
        falls = dataset["branch_slope"].values < 0.0
        right.plot(x_cg, np.where(falls, alpha, np.nan), color=INK, label="stable")
        right.plot(x_cg, np.where(falls, np.nan, alpha), color=MUTED, linestyle="dashed", label="unstable")
        right.set_xlabel("centre of gravity (of chord)")
        right.set_ylabel("angle of attack of the trim (deg)")
        if np.isfinite(x_cg).any():
            right.legend()
        of = dataset.attrs
        figure.suptitle(
            f"{of['aircraft']} ({of['variant']}): pitch trims with the elevator held at {of['elevator_deg']:g} deg, "
            "no sideslip",
            fontsize=9.5,
            color=INK,
        )
        save_figure(figure, paths)
