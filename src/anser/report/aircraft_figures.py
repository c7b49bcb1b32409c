"""Figures of one aircraft: aerodynamic coefficients and trim, deep stall, step responses, path tracking."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.labels import aircraft_title, axis_label, display_unit, escape_mathtext, math_symbol
from anser.report.style import (
    COMMAND_LINE,
    INK,
    LARGE,
    MUTED,
    PRINT_STYLE,
    SMALL,
    color_of,
    draw_for_print,
    new_figure,
    save_figure,
    series_style,
)
from anser.results.dataset import surface_names
from anser.variables import STANDARD_SURFACES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_LONGITUDINAL, _LATERAL = ("CL", "CD", "Cm"), ("CY", "Cl", "Cn")


def draw_airframe(dataset: xr.Dataset, path: Path) -> None:
    """Draw a result of `anser.analysis.survey_airframe` into a new PNG, SVG or PDF: coefficients, thrust and trim."""
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
    """Add a legend in at most three columns above the panel, so that the legend covers no curve."""
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
    """Draw `values` in level flight over airspeed: a line of style `k`, but dots where a limit is exceeded."""
    speeds, within = dataset["airspeed"].values, dataset["trimmable"].values
    line = series_style(k)
    axes.plot(speeds, np.where(within, values, np.nan), label=label, **line)
    axes.plot(speeds[~within], values.values[~within], ".", color=line["color"], markersize=3)
    axes.set_xlabel("airspeed (m/s), level flight")
    axes.set_ylabel(y_label)


def draw_deep_stall(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw a deep-stall analysis into new files: Cm over alpha, and trim alpha over the centre of gravity."""
    mpl, figure = new_figure((9.0, 4.2))
    with mpl.rc_context(PRINT_STYLE):
        moment_axes, trim_axes = figure.subplots(1, 2)
        alphas, moments = dataset["alpha"].values, dataset["pitching_moment"].values
        for k, x_cg in enumerate(dataset["x_cg"].values):
            moment_axes.plot(alphas, moments[k], color=color_of(k), label=f"{x_cg:g} of chord")
        moment_axes.axhline(0.0, color=INK, linewidth=0.8)
        for stable, fill_color, name in ((1, INK, "stable trim"), (0, "white", "unstable trim")):
            is_selected = dataset["trim_stable"].values == stable
            x_cg, alpha = (dataset[key].values[is_selected] for key in ("trim_x_cg", "trim_alpha"))
            marks = {"linestyle": "none", "marker": "o", "color": INK, "markerfacecolor": fill_color, "zorder": 5}
            moment_axes.plot(alpha, np.zeros_like(alpha), label=name, **marks)
            trim_axes.plot(x_cg, alpha, **marks)
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
        aircraft = f"{attributes['aircraft']} ({attributes['variant']})"
        condition = f"elevator held at {attributes['elevator_deg']:g} deg, no sideslip"
        figure.suptitle(f"{aircraft}: pitch trims with the {condition}", fontsize=9.5, color=INK)
        save_figure(figure, paths)


_RATES = ("roll_rate_deg_s", "pitch_rate_deg_s", "yaw_rate_deg_s")
_PATH = ("path_angle_deg", "course_deg")
_CHANNELS = {"rates": _RATES, "attitude": ("bank_deg", "alpha_deg", "beta_deg"), "velocity": ("airspeed_m_s", *_PATH)}
_UNCOMMANDED_CHANNELS = {
    "rates": (_CHANNELS["attitude"], _PATH, ("airspeed_m_s",)),
    "attitude": (_RATES, _PATH, ("airspeed_m_s",)),
    "velocity": (("bank_deg", "alpha_deg"), ("beta_deg",), _RATES),
}
"""Variables that a step test of a loop does not command: three panels, by name of the loop."""
_ENGINE = (("throttle",), ("power_percent",))

