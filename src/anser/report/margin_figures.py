"""Figures of stability margins: Bode and Nyquist diagrams of one trim point, maps over the envelope."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.labels import aircraft_title
from anser.report.map_panels import EMPTY_COLOR, draw_cells, draw_column, draw_marks, map_panels
from anser.report.style import FIGURE_SUFFIXES, MAP_STYLE, color_of, new_figure, save_drawings, save_figure
from anser.variables import surface_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


BODE_SUFFIXES = FIGURE_SUFFIXES
"""File formats of a Bode diagram."""
_AUTOPILOT_LOOPS = {"Body rates": ("P", "Q", "R"), "Attitude": ("mu", "alpha")}
"""Loops of the autopilot by group; all other loops are opened at an actuator or the engine."""
_ENGINE = "throttle"
_SYMBOLS = {"P": "$P$", "Q": "$Q$", "R": "$R$", "mu": r"$\mu$", "alpha": r"$\alpha$"}
_GAIN_RANGE_DB, _PHASE_RANGE_DEG = (-50.0, 50.0), (-360.0, 0.0)
_LINE, _SHORT_MARGIN, _UNSTABLE, _HELD_BACK = "#57606a", "#d55e00", "#000000", "#b8b8b8"
_STYLE = {
    **MAP_STYLE,
    "svg.hashsalt": "anser-margins",
    "legend.fontsize": 7.5,
    "legend.framealpha": 0.85,
    "mathtext.fontset": "dejavusans",
}


def draw_bode(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw Bode and Nyquist diagrams of every loop of one trim point, with the margins marked.

    Parameters
    ----------
    dataset
        Result of `anser.analysis.margins`, with a stable closed loop.
    paths
        New files, with suffixes of `BODE_SUFFIXES`.
    """
    mpl, figure = new_figure((11.0, 9.0))
    with mpl.rc_context(_STYLE):
        groups = {"Actuators and engine": (*_actuator_breakpoints(dataset), _ENGINE), **_AUTOPILOT_LOOPS}
        grid = figure.add_gridspec(3, len(groups), height_ratios=[1.0, 1.0, 1.5])
        for k, (title, names) in enumerate(groups.items()):
            gain, phase, nyquist = (figure.add_subplot(grid[grid_row, k]) for grid_row in range(3))
            gain.set_title(title)
            _bode(gain, phase, dataset, names)
            _nyquist(nyquist, dataset, names)
            if k == 0:
                gain.set_ylabel("gain of the loop (dB)")
                phase.set_ylabel("phase of the loop (°)")
                nyquist.set_ylabel("imaginary part")
        attributes = dataset.attrs
        figure.suptitle(
            f"Loops broken one at a time: {aircraft_title(dataset)} at {attributes['speed_m_s']:g} m/s, "
            f"{attributes['altitude_m']:g} m, {attributes['inversion']} inversion, "
            f"sampled every {1000 * attributes['step_s']:g} ms\n"
            f"Triangles: gain margins. Dots: phase margins. Shaded: closer to -1 than "
            f"{attributes['gain_min_db']:g} dB, or {attributes['phase_min_deg']:g}° at the unit circle",
            fontsize=10,
        )
        save_figure(figure, paths)


