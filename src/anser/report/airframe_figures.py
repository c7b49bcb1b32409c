"""Figures of an airframe: coefficients, thrust, level flight, and the pitch trims of a deep stall."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.labels import aircraft_title, escape_mathtext
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
    """Draw an airframe (result of `anser.analysis.survey_airframe`) into a new file, PNG, SVG or PDF."""
    save_figure(draw_for_print(_draw_airframe, dataset), [path])


def _draw_airframe(dataset: xr.Dataset) -> "Figure":
    _, figure = new_figure((9.2, 6.4))
    grid = figure.subplots(2, 3)
    heading = f"{escape_mathtext(aircraft_title(dataset))} at an altitude of {dataset.attrs['altitude_m']:g} m"
    note = "Below, level flight at each airspeed. Lines: within all limits of the airframe; dots: beyond one of them."
    figure.suptitle(f"{heading}\n{note}", fontsize=SMALL + 2)
    is_dimensionless = bool(dataset.attrs["dimensionless"])
    quantity_label = "coefficient" if is_dimensionless else "force (m²), moment (m³) over dynamic pressure"
    _draw_coefficients(grid[0, 0], dataset["over_alpha"], _LONGITUDINAL, "alpha", quantity_label)
    _draw_coefficients(grid[0, 1], dataset["over_beta"], _LATERAL, "beta", quantity_label)
    _draw_thrust(grid[0, 2], dataset)
    _draw_trim(grid[1, 0], dataset, dataset["trim_alpha_deg"], "angle of attack (°)")
    _draw_trim(grid[1, 1], dataset, dataset["trim_power"], "power (%)")
    for k, name in enumerate(dataset["surface"].values):
        _draw_trim(grid[1, 2], dataset, dataset["trim_surface_deg"].sel(surface=name), "deflection (°)", k, str(name))
    _draw_legend(grid[1, 2])
    return figure


def _draw_coefficients(axes: "Axes", values: xr.DataArray, names: tuple[str, ...], abscissa: str, y_label: str) -> None:
    for k, name in enumerate(names):
        axes.plot(values[abscissa], values.sel(coefficient=name), label=name, **series_style(k))
    axes.set_xlabel({"alpha": "angle of attack α (°), no sideslip", "beta": "sideslip β (°), α = 2°"}[abscissa])
    axes.set_ylabel(y_label)
    _draw_legend(axes)


def _draw_legend(axes: "Axes") -> None:
    """Draw the legend above the panel, where it covers no curve, in at most three columns."""
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
    axes: "Axes", dataset: xr.Dataset, values: xr.DataArray, y_label: str, k: int = 0, label: str | None = None
) -> None:
    """Draw a variable of level flight over airspeed: a line within the limits, dots where a limit is exceeded."""
    speeds, within = dataset["airspeed"].values, dataset["trimmable"].values
    line = series_style(k)
    axes.plot(speeds, np.where(within, values, np.nan), label=label, **line)
    axes.plot(speeds[~within], values.values[~within], ".", color=line["color"], markersize=3)
    axes.set_xlabel("airspeed (m/s), level flight")
    axes.set_ylabel(y_label)


def draw_deep_stall(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw the pitching moment Cm over alpha for each centre of gravity, with the trims marked, and the curve of trims.

    Parameters
    ----------
    dataset
        Result of `anser.analysis.deep_stall`.
    paths
        New files, with suffixes of `FIGURE_SUFFIXES`.
    """
    mpl, figure = new_figure((9.0, 4.2))
    with mpl.rc_context(PRINT_STYLE):
        moment_axes, trim_axes = figure.subplots(1, 2)
        alphas = dataset["alpha"].values
        for color_index, x_cg in enumerate(dataset["x_cg"].values):
            moment_axes.plot(
                alphas,
                dataset["pitching_moment"].values[color_index],
                color=color_of(color_index),
                label=f"{x_cg:g} of chord",
            )
        moment_axes.axhline(0.0, color=INK, linewidth=0.8)
        for stable, fill_color, name in ((1, INK, "stable trim"), (0, "white", "unstable trim")):
            is_selected = dataset["trim_stable"].values == stable
            marks = {"linestyle": "none", "marker": "o", "color": INK, "markerfacecolor": fill_color, "zorder": 5}
            moment_axes.plot(
                dataset["trim_alpha"].values[is_selected], np.zeros(is_selected.sum()), label=name, **marks
            )
            trim_axes.plot(dataset["trim_x_cg"].values[is_selected], dataset["trim_alpha"].values[is_selected], **marks)
        moment_axes.set_xlabel("angle of attack (deg)")
        moment_axes.set_ylabel("pitching moment coefficient $C_m$")
        moment_axes.legend(title="centre of gravity")
        x_cg, alpha = dataset["branch_x_cg"].values, dataset["branch_alpha"].values
        is_stable = dataset["branch_slope"].values < 0.0
        trim_axes.plot(x_cg, np.where(is_stable, alpha, np.nan), color=INK, label="stable")
        trim_axes.plot(x_cg, np.where(is_stable, np.nan, alpha), color=MUTED, linestyle="dashed", label="unstable")
        trim_axes.set_xlabel("centre of gravity (of chord)")
        trim_axes.set_ylabel("angle of attack of the trim (deg)")
        if np.isfinite(x_cg).any():
            trim_axes.legend()
        attributes = dataset.attrs
        figure.suptitle(
            f"{attributes['aircraft']} ({attributes['variant']}): pitch trims with the elevator held at "
            f"{attributes['elevator_deg']:g} deg, no sideslip",
            fontsize=9.5,
            color=INK,
        )
        save_figure(figure, paths)
