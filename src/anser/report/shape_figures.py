"""Figures of path families of the published planner: how the bends b4 and c4 change path, speed, course and length."""

from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from anser.report.labels import axis_label, display_unit, math_symbol
from anser.report.style import (
    DASHED,
    FIGURE_SUFFIXES,
    INK,
    LARGE,
    MUTED,
    PRINT_STYLE,
    marker_style,
    new_figure,
    save_drawings,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_FAMILIES = {
    # parameter, ordinate of the path, angle with the greatest change, heading
    "b4": ("lateral_shape_m_s4", "east_m", "course_command_deg", "Paths bent sideways"),
    "c4": ("vertical_shape_m_s4", "altitude_m", "path_angle_command_deg", "Paths bent vertically"),
}


def draw_shapes(dataset: xr.Dataset, family: str, folder: Path) -> tuple[Path, ...]:
    """Draw a family of paths into files `shape-FAMILY`, in each format of `FIGURE_SUFFIXES`; return the paths.

    Parameters
    ----------
    dataset
        Result of `anser.verification.polynomial_paths`.
    family
        Varied bend: `b4` (horizontal) or `c4` (vertical).
    folder
        Folder of the files.
    """
    parameter, ordinate, angle, heading = _FAMILIES[family]

    def draw(dataset: xr.Dataset) -> "Figure":
        _, figure = new_figure((6.5, 5.2))
        grid = figure.subplots(2, 2)
        time = dataset["time"].values
        for k in range(dataset.sizes["path"]):
            path = dataset.isel(path=k)
            style = {"markevery": (4 * k, 24), **marker_style(k)}
            label = f"{math_symbol(path[parameter])} = {_signed(path[parameter])} {display_unit(path[parameter])}"
            grid[0, 0].plot(path["north_m"].values, path[ordinate].values, label=label, **style)
            for axes, name in ((grid[0, 1], "airspeed_command_m_s"), (grid[1, 0], angle)):
                axes.plot(time, path[name].values, **style)
        for axes, name in ((grid[0, 0], ordinate), (grid[0, 1], "airspeed_command_m_s"), (grid[1, 0], angle)):
            axes.set_ylabel(axis_label(dataset[name]))
        grid[0, 0].set_xlabel(axis_label(dataset["north_m"]))
        for axes in (grid[0, 1], grid[1, 0]):
            axes.set_xlabel("Time $t$ (s)")
        lengths, values = grid[1, 1], dataset[parameter].values
        for name, style in (
            ("length_m", {"color": INK, "linestyle": "solid"}),
            ("length_estimate_m", {"color": MUTED, "linestyle": DASHED}),
        ):
            members = (dataset[f"member_{variable}"].values for variable in (parameter, name))
            lengths.plot(*members, label=dataset[name].attrs["long_name"], **style)
        published = dataset["length_published_m"]
        style = {"linestyle": "none", "marker": "o", "fillstyle": "none", "color": INK}
        lengths.plot(values, published.values, label=published.attrs["long_name"], **style)
        lengths.set_xlabel(axis_label(dataset[parameter]))
        lengths.set_ylabel(axis_label(dataset["length_m"]))
        lengths.legend(loc="best")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        final_path_angle = dataset["final_path_angle_deg"]
        figure.suptitle(
            f"{heading}: {time[-1]:g} s, {math_symbol(final_path_angle)} = {_signed(final_path_angle[0])}°",
            fontsize=LARGE,
        )
        return figure

    return save_drawings({f"shape-{family}": draw}, dataset, PRINT_STYLE, folder, FIGURE_SUFFIXES)


def _signed(value: xr.DataArray) -> str:
    return f"{float(value):g}".replace("-", "\N{MINUS SIGN}")