_TRANSIENT_S = 15.0
"""Time at which the panels below the first row end, s; a test of at most twice this duration is shown whole."""

_SHARED_LABELS = {"degree": "Angle (°)", "degree s-1": "Rate (°/s)"}
"""Axis labels of panels with several variables, by unit."""
_SPAN_MIN = {"m s-1": 1.0, "degree": 1.0, "degree s-1": 1.0, "percent": 5.0, "1": 0.05}
"""Least range of a panel's axis by unit, so that a nearly constant variable looks constant."""

_LEGEND_FONT_SIZE = 6.5  # in panels with several curves
_LINE_LENGTH = 22
"""Greatest length of a line of an axis label, in characters."""


def draw_step(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw a flight of `anser.analysis.fly_steps` into new files: commanded channels, states, and controls.

    Raises FileExistsError if one of the files exists.
    """
    mpl, figure = new_figure((7.6, 5.9))
    with mpl.rc_context(PRINT_STYLE):
        loop = dataset.attrs["loop"]
        surfaces = tuple(f"{name}_deg" for name in surface_names(dataset))
        panels = [*((name,) for name in _CHANNELS[loop]), *_UNCOMMANDED_CHANNELS[loop], surfaces, *_ENGINE]
        grid = figure.subplots(3, 3, sharex="row")
        end = float(dataset["time"].values[-1])
        transient = dataset if end <= 2 * _TRANSIENT_S else dataset.sel(time=slice(0.0, _TRANSIENT_S))
        for k, (axes, names) in enumerate(zip(grid.flat, panels, strict=True)):
            _draw_panel(axes, dataset if k < 3 else transient, names)
        for axes in (*grid[0], *grid[-1]) if transient is not dataset else grid[-1]:
            axes.set_xlabel("Time $t$ (s)")
        if transient is dataset:
            for axes in grid[:-1].flat:
                axes.tick_params(labelbottom=False)
        _shade_after_reading(grid, dataset)
        figure.suptitle(f"{_heading(dataset)}\n{_conditions(dataset)}", fontsize=LARGE)
        figure.align_ylabels()
        save_figure(figure, paths)


def draw_overview(datasets: Sequence[xr.Dataset], paths: Sequence[Path]) -> None:
    """Draw the commanded channels of several step tests into new files, in % of the step; one panel per test."""
    row_count = -(-len(datasets) // 4)
    mpl, figure = new_figure((7.6, 0.7 + 1.75 * row_count))
    with mpl.rc_context(PRINT_STYLE):
        grid = figure.subplots(row_count, 4, sharey=True, squeeze=False)
        for axes, dataset in zip(grid.flat, datasets, strict=False):
            lead = _lead(dataset)
            for k, name in enumerate(_CHANNELS[dataset.attrs["loop"]]):
                if name not in dataset.attrs["commanded"]:
                    continue
                values, step = dataset[name].values, float(dataset[_command(name)].values[0]) - dataset[name].values[0]
                time, progress = _with_lead(dataset, 100 * (values - values[0]) / step, 0.0)
                is_shown = time <= dataset.attrs["read_at_s"]
                label = f"{math_symbol(dataset[name])} {_size(dataset, name)}"
                axes.plot(time[is_shown], progress[is_shown], **series_style(k), label=label)
            end = dataset.attrs["read_at_s"]
            axes.plot([-lead, 0, 0, end], [0, 0, 100, 100], zorder=3, **COMMAND_LINE)
            axes.set_xlim(-_lead(dataset, end), end)
            axes.legend(loc="lower right")
        for axes in grid.flat[len(datasets) :]:
            axes.set_visible(False)
        for panels in grid:
            panels[0].set_ylabel("Part of the step (%)")
        for axes in grid[-1]:
            axes.set_xlabel("Time $t$ (s)")
        heading = "Responses to steps of each channel alone and of a loop's three together"
        figure.suptitle(f"{heading}\n{_conditions(datasets[0])}", fontsize=LARGE)
        save_figure(figure, paths)


def _draw_panel(axes: "Axes", dataset: xr.Dataset, names: Sequence[str]) -> None:
    unit = str(dataset[names[0]].attrs["units"])
    curves = []
    for k, name in enumerate(names):
        line_style: dict[str, Any] = series_style(k) if len(names) > 1 else {"color": color_of(k)}
        time, values = _with_lead(dataset, dataset[name].values, dataset[name].values[0])
        axes.plot(time, values, **line_style, label=_label(dataset[name]))
        curves.append(values)
        if _command(name) in dataset:
            is_commanded = name in dataset.attrs["commanded"]
            label: dict[str, Any] = {"label": "command"} if is_commanded else {"label": "held", "color": MUTED}
            _, command = _with_lead(dataset, dataset[_command(name)].values, values[0])
            axes.step(time, command, where="pre", **COMMAND_LINE | label)
            curves.append(command)
    low, high = (float(f(np.concatenate(curves))) for f in (np.min, np.max))
    if np.isfinite([low, high]).all():
        margin = max(0.08 * (high - low), 0.5 * (_SPAN_MIN[unit] - (high - low)))
        axes.set_ylim(low - margin, high + margin)
    if len(names) == 1:
        axes.set_ylabel(_label(dataset[names[0]], display_unit(dataset[names[0]])))
        if _command(names[0]) in dataset:
            axes.legend(handles=axes.lines[1:], loc="best")
    else:
        axes.set_ylabel(_SHARED_LABELS[unit])
        axes.legend(loc="best", fontsize=_LEGEND_FONT_SIZE, handlelength=1.9, labelspacing=0.3)
    axes.set_xlim(-_lead(dataset), float(dataset["time"].values[-1]))


def _shade_after_reading(grid: np.ndarray, dataset: xr.Dataset) -> None:
    """Shade the time after `read_at_s`, at which the step's metrics were read, in all panels of `grid`."""
    reading_s, end = dataset.attrs["read_at_s"], float(dataset["time"].values[-1])
    if end - reading_s < 0.5 * (dataset["time"].values[1] - dataset["time"].values[0]):
        return
    for axes in grid.flat:
        axes.axvspan(reading_s, end, color="#8c959f", alpha=0.13, linewidth=0)
    place: dict[str, Any] = {"transform": grid[0, 2].get_xaxis_transform(), "ha": "right", "va": "bottom"}
    grid[0, 2].text(end, 1.0, f"after the reading at {reading_s:g} s", fontsize=SMALL, color=MUTED, **place)


def _lead(dataset: xr.Dataset, end: float | None = None) -> float:
    return 0.04 * (float(dataset["time"].values[-1]) if end is None else end)


def _with_lead(dataset: xr.Dataset, values: np.ndarray, initial_value: float) -> tuple[np.ndarray, np.ndarray]:
    """Return time (s) and `values` of a step response, preceded by the constant `initial_value` up to time 0."""
    time = dataset["time"].values
    return np.concatenate([[-_lead(dataset), 0.0], time]), np.concatenate([[initial_value, initial_value], values])


def _command(name: str) -> str:
    """Return the name of a variable's command: "roll_rate_command_deg_s" for "roll_rate_deg_s"."""
    unit = next((unit for unit in ("_deg_s", "_m_s", "_deg") if name.endswith(unit)), "")
    return f"{name.removesuffix(unit)}_command{unit}"


def _label(values: xr.DataArray, unit: str = "") -> str:
    label = textwrap.fill(str(values.attrs["long_name"]), _LINE_LENGTH) + f" {math_symbol(values)}"
    return f"{label} ({unit})" if unit else label


def _size(dataset: xr.Dataset, name: str) -> str:
    step = float(dataset[_command(name)].values[0] - dataset[name].values[0])
    printed = display_unit(dataset[name])
    return f"{step:+.4g}{'' if printed.startswith('°') else ' '}{printed}"


def _heading(dataset: xr.Dataset) -> str:
    steps = [
        f"{dataset[name].attrs['long_name'].lower()} {math_symbol(dataset[name])} {_size(dataset, name)}"
        for name in dataset.attrs["commanded"]
    ]
    return f"{dataset.attrs['loop'].capitalize()} loop: {', '.join(steps)}"


def _conditions(dataset: xr.Dataset) -> str:
    attributes = dataset.attrs
    inversion = {"model": "inversion of the model", "incremental": "incremental inversion"}[attributes["inversion"]]
    variant = f" ({attributes['variant']})" if "variant" in attributes else ""
    point = f"{attributes['speed_m_s']:g} m/s, {attributes['altitude_m']:g} m"
    return f"{attributes['aircraft']}{variant} from level trim at {point}; {inversion}; commands dashed"


_COMMANDED = ("airspeed_m_s", "path_angle_deg", "course_deg", "bank_deg", "alpha_deg")


def draw_tracking(dataset: xr.Dataset, title: str, paths: Sequence[Path]) -> None:
    """Draw path, errors and commands of a flight's first aircraft into new files, up to the planned arrival."""
    mpl, figure = new_figure((7.6, 6.2))
    approach = dataset.isel(aircraft=0)
    approach = approach.sel(time=approach["time"] <= float(approach["arrival_time_s"].values[0]))
    with mpl.rc_context(PRINT_STYLE):
        grid = figure.subplots(3, 3)
        _draw_path(grid[0, 0], approach, ("east_m", "north_m"))
        grid[0, 0].set_aspect("equal", adjustable="datalim")
        _draw_over_time(grid[0, 1], approach, "altitude_m", reference="reference_altitude_m")
        _draw_over_time(grid[0, 2], approach, "position_error_m")
        for axes, name in zip((*grid[1], *grid[2, :2]), _COMMANDED, strict=True):
            _draw_over_time(axes, approach, name, reference=_command(name))
        _draw_over_time(grid[2, 2], approach, *(f"{name}_deg" for name in surface_names(dataset)))
        for axes in grid[2]:
            axes.set_xlabel("Time $t$ (s)")
        worst = float(approach["position_error_m"].max())
        note = f"position error {worst:.2f} m at most; requested values are dashed"
        figure.suptitle(f"{escape_mathtext(title)}\n{note}", fontsize=LARGE)
        figure.align_ylabels()
        save_figure(figure, paths)


def _draw_path(axes: "Axes", approach: xr.Dataset, names: tuple[str, str]) -> None:
    x, y = (approach[name].values for name in names)
    axes.plot(x, y, color=color_of(0), label="flown")
    reference = (approach[f"reference_{name}"].values for name in names)
    axes.plot(*reference, label="planned", **COMMAND_LINE)
    for set_label, name in zip((axes.set_xlabel, axes.set_ylabel), names, strict=True):
        set_label(axis_label(approach[name]))
    axes.legend(loc="best")


def _draw_over_time(axes: "Axes", approach: xr.Dataset, *names: str, reference: str | None = None) -> None:
    has_standard_symbols = all(name.removesuffix("_deg") in STANDARD_SURFACES for name in names)
    time, several = approach["time"].values, len(names) > 1
    for k, name in enumerate(names):
        attributes = approach[name].attrs
        label = f"${attributes['symbol']}$" if has_standard_symbols else str(attributes["long_name"])
        axes.plot(time, approach[name].values, **series_style(k), label=label if several else None)
    if reference is not None:
        axes.plot(time, approach[reference].values, zorder=3, **COMMAND_LINE)
    if several:
        axes.set_ylabel(f"Deflection ({display_unit(approach[names[0]])})")
        axes.legend(loc="best")
    else:
        axes.set_ylabel(axis_label(approach[names[0]]))
