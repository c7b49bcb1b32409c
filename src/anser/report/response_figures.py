"""Figures of an aircraft's response to commands.

Step tests of the autopilot's loops, an overview of several step tests, and path tracking of one aircraft.
"""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.labels import axis_label, display_unit, escape_mathtext, math_symbol
from anser.report.style import (
    DASHED,
    INK,
    LARGE,
    MUTED,
    PRINT_STYLE,
    SMALL,
    color_of,
    new_figure,
    save_figure,
    series_style,
)
from anser.results.dataset import surface_names
from anser.variables import STANDARD_SURFACES

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_RATES = ("roll_rate_deg_s", "pitch_rate_deg_s", "yaw_rate_deg_s")
_PATH = ("path_angle_deg", "course_deg")
_CHANNELS = {
    "rates": _RATES,
    "attitude": ("bank_deg", "alpha_deg", "beta_deg"),
    "velocity": ("airspeed_m_s", *_PATH),
}
_UNCOMMANDED_CHANNELS = {
    "rates": (_CHANNELS["attitude"], _PATH, ("airspeed_m_s",)),
    "attitude": (_RATES, _PATH, ("airspeed_m_s",)),
    "velocity": (("bank_deg", "alpha_deg"), ("beta_deg",), _RATES),
}
"""Variables outside the commanded loop, by loop, in three panels."""
_ENGINE = (("throttle",), ("power_percent",))

_TRANSIENT_S = 15.0
"""Time after which the fast responses are over, s: the two lower rows of a long test show no more than this."""

_SHARED_LABELS = {"degree": "Angle (°)", "degree s-1": "Rate (°/s)"}
"""Axis labels of panels with several variables, by unit."""
_SPAN_MIN = {"m s-1": 1.0, "degree": 1.0, "degree s-1": 1.0, "percent": 5.0, "1": 0.05}
"""Least range of a panel's axis by unit, so that a nearly constant variable looks constant."""

_LEGEND_FONT_SIZE = 6.5  # in panels with several curves
_LINE_LENGTH = 22
"""Line length of a label, in characters."""


