"""Figures of an aircraft's response.

Step tests of the autopilot's loops with an overview of several, and path tracking of one aircraft.
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
_OTHERS = {
    "rates": (_CHANNELS["attitude"], _PATH, ("airspeed_m_s",)),
    "attitude": (_RATES, _PATH, ("airspeed_m_s",)),
    "velocity": (("bank_deg", "alpha_deg"), ("beta_deg",), _RATES),
}
"""What the loops that were not commanded did, three panels."""
_ENGINE = (("throttle",), ("power_percent",))

_BEGINNING_S = 15.0
"""Of a long test, what the two lower rows show: by then all that is quick is over."""

_KINDS = {"degree": "Angle (°)", "degree s-1": "Rate (°/s)"}
"""What panels of several variables are labelled with, by their unit."""
_SPAN_MIN = {"m s-1": 1.0, "degree": 1.0, "degree s-1": 1.0, "percent": 5.0, "1": 0.05}
"""Least height of a panel: what hardly moves must not look as if it did."""

_TINY = 6.5  # of legends that stand among curves
_LINE_LENGTH = 22
"""Characters of a label before it goes on in another line."""


def draw_step(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw one step test: the loop's own channels with their commands dashed, the other loops', the controls.

    Parameters
    ----------
    dataset
        Of one flight, as `anser.analysis.fly_steps` makes it.
    paths
        New files to write, with one of `FIGURE_SUFFIXES`.
    """
    mpl, figure = new_figure((7.6, 5.9))
    with mpl.rc_context(PRINT_STYLE):
        loop = dataset.attrs["loop"]
        surfaces = tuple(f"{name}_deg" for name in surface_names(dataset))
        panels = [*((name,) for name in _CHANNELS[loop]), *_OTHERS[loop], surfaces, *_ENGINE]
        grid = figure.subplots(3, 3, sharex="row")
        end = float(dataset["time"].values[-1])
        shown = dataset if end <= 2 * _BEGINNING_S else dataset.sel(time=slice(0.0, _BEGINNING_S))
        for k, (axes, names) in enumerate(zip(grid.flat, panels, strict=True)):
            _panel(axes, dataset if k < 3 else shown, names)
        for axes in (*grid[0], *grid[-1]) if shown is not dataset else grid[-1]:
            axes.set_xlabel("Time $t$ (s)")
        if shown is dataset:
            for axes in grid[:-1].flat:
                axes.tick_params(labelbottom=False)
        _mark_reading(grid, dataset)
        figure.suptitle(f"{_heading(dataset)}\n{_about(dataset)}", fontsize=LARGE)
        figure.align_ylabels()
        save_figure(figure, paths)


