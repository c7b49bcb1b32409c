"""Figures of an envelope survey: the trim map, the outcome of each commanded maneuver, and the remaining margins."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.map_panels import draw_cells, draw_column, draw_marks, map_panels
from anser.report.style import MAP_STYLE, save_drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_STYLE = {**MAP_STYLE, "svg.hashsalt": "anser-envelope"}
_DOTS: dict[str, Any] = {"marker": ".", "color": "white", "s": 6.0, "linewidths": 0.0}
_LOAD_FACTOR, _OUTSIDE_ANGLES, _OUTSIDE_ALTITUDE = (
    "limited: load factor",
    "failed: alpha, beta leave the data",
    "limited: altitude, Mach leave the data",
)
_REASONS = {
    "reached": ("reached", "#009e73"),
    "thrust_max": ("limited: full thrust", "#56b4e9"),
    "thrust_idle": ("limited: idle thrust", "#b5deff"),
    "alpha": ("limited: alpha", "#cc79a7"),
    "load_factor": (_LOAD_FACTOR, "#e8c3d8"),
    "unloading": (_LOAD_FACTOR, "#e8c3d8"),
    "bank": ("limited: bank", "#0072b2"),
    "tables_altitude": (_OUTSIDE_ALTITUDE, "#a6a6a6"),
    "tables_mach": (_OUTSIDE_ALTITUDE, "#a6a6a6"),
    "body_rates": ("failed: body rates", "#f0e442"),
    "surfaces": ("failed: surface stops", "#e69f00"),
    "surface_rates": ("failed: surface rates", "#d55e00"),
    "tables_alpha": (_OUTSIDE_ANGLES, "#000000"),
    "tables_beta": (_OUTSIDE_ANGLES, "#000000"),
    "start_beyond_limits": ("start beyond the autopilot's limits", "#8a5a7a"),
    "unexplained": ("failed: unexplained", "#ff00ff"),
}
"""Text and colour of each reason that limited or ended a flight.

Colours of Okabe and Ito, distinguishable with colour-blindness, and their tints: blue, pink and grey for a limited
flight, yellow to black for a failed one."""
_FAILED_AFTER_BAD_START = ("failed, from a start beyond the limits", "#2b0f24")


def draw_envelope(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a survey into SVG and PNG files `trim-map`, `commands` and `margins`; return the paths.

    Parameters
    ----------
    dataset
        Result of `anser.analysis.envelope`.
    """
    drawings = {"trim-map": _trim_map, "commands": _commands, "margins": _margins}
    return save_drawings(drawings, dataset, _STYLE, folder)


def _trim_map(dataset: xr.Dataset) -> "Figure":
    note = "Grey: no steady flight. Dots: a tenth or more of power and surfaces left."
    figure, axes, colorbar_axes = map_panels(dataset, 3, 9.5, "Steady flight", [note])
    trimmable = dataset["trimmable"].values.astype(bool)
    with_reserve = dataset["with_reserve"].values.astype(bool)
    least_surface = dataset["surface_left"].values.min(axis=-1)
    columns = (
        ("angle of attack (deg)", dataset["alpha_deg"].values, "viridis", (-5.0, 45.0)),
        ("engine power (percent)", dataset["power_percent"].values, "cividis", (0.0, 100.0)),
        ("way left to the nearest surface stop (part)", least_surface, "magma", (0.0, 1.0)),
    )
    for k, (label, values, colormap, (low, high)) in enumerate(columns):
        visible_values = np.where(trimmable, values, np.nan)
        draw_column(
            figure, axes[:, k], colorbar_axes[k], dataset, visible_values, label, cmap=colormap, vmin=low, vmax=high
        )
        for c in range(len(axes)):
            draw_marks(axes[c, k], dataset, with_reserve[c], **_DOTS)
    return figure


def _commands(dataset: xr.Dataset) -> "Figure":
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
    label_index = np.where(
        has_failed & (reason == reasons.index("start_beyond_limits")),
        labels.index(_FAILED_AFTER_BAD_START),
        label_index,
    )
    commands = dataset["command_meaning"].values
    note = "Grey: no steady flight to leave from. Dots: a tenth or more of power and surfaces left."
    figure, axes, colorbar_axes = map_panels(
        dataset, len(commands), 1.2 + 2.1 * len(commands), "Commands flown", [note]
    )
    with_reserve = dataset["with_reserve"].values.astype(bool)
    for k, command in enumerate(commands):
        axes[0, k].set_title(command)
        colorbar_axes[k].set_axis_off()
        for c in range(len(axes)):
            draw_cells(axes[c, k], dataset, label_index[c, :, :, k], cmap=colormap, norm=norm)
            draw_marks(axes[c, k], dataset, with_reserve[c], **_DOTS)
    present = sorted({int(k) for k in np.unique(label_index[~np.isnan(label_index)])})
    handles = [Patch(facecolor=labels[k][1], label=labels[k][0]) for k in present]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _margins(dataset: xr.Dataset) -> "Figure":
    note = "Blue: within the limit. Red: beyond it. Grey: no steady flight."
    figure, axes, colorbar_axes = map_panels(dataset, 4, 12.0, "Least margin over all commands", [note])
    attributes = dataset.attrs
    upper_margin = attributes["limit_load_factor_max"] - dataset["load_factor_max"].values
    lower_margin = dataset["load_factor_min"].values - attributes["limit_load_factor_min"]
    columns = (
        ("alpha to its limit (deg)", attributes["limit_alpha_max_deg"] - dataset["alpha_max_deg"].values, 20.0),
        ("load factor to its limits", np.minimum(upper_margin, lower_margin), 4.0),
        ("body rates to their limits (part)", 1.0 - dataset["body_rate_share"].values.max(axis=-1), 1.0),
        ("surfaces to their stops (part)", 1.0 - dataset["surface_share"].values.max(axis=-1), 1.0),
    )
    for k, (label, values, span) in enumerate(columns):
        least_margin = values.min(axis=-1)
        draw_column(
            figure, axes[:, k], colorbar_axes[k], dataset, least_margin, label, cmap="RdBu", vmin=-span, vmax=span
        )
    return figure