def draw_margin_maps(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw the stability margins over the envelope into SVG and PNG files `actuators` and `loops`; return the paths.

    Parameters
    ----------
    dataset
        Dataset of `anser.analysis.survey_margins`.
    """
    drawings = {"actuators": _actuators, "loops": _loops}
    return save_drawings(drawings, dataset, _STYLE, folder)


def _bode(gain: "Axes", phase: "Axes", dataset: xr.Dataset, names: Sequence[str]) -> None:
    omega = dataset["frequency"].values
    gain_min, phase_min = dataset.attrs["gain_min_db"], dataset.attrs["phase_min_deg"]
    for k, name in enumerate(names):
        loop = dataset.sel(breakpoint=name)
        colour = color_of(k)
        label = _loop_symbol(name)
        gain.semilogx(omega, loop["loop_gain_db"].values, color=colour, lw=1.2, label=label)
        degrees = loop["loop_phase_deg"].values
        wrapped = np.mod(degrees, 360.0) - 360.0
        # no line across the panel at a wrap
        wrapped[1:][np.abs(np.diff(wrapped)) > 180.0] = np.nan
        phase.semilogx(omega, wrapped, color=colour, lw=1.2, label=label)
        for frequency, size, marker in (
            (loop["gain_up_at_rad_s"].item(), -loop["gain_up_db"].item(), "^"),
            (loop["gain_down_at_rad_s"].item(), loop["gain_down_db"].item(), "v"),
        ):
            if np.isfinite(frequency) and np.isfinite(size):
                gain.plot([frequency, frequency], [0.0, size], color=colour, lw=0.8)
                gain.plot([frequency], [size], marker, color=colour, ms=5)
        frequency = loop["crossover_rad_s"].item()
        if np.isfinite(frequency):
            phase_at_crossover = float(np.interp(np.log(frequency), np.log(omega), degrees)) % 360 - 360
            phase.plot([frequency, frequency], [-180, phase_at_crossover], color=colour, lw=0.8)
            phase.plot([frequency], [phase_at_crossover], "o", color=colour, ms=4)
    gain.axhline(0.0, color=_LINE, lw=0.8)
    gain.axhspan(-gain_min, gain_min, color=_SHORT_MARGIN, alpha=0.15, lw=0)
    gain.set_ylim(*_GAIN_RANGE_DB)
    phase.axhline(-180.0, color=_LINE, lw=0.8)
    phase.axhspan(-180 - phase_min, -180 + phase_min, color=_SHORT_MARGIN, alpha=0.15, lw=0)
    phase.set_ylim(*_PHASE_RANGE_DEG)
    phase.set_yticks(np.arange(-360, 1, 90))
    phase.set_xlabel("frequency (rad/s)")
    gain.tick_params(labelbottom=False)
    gain.legend(loc="lower left")
    for axes in (gain, phase):
        axes.set_xlim(omega[0], omega[-1])
        axes.grid(color=EMPTY_COLOR, lw=0.5)


def _nyquist(axes: "Axes", dataset: xr.Dataset, names: Sequence[str]) -> None:
    """Draw the frequency responses near -1, and the forbidden diamond around -1.

    The corners of the diamond are the required gain and phase margins.
    """
    angles = np.linspace(0, 2 * np.pi, 181)
    axes.plot(np.cos(angles), np.sin(angles), color=_LINE, lw=0.6)
    factor, angle = 10 ** (dataset.attrs["gain_min_db"] / 20), np.radians(dataset.attrs["phase_min_deg"])
    corner = (-np.cos(angle), np.sin(angle))
    axes.fill(
        [-factor, corner[0], -1 / factor, corner[0]],
        [0.0, corner[1], 0.0, -corner[1]],
        color=_SHORT_MARGIN,
        alpha=0.15,
        lw=0,
    )
    for k, name in enumerate(names):
        breakpoint_data = dataset.sel(breakpoint=name)
        loop = 10 ** (breakpoint_data["loop_gain_db"].values / 20) * np.exp(
            1j * np.radians(breakpoint_data["loop_phase_deg"].values)
        )
        axes.plot(loop.real, loop.imag, color=color_of(k), lw=1.2)
    axes.plot([-1.0], [0.0], "+", color=_UNSTABLE, ms=9, mew=1.5)
    axes.set_xlim(-2.5, 1.5)
    axes.set_ylim(-2.5, 1.5)
    axes.set_aspect("equal")
    axes.set_xlabel("real part")
    axes.grid(color=EMPTY_COLOR, lw=0.5)


def _loop_symbol(breakpoint: str) -> str:
    return _SYMBOLS.get(breakpoint, surface_label(breakpoint))


def _actuator_breakpoints(dataset: xr.Dataset) -> list[str]:
    inner = {_ENGINE, *(name for group in _AUTOPILOT_LOOPS.values() for name in group)}
    return [name for name in dataset["breakpoint"].values.tolist() if name not in inner]


def _actuators(dataset: xr.Dataset) -> "Figure":
    names = _actuator_breakpoints(dataset)
    notes = _notes(dataset, "Least of " + ", ".join(map(_loop_symbol, names)) + ", one loop broken at a time.")
    figure, axes, colorbar_axes = map_panels(dataset, 4, 12.0, "Margins at the actuators", notes)
    actuator_data = dataset.sel(breakpoint=names)
    columns = (
        ("gain margin (dB)", "gain_margin_db", (0.0, 12.0)),
        ("phase margin (°)", "phase_margin_deg", (0.0, 90.0)),
        ("delay margin (ms)", "delay_margin_ms", (0.0, 40.0)),
        ("disk margin, all at once", "actuators_disk_margin", (0.0, 2.0)),
    )
    is_short = np.any(actuator_data["short"].values, axis=-1)
    for k, (label, name, color_range) in enumerate(columns):
        values = actuator_data[name].values
        least_margin = values.min(axis=-1) if values.ndim == 4 else values
        draw_column(
            figure,
            axes[:, k],
            colorbar_axes[k],
            dataset,
            np.minimum(least_margin, color_range[1]),
            label,
            **_scale(*color_range),
        )
        for c in range(len(axes)):
            _mark(axes[c, k], dataset, c, is_short[c])
    return figure


def _loops(dataset: xr.Dataset) -> "Figure":
    actuators = _actuator_breakpoints(dataset)
    names = [name for name in dataset["breakpoint"].values.tolist() if name not in actuators]
    notes = _notes(dataset, "Disk margin of each loop: gain and phase change at the same time.")
    figure, axes, colorbar_axes = map_panels(
        dataset, len(names), 1.2 + 2.2 * len(names), "Loops inside the autopilot", notes
    )
    for k, name in enumerate(names):
        loop = dataset.sel(breakpoint=name)
        axes[0, k].set_title(_loop_symbol(name))
        disk = np.minimum(loop["disk_margin"].values, 2.0)
        draw_column(figure, axes[:, k], colorbar_axes[k], dataset, disk, "disk margin", **_scale(0.0, 2.0))
        for c in range(len(axes)):
            _mark(axes[c, k], dataset, c, loop["short"].values[c])
    return figure


def _notes(dataset: xr.Dataset, first_line: str) -> tuple[str, str]:
    attributes = dataset.attrs
    return (
        first_line,
        f"Cross: less than {attributes['gain_min_db']:g} dB or {attributes['phase_min_deg']:g}°. Black: unstable. "
        "Dark grey: held back by a limit of the autopilot. Light grey: no steady flight.",
    )


def _scale(low: float, high: float) -> dict[str, Any]:
    """Return the colour scale of a margin; values beyond it, infinity included, take the colour at its end."""
    return {"extend": "max", "cmap": "viridis", "vmin": low, "vmax": high}


def _mark(axes: "Axes", dataset: xr.Dataset, condition: int, is_short: np.ndarray) -> None:
    from matplotlib.colors import ListedColormap

    meanings = dataset["closed_loop"].attrs["flag_meanings"].split()
    state = dataset["closed_loop"].values[condition]
    for state_name, colour in (("held_back", _HELD_BACK), ("unstable", _UNSTABLE)):
        cells = np.where(state == meanings.index(state_name), 1.0, np.nan)
        if np.isfinite(cells).any():
            draw_cells(axes, dataset, cells, cmap=ListedColormap([colour]))
    draw_marks(axes, dataset, is_short, marker="x", color=_SHORT_MARGIN, s=18, linewidths=1.4)