def draw_step(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw one step test: the channels of the commanded loop with their commands, other variables, and controls.

    Parameters
    ----------
    dataset
        Result of `anser.analysis.fly_steps` for one flight.
    paths
        New files, with suffixes of `FIGURE_SUFFIXES`.
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
    """Draw the commanded channels of several tests in percent of their steps: a panel for each test, in rows of four.

    Parameters
    ----------
    datasets
        Flights of one aircraft from one trim point.
    paths
        New files, with suffixes of `FIGURE_SUFFIXES`.
    """
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
                is_before_reading = time <= dataset.attrs["read_at_s"]
                axes.plot(
                    time[is_before_reading],
                    progress[is_before_reading],
                    **series_style(k),
                    label=f"{math_symbol(dataset[name])} {_size(dataset, name)}",
                )
            end = dataset.attrs["read_at_s"]
            axes.plot([-lead, 0, 0, end], [0, 0, 100, 100], color=INK, linestyle=DASHED, linewidth=0.9, zorder=3)
            axes.set_xlim(-_lead(dataset, end), end)
            axes.legend(loc="lower right")
        for axes in grid.flat[len(datasets) :]:
            axes.set_visible(False)
        for panels in grid:
            panels[0].set_ylabel("Part of the step (%)")
        for axes in grid[-1]:
            axes.set_xlabel("Time $t$ (s)")
        figure.suptitle(
            f"Responses to steps of each channel alone and of a loop's three together\n{_conditions(datasets[0])}",
            fontsize=LARGE,
        )
        save_figure(figure, paths)


def _draw_panel(axes: "Axes", dataset: xr.Dataset, names: Sequence[str]) -> None:
    """Draw variables of one unit over time: the responses, and the commands of the commanded variables."""
    unit = str(dataset[names[0]].attrs["units"])
    curves = []
    for k, name in enumerate(names):
        line_style: dict[str, Any] = series_style(k) if len(names) > 1 else {"color": color_of(k)}
        time, values = _with_lead(dataset, dataset[name].values, dataset[name].values[0])
        axes.plot(time, values, **line_style, label=_label(dataset[name]))
        curves.append(values)
        if _command(name) in dataset:
            commanded = name in dataset.attrs["commanded"]
            _, command = _with_lead(dataset, dataset[_command(name)].values, values[0])
            axes.step(
                time,
                command,
                where="pre",
                color=INK if commanded else MUTED,
                linestyle=DASHED,
                linewidth=0.9,
                label="command" if commanded else "held",
            )
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
    """Shade the time after the one at which the metrics of the step are read, if the test continues beyond it."""
    reading_s, end = dataset.attrs["read_at_s"], float(dataset["time"].values[-1])
    if end - reading_s < 0.5 * (dataset["time"].values[1] - dataset["time"].values[0]):
        return
    for axes in grid.flat:
        axes.axvspan(reading_s, end, color="#8c959f", alpha=0.13, linewidth=0)
    grid[0, 2].text(
        end,
        1.0,
        f"after the reading at {reading_s:g} s",
        transform=grid[0, 2].get_xaxis_transform(),
        fontsize=SMALL,
        color=MUTED,
        ha="right",
        va="bottom",
    )


def _lead(dataset: xr.Dataset, end: float | None = None) -> float:
    """Return the time shown before the step, s."""
    return 0.04 * (float(dataset["time"].values[-1]) if end is None else end)


def _with_lead(dataset: xr.Dataset, values: np.ndarray, initial_value: float) -> tuple[np.ndarray, np.ndarray]:
    """Return time and values of a variable, extended by its value at the trim point before the step."""
    time = dataset["time"].values
    return np.concatenate([[-_lead(dataset), 0.0], time]), np.concatenate([[initial_value, initial_value], values])


def _command(name: str) -> str:
    """Return the name of the command of a variable: roll_rate_deg_s -> roll_rate_command_deg_s."""
    for suffix in ("_deg_s", "_m_s", "_deg"):
        if name.endswith(suffix):
            return f"{name.removesuffix(suffix)}_command{suffix}"
    return f"{name}_command"


def _label(values: xr.DataArray, unit: str = "") -> str:
    """Return long name and symbol of a variable, and a unit if given, wrapped."""
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
    return (
        f"{attributes['aircraft']}{variant} from level trim at {attributes['speed_m_s']:g} m/s, "
        f"{attributes['altitude_m']:g} m; {inversion}; commands dashed"
    )


_COMMANDED = ("airspeed_m_s", "path_angle_deg", "course_deg", "bank_deg", "alpha_deg")


def draw_tracking(dataset: xr.Dataset, title: str, paths: Sequence[Path]) -> None:
    """Draw the path tracking of the first aircraft until its arrival.

    Parameters
    ----------
    dataset
        A flight from `anser.results`.
    title
        First line of the figure's heading.
    paths
        New files, with suffixes of `FIGURE_SUFFIXES`.
    """
    mpl, figure = new_figure((7.6, 6.2))
    first_aircraft = dataset.isel(aircraft=0)
    approach = first_aircraft.isel(
        time=np.flatnonzero(first_aircraft["time"].values <= float(first_aircraft["arrival_time_s"].values[0]))
    )
    with mpl.rc_context(PRINT_STYLE):
        grid = figure.subplots(3, 3)
        _draw_path(grid[0, 0], approach, ("east_m", "north_m"))
        grid[0, 0].set_aspect("equal", adjustable="datalim")
        _draw_over_time(grid[0, 1], approach, ("altitude_m",), {"altitude_m": "reference_altitude_m"})
        _draw_over_time(grid[0, 2], approach, ("position_error_m",), {})
        for axes, name in zip((*grid[1], *grid[2, :2]), _COMMANDED, strict=True):
            command = name.replace("_m_s", "_command_m_s").replace("_deg", "_command_deg")
            _draw_over_time(axes, approach, (name,), {name: command})
        _draw_over_time(grid[2, 2], approach, [f"{name}_deg" for name in surface_names(dataset)], {})
        for axes in grid[2]:
            axes.set_xlabel("Time $t$ (s)")
        worst = float(approach["position_error_m"].max())
        note = f"position error {worst:.2f} m at most; what was asked for is dashed"
        figure.suptitle(f"{escape_mathtext(title)}\n{note}", fontsize=LARGE)
        figure.align_ylabels()
        save_figure(figure, paths)


def _draw_path(axes: "Axes", approach: xr.Dataset, names: tuple[str, str]) -> None:
    x, y = (approach[name].values for name in names)
    axes.plot(x, y, color=color_of(0), label="flown")
    reference = (approach[f"reference_{name}"].values for name in names)
    axes.plot(*reference, color=INK, linestyle=DASHED, linewidth=0.9, label="planned")
    for set_label, name in zip((axes.set_xlabel, axes.set_ylabel), names, strict=True):
        set_label(axis_label(approach[name]))
    axes.legend(loc="best")


def _draw_over_time(axes: "Axes", approach: xr.Dataset, names: Sequence[str], references: dict[str, str]) -> None:
    has_standard_symbols = all(name.removesuffix("_deg") in STANDARD_SURFACES for name in names)
    for k, name in enumerate(names):
        variable_label = (
            f"${approach[name].attrs['symbol']}$" if has_standard_symbols else str(approach[name].attrs["long_name"])
        )
        label = variable_label if len(names) > 1 else None
        axes.plot(approach["time"].values, approach[name].values, **series_style(k), label=label)
        if name in references:
            axes.plot(
                approach["time"].values,
                approach[references[name]].values,
                color=INK,
                linestyle=DASHED,
                linewidth=0.9,
                zorder=3,
            )
    axes.set_ylabel(
        axis_label(approach[names[0]]) if len(names) == 1 else f"Deflection ({display_unit(approach[names[0]])})"
    )
    if len(names) > 1:
        axes.legend(loc="best")
