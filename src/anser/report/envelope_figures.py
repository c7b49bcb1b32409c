"""Figures over the flight envelope: trim, flown commands, stability margins; Bode diagrams of one trim point."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.labels import aircraft_title
from anser.report.style import MAP_STYLE, color_of, new_figure, save_drawings, save_figure
from anser.variables import surface_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


EMPTY_COLOR = "#e6e6e6"
"""Colour of grid cells without a value."""


class EnvelopeMap:
    """Figure of a survey of the flight envelope: panels over Mach number and altitude.

    Each flight condition has a row of panels. Each quantity has a column of panels with a colour bar below. Aircraft
    and type of inversion are added to `title`; `notes` are lines of text below the title; `width` is in inches.
    """

    def __init__(self, dataset: xr.Dataset, columns: int, width: float, title: str, *notes: str) -> None:
        conditions = dataset["condition_meaning"].values
        row_count = len(conditions)
        _, self.figure = new_figure((width, 1.6 + 2.0 * row_count))
        grid = self.figure.add_gridspec(row_count + 1, columns, height_ratios=[1.0] * row_count + [0.07])
        self.panels = np.empty((row_count, columns), dtype=object)
        for c, k in np.ndindex(row_count, columns):
            self.panels[c, k] = panel = self.figure.add_subplot(grid[c, k])
            panel.set_facecolor(EMPTY_COLOR)
            panel.tick_params(labelbottom=c == row_count - 1, labelleft=k == 0)
            if k == 0:
                panel.set_ylabel(f"{conditions[c]}\naltitude (km)")
            if c == row_count - 1:
                panel.set_xlabel("Mach number")
        self.colorbar_axes = [self.figure.add_subplot(grid[row_count, k]) for k in range(columns)]
        heading = f"{title}: {aircraft_title(dataset)}, {dataset.attrs['inversion']} inversion"
        self.figure.suptitle("\n".join([heading, *notes]), fontsize=10)
        self.mach, self.altitude_km = dataset["mach"].values, dataset["altitude"].values / 1000.0

    def draw_column(self, k: int, values: np.ndarray, label: str, extend: str | None = None, **style: Any) -> None:
        """Draw `values`, shape (condition, altitude, mach), in column `k` of panels, with a labelled colour bar below.

        `extend` ("min", "max" or "both") selects the pointed ends of the colour bar; `style` has matplotlib properties.
        """
        for axes, cells in zip(self.panels[:, k], values, strict=True):
            self.draw_cells(axes, cells, **style)
        cells = self.panels[0, k].collections[0]
        self.figure.colorbar(cells, cax=self.colorbar_axes[k], orientation="horizontal", label=label, extend=extend)

    def draw_cells(self, axes: "Axes", values: np.ndarray, **style: Any) -> None:
        """Draw a cell around each grid point, coloured by `values`, shape (altitude, mach); NaN leaves a cell empty."""
        mach, altitude = _edges(self.mach), _edges(self.altitude_km)
        axes.pcolormesh(mach, altitude, np.ma.masked_invalid(values), linewidth=0.2, edgecolors="white", **style)
        axes.set_xlim(mach[0], mach[-1])
        axes.set_ylim(altitude[0], altitude[-1])

    def draw_marks(self, axes: "Axes", mask: np.ndarray, **style: Any) -> None:
        """Draw a mark at each grid point at which `mask`, shape (altitude, mach), is True."""
        altitude, mach = np.nonzero(mask)
        axes.scatter(self.mach[mach], self.altitude_km[altitude], **style)


def _edges(centres: np.ndarray) -> np.ndarray:
    if centres.size == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    between = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - between[0]], between, [2 * centres[-1] - between[-1]]])


_DOTS: dict[str, Any] = {"marker": ".", "color": "white", "s": 6.0, "linewidths": 0.0}
_LOAD_FACTOR = ("limited: load factor", "#e8c3d8")
_OUTSIDE_ANGLES = ("failed: alpha, beta leave the data", "#000000")
_OUTSIDE_ALTITUDE = ("limited: altitude, Mach leave the data", "#a6a6a6")
_REASONS = {
    "reached": ("reached", "#009e73"),
    "thrust_max": ("limited: full thrust", "#56b4e9"),
    "thrust_idle": ("limited: idle thrust", "#b5deff"),
    "alpha": ("limited: alpha", "#cc79a7"),
    "load_factor": _LOAD_FACTOR,
    "unloading": _LOAD_FACTOR,
    "bank": ("limited: bank", "#0072b2"),
    "tables_altitude": _OUTSIDE_ALTITUDE,
    "tables_mach": _OUTSIDE_ALTITUDE,
    "body_rates": ("failed: body rates", "#f0e442"),
    "surfaces": ("failed: surface stops", "#e69f00"),
    "surface_rates": ("failed: surface rates", "#d55e00"),
    "tables_alpha": _OUTSIDE_ANGLES,
    "tables_beta": _OUTSIDE_ANGLES,
    "start_beyond_limits": ("start beyond the autopilot's limits", "#8a5a7a"),
    "unexplained": ("failed: unexplained", "#ff00ff"),
}
"""Legend text and colour of each reason that limited or ended a flight, by name of the reason.