def draw_overview(datasets: Sequence[xr.Dataset], paths: Sequence[Path]) -> None:
    """Draw the commanded channels of several tests as parts of their steps: a panel for each test, in rows of four.

    Parameters
    ----------
    datasets
        Of flights of one aircraft from one trim point.
    paths
        As for `draw_step`.
    """
    rows = -(-len(datasets) // 4)
    mpl, figure = new_figure((7.6, 0.7 + 1.75 * rows))
    with mpl.rc_context(PRINT_STYLE):
        grid = figure.subplots(rows, 4, sharey=True, squeeze=False)
        for axes, dataset in zip(grid.flat, datasets, strict=False):
            lead = _lead(dataset)
            for k, name in enumerate(_CHANNELS[dataset.attrs["loop"]]):
                if name not in dataset.attrs["commanded"]:
                    continue
                values, step = dataset[name].values, float(dataset[_command(name)].values[0]) - dataset[name].values[0]
                time, progress = _with_lead(dataset, 100 * (values - values[0]) / step, 0.0)
                read = time <= dataset.attrs["read_at_s"]
                axes.plot(
                    time[read],
                    progress[read],
                    **series_style(k),
                    label=f"{math_symbol(dataset[name])} {_size(dataset, name)}",
                )
            end = dataset.attrs["read_at_s"]
            axes.plot([-lead, 0, 0, end], [0, 0, 100, 100], color=INK, linestyle=DASHED, linewidth=0.9, zorder=3)
            axes.set_xlim(-_lead(dataset, end), end)
            axes.legend(loc="lower right")
        for axes in grid.flat[len(datasets) :]:
            axes.set_visible(False)
        for row in grid:
            row[0].set_ylabel("Part of the step (%)")
        for axes in grid[-1]:
            axes.set_xlabel("Time $t$ (s)")
        figure.suptitle(
            f"Responses to steps of each channel alone and of a loop's three together\n{_about(datasets[0])}",
            fontsize=LARGE,
        )
        save_figure(figure, paths)


def _panel(axes: "Axes", dataset: xr.Dataset, names: Sequence[str]) -> None:
    """Draw variables of one unit over time: their responses, and the commands of those that were commanded."""
    stored = str(dataset[names[0]].attrs["units"])
    drawn = []
    for k, name in enumerate(names):
        look: dict[str, Any] = series_style(k) if len(names) > 1 else {"color": color_of(k)}
        time, values = _with_lead(dataset, dataset[name].values, dataset[name].values[0])
        axes.plot(time, values, **look, label=_label(dataset[name]))
        drawn.append(values)
        if _command(name) in dataset:
            commanded = name in dataset.attrs["commanded"]
            _, wanted = _with_lead(dataset, dataset[_command(name)].values, values[0])
            axes.step(
                time,
                wanted,
                where="pre",
                color=INK if commanded else MUTED,
                linestyle=DASHED,
                linewidth=0.9,
                label="command" if commanded else "held",
            )
            drawn.append(wanted)
    low, high = (float(f(np.concatenate(drawn))) for f in (np.min, np.max))
    if np.isfinite([low, high]).all():
        margin = max(0.08 * (high - low), 0.5 * (_SPAN_MIN[stored] - (high - low)))
        axes.set_ylim(low - margin, high + margin)
    if len(names) == 1:
        axes.set_ylabel(_label(dataset[names[0]], display_unit(dataset[names[0]])))
        if _command(names[0]) in dataset:
            axes.legend(handles=axes.lines[1:], loc="best")
    else:
        axes.set_ylabel(_KINDS[stored])
        axes.legend(loc="best", fontsize=_TINY, handlelength=1.9, labelspacing=0.3)
    axes.set_xlim(-_lead(dataset), float(dataset["time"].values[-1]))


def _mark_reading(grid: np.ndarray, dataset: xr.Dataset) -> None:
    """Grey what comes after the reading, where there is anything."""
    read, end = dataset.attrs["read_at_s"], float(dataset["time"].values[-1])
    if end - read < 0.5 * (dataset["time"].values[1] - dataset["time"].values[0]):
        return
    for axes in grid.flat:
        axes.axvspan(read, end, color="#8c959f", alpha=0.13, linewidth=0)
    grid[0, 2].text(
        end,
        1.0,
        f"after the reading at {read:g} s",
        transform=grid[0, 2].get_xaxis_transform(),
        fontsize=SMALL,
        color=MUTED,
        ha="right",
        va="bottom",
    )


def _lead(dataset: xr.Dataset, end: float | None = None) -> float:
    """Time drawn before the step, s."""
    return 0.04 * (float(dataset["time"].values[-1]) if end is None else end)


def _with_lead(dataset: xr.Dataset, values: np.ndarray, before: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and values with the trim point before the step."""
    time = dataset["time"].values
    return np.concatenate([[-_lead(dataset), 0.0], time]), np.concatenate([[before, before], values])


def _command(name: str) -> str:
    """Name of the command of a variable: roll_rate_deg_s -> roll_rate_command_deg_s."""
    for suffix in ("_deg_s", "_m_s", "_deg"):
        if name.endswith(suffix):
            return f"{name.removesuffix(suffix)}_command{suffix}"
    return f"{name}_command"


def _label(values: xr.DataArray, printed: str = "") -> str:
    """Words, symbol and, where one is given, unit; long ones in two lines."""
    words = textwrap.fill(str(values.attrs["long_name"]), _LINE_LENGTH) + f" {math_symbol(values)}"
    return f"{words} ({printed})" if printed else words


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


def _about(dataset: xr.Dataset) -> str:
    of = dataset.attrs
    inversion = {"model": "inversion of the model", "incremental": "incremental inversion"}[of["inversion"]]
    variant = f" ({of['variant']})" if "variant" in of else ""
    return (
        f"{of['aircraft']}{variant} from level trim at {of['speed_m_s']:g} m/s, {of['altitude_m']:g} m; "
        f"{inversion}; commands dashed"
    )


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
        _over_time(grid[2, 2], flown, [f"{name}_deg" for name in surface_names(dataset)], {})
        for axes in grid[2]:
            axes.set_xlabel("Time $t$ (s)")
        worst = float(flown["position_error_m"].max())
        note = f"position error {worst:.2f} m at most; what was asked for is dashed"
        figure.suptitle(f"{escape_mathtext(title)}\n{note}", fontsize=LARGE)
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
        axes.plot(flown["time"].values, flown[name].values, **series_style(k), label=label)
        if name in wanted:
            axes.plot(
                flown["time"].values, flown[wanted[name]].values, color=INK, linestyle=DASHED, linewidth=0.9, zorder=3
            )
    axes.set_ylabel(axis_label(flown[names[0]]) if len(names) == 1 else f"Deflection ({display_unit(flown[names[0]])})")
    if len(names) > 1:
        axes.legend(loc="best")
