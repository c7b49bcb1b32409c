"""Figure of one aircraft that follows a path: path, commands against response, position error, controls."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.labels import axis_label, plain, unit
from anser.report.print_style import DASHED, INK, LARGE, PRINT_STYLE, line_of, new_figure, save_figure
from anser.report.style import color_of
from anser.results import surfaces_of
from anser.variables import STANDARD_SURFACES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COMMANDED = ("airspeed_m_s", "path_angle_deg", "course_deg", "bank_deg", "alpha_deg")


def draw_tracking(dataset: xr.Dataset, title: str, paths: Sequence[Path]) -> None:
    """Draw how the first aircraft of a flight follows its path until it arrives.

    Parameters
    ----------
    dataset
        Of a flight, as `anser.results` makes it.
    title
        First line of the figure's heading.
    paths
        New files to write, with one of `FIGURE_SUFFIXES`.
    """
    mpl, figure = new_figure((7.6, 6.2))
    of = dataset.isel(aircraft=0)
    flown = of.isel(time=np.flatnonzero(of["time"].values <= float(of["arrival_time_s"].values[0])))
    with mpl.rc_context(PRINT_STYLE):
        grid = figure.subplots(3, 3)
        _path(grid[0, 0], flown, ("east_m", "north_m"))
        grid[0, 0].set_aspect("equal", adjustable="datalim")
        _over_time(grid[0, 1], flown, ("altitude_m",), {"altitude_m": "reference_altitude_m"})
        _over_time(grid[0, 2], flown, ("position_error_m",), {})
        for axes, name in zip((*grid[1], *grid[2, :2]), _COMMANDED, strict=True):
            command = name.replace("_m_s", "_command_m_s").replace("_deg", "_command_deg")
            _over_time(axes, flown, (name,), {name: command})
        _over_time(grid[2, 2], flown, [f"{name}_deg" for name in surfaces_of(dataset)], {})
        for axes in grid[2]:
            axes.set_xlabel("Time $t$ (s)")
        worst = float(flown["position_error_m"].max())
        note = f"position error {worst:.2f} m at most; what was asked for is dashed"
        figure.suptitle(f"{plain(title)}\n{note}", fontsize=LARGE)
        figure.align_ylabels()
        save_figure(figure, paths)


def _path(axes: "Axes", flown: xr.Dataset, names: tuple[str, str]) -> None:
    x, y = (flown[name].values for name in names)
    axes.plot(x, y, color=color_of(0), label="flown")
    reference = (flown[f"reference_{name}"].values for name in names)
    axes.plot(*reference, color=INK, linestyle=DASHED, linewidth=0.9, label="planned")
    for set_label, name in zip((axes.set_xlabel, axes.set_ylabel), names, strict=True):
        set_label(axis_label(flown[name]))
    axes.legend(loc="best")


def _over_time(axes: "Axes", flown: xr.Dataset, names: Sequence[str], wanted: dict[str, str]) -> None:
    # Symbols that everybody knows are enough.
    known = all(name.removesuffix("_deg") in STANDARD_SURFACES for name in names)
    for k, name in enumerate(names):
        said = f"${flown[name].attrs['symbol']}$" if known else str(flown[name].attrs["long_name"])
        label = said if len(names) > 1 else None
        axes.plot(flown["time"].values, flown[name].values, **line_of(k), label=label)
        if name in wanted:
            axes.plot(
                flown["time"].values, flown[wanted[name]].values, color=INK, linestyle=DASHED, linewidth=0.9, zorder=3
            )
    axes.set_ylabel(axis_label(flown[names[0]]) if len(names) == 1 else f"Deflection ({unit(flown[names[0]])})")
    if len(names) > 1:
        axes.legend(loc="best")