Limited flights are blue, pink and grey; failed flights are yellow to black (colours of Okabe and Ito, and tints)."""
_FAILED_AFTER_BAD_START = ("failed, from a start beyond the limits", "#2b0f24")


def draw_envelope(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a result of `anser.analysis.envelope` into new files `trim-map`, `commands` and `margins`, SVG and PNG.

    Returns the paths. Raises FileExistsError if one of the files exists.
    """
    drawings = {"trim-map": _draw_trims, "commands": _draw_commands, "margins": _draw_least_margins}
    return save_drawings(drawings, dataset, {**MAP_STYLE, "svg.hashsalt": "anser-envelope"}, folder)


def _commanded(dataset: xr.Dataset) -> np.ndarray:
    """Return the mask, shape (surface,), of the surfaces that are commanded, not scheduled; all in an older dataset."""
    if "is_commanded" not in dataset:
        return np.ones(dataset.sizes["surface"], dtype=bool)
    return dataset["is_commanded"].values.astype(bool)


def _draw_trims(dataset: xr.Dataset) -> "Figure":
    note = "Grey: no steady flight. Dots: a tenth or more of power and surfaces left."
    envelope_map = EnvelopeMap(dataset, 3, 9.5, "Steady flight", note)
    trimmable = dataset["trimmable"].values.astype(bool)
    with_reserve = dataset["with_reserve"].values.astype(bool)
    least_surface = dataset["surface_left"].values[..., _commanded(dataset)].min(axis=-1)
    columns = (
        ("angle of attack (deg)", dataset["alpha_deg"].values, "viridis", (-5.0, 45.0)),
        ("engine power (percent)", dataset["power_percent"].values, "cividis", (0.0, 100.0)),
        ("way left to the nearest surface stop (part)", least_surface, "magma", (0.0, 1.0)),
    )
    for k, (label, values, colormap, (low, high)) in enumerate(columns):
        visible_values = np.where(trimmable, values, np.nan)
        envelope_map.draw_column(k, visible_values, label, cmap=colormap, vmin=low, vmax=high)
        for axes, mask in zip(envelope_map.panels[:, k], with_reserve, strict=True):
            envelope_map.draw_marks(axes, mask, **_DOTS)
    return envelope_map.figure


def _draw_commands(dataset: xr.Dataset) -> "Figure":
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    reasons = dataset["reason"].attrs["flag_meanings"].split()
    labels = [*dict.fromkeys(_REASONS.values()), _FAILED_AFTER_BAD_START]
    # a flight with the reason "none" reached its command
    label_of_reason = np.array([labels.index(_REASONS["reached" if name == "none" else name]) for name in reasons])
    colormap = ListedColormap([colour for _, colour in labels])
    norm = BoundaryNorm(np.arange(len(labels) + 1) - 0.5, len(labels))
    outcome, reason = dataset["outcome"].values, dataset["reason"].values
    has_failed = outcome == dataset["outcome"].attrs["flag_meanings"].split().index("failed")
    label_index = np.where(outcome > 0, label_of_reason[reason], np.nan)
    failed_after_bad_start = has_failed & (reason == reasons.index("start_beyond_limits"))
    label_index[failed_after_bad_start] = labels.index(_FAILED_AFTER_BAD_START)
    commands = dataset["command_meaning"].values
    note = "Grey: no steady flight to leave from. Dots: a tenth or more of power and surfaces left."
    envelope_map = EnvelopeMap(dataset, len(commands), 1.2 + 2.1 * len(commands), "Commands flown", note)
    with_reserve = dataset["with_reserve"].values.astype(bool)
    for k, command in enumerate(commands):
        envelope_map.panels[0, k].set_title(command)
        envelope_map.colorbar_axes[k].set_axis_off()
        for c, axes in enumerate(envelope_map.panels[:, k]):
            envelope_map.draw_cells(axes, label_index[c, :, :, k], cmap=colormap, norm=norm)
            envelope_map.draw_marks(axes, with_reserve[c], **_DOTS)
    present = sorted({int(k) for k in np.unique(label_index[~np.isnan(label_index)])})
    handles = [Patch(facecolor=labels[k][1], label=labels[k][0]) for k in present]
    envelope_map.figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    return envelope_map.figure


def _draw_least_margins(dataset: xr.Dataset) -> "Figure":
    note = "Blue: within the limit. Red: beyond it. Grey: no steady flight."
    envelope_map = EnvelopeMap(dataset, 4, 12.0, "Least margin over all commands", note)
    attributes = dataset.attrs
    upper_margin = attributes["limit_load_factor_max"] - dataset["load_factor_max"].values
    lower_margin = dataset["load_factor_min"].values - attributes["limit_load_factor_min"]
    surface_share = dataset["surface_share"].values[..., _commanded(dataset)]
    columns = (
        ("alpha to its limit (deg)", attributes["limit_alpha_max_deg"] - dataset["alpha_max_deg"].values, 20.0),
        ("load factor to its limits", np.minimum(upper_margin, lower_margin), 4.0),
        ("body rates to their limits (part)", 1.0 - dataset["body_rate_share"].values.max(axis=-1), 1.0),
        ("surfaces to their stops (part)", 1.0 - surface_share.max(axis=-1), 1.0),
    )
    for k, (label, values, span) in enumerate(columns):
        envelope_map.draw_column(k, values.min(axis=-1), label, cmap="RdBu", vmin=-span, vmax=span)
    return envelope_map.figure


_AUTOPILOT_LOOPS = {"Body rates": ("P", "Q", "R"), "Attitude": ("mu", "alpha")}
"""Control loops inside the autopilot, by group; every further loop is opened at an actuator or at the engine."""
_ENGINE = "throttle"
_SYMBOLS = {"P": "$P$", "Q": "$Q$", "R": "$R$", "mu": r"$\mu$", "alpha": r"$\alpha$"}
_GAIN_RANGE_DB, _PHASE_RANGE_DEG = (-50.0, 50.0), (-360.0, 0.0)
_LINE, _SHORT_MARGIN, _UNSTABLE, _HELD_BACK = "#57606a", "#d55e00", "#000000", "#b8b8b8"
_MARGIN_STYLE = {
    **MAP_STYLE,
    "svg.hashsalt": "anser-margins",
    "legend.fontsize": 7.5,
    "legend.framealpha": 0.85,
    "mathtext.fontset": "dejavusans",
}


def draw_bode(dataset: xr.Dataset, paths: Sequence[Path]) -> None:
    """Draw Bode and Nyquist diagrams of each control loop at one trim point into new files; the suffix sets the format.

    `dataset` must be a result of `anser.analysis.margins`. Raises FileExistsError if one of the files exists.
    """
    mpl, figure = new_figure((11.0, 9.0))
    with mpl.rc_context(_MARGIN_STYLE):
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
    """Draw a result of `anser.analysis.survey_margins` into new SVG and PNG files `actuators` and `loops`."""
    drawings = {"actuators": _actuators, "loops": _loops}
    return save_drawings(drawings, dataset, _MARGIN_STYLE, folder)


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
    """Draw the open-loop frequency responses near -1 and, shaded, a diamond with corners at the required margins."""
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
    margin_map = EnvelopeMap(dataset, 4, 12.0, "Margins at the actuators", *notes)
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
        _draw_margin(margin_map, k, dataset, least_margin, label, color_range, is_short)
    return margin_map.figure


def _loops(dataset: xr.Dataset) -> "Figure":
    actuators = _actuator_breakpoints(dataset)
    names = [name for name in dataset["breakpoint"].values.tolist() if name not in actuators]
    notes = _notes(dataset, "Disk margin of each loop: gain and phase change at the same time.")
    margin_map = EnvelopeMap(dataset, len(names), 1.2 + 2.2 * len(names), "Loops inside the autopilot", *notes)
    for k, name in enumerate(names):
        loop = dataset.sel(breakpoint=name)
        margin_map.panels[0, k].set_title(_loop_symbol(name))
        disk, is_short = loop["disk_margin"].values, loop["short"].values
        _draw_margin(margin_map, k, dataset, disk, "disk margin", (0.0, 2.0), is_short)
    return margin_map.figure


def _notes(dataset: xr.Dataset, first_line: str) -> tuple[str, str]:
    attributes = dataset.attrs
    return (
        first_line,
        f"Cross: less than {attributes['gain_min_db']:g} dB or {attributes['phase_min_deg']:g}°. Black: unstable. "
        "Dark grey: held back by a limit of the autopilot. Light grey: no steady flight.",
    )


def _draw_margin(
    margin_map: EnvelopeMap,
    k: int,
    dataset: xr.Dataset,
    values: np.ndarray,
    label: str,
    color_range: tuple[float, float],
    is_short: np.ndarray,
) -> None:
    """Draw a margin, `values` (condition, altitude, mach), in column `k` of panels.

    Crosses mark points with too small margins (`is_short`). Cells are grey if a limit of the autopilot opens the loop,
    and black if the loop is unstable. Values above `color_range` get the upper colour.
    """
    from matplotlib.colors import ListedColormap

    low, high = color_range
    style: dict[str, Any] = {"extend": "max", "cmap": "viridis", "vmin": low, "vmax": high}
    margin_map.draw_column(k, np.minimum(values, high), label, **style)
    meanings = dataset["closed_loop"].attrs["flag_meanings"].split()
    for c, axes in enumerate(margin_map.panels[:, k]):
        for state, colour in (("held_back", _HELD_BACK), ("unstable", _UNSTABLE)):
            cells = np.where(dataset["closed_loop"].values[c] == meanings.index(state), 1.0, np.nan)
            if np.isfinite(cells).any():
                margin_map.draw_cells(axes, cells, cmap=ListedColormap([colour]))
        margin_map.draw_marks(axes, is_short[c], marker="x", color=_SHORT_MARGIN, s=18, linewidths=1.4)
