"""Panels of an adaptive autopilot's estimates over time, each with a band of two standard deviations."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.estimates import (
    EFFECTIVENESS,
    recorded_estimates,
    scenario_deviations,
    true_effectiveness,
)
from anser.report.flight_sheet import FlightSheet
from anser.report.labels import LIMIT_COLOR, math_symbol
from anser.report.style import COMMAND_LINE, LineStyle
from anser.results.faults import fault_time

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_RANGE_MIN = 0.1
"""Least range of a panel's axis relative to the greatest estimate, so that a constant estimate looks constant."""
_BAND_MAX = 0.5
"""Greatest visible part of a band beyond the estimates, relative to the range of the estimates."""
_MARGIN = 0.05


def estimate_label(dataset: xr.Dataset, name: str) -> str:
    """Return the axis label of an estimate, for matplotlib; `name` must be one of `estimates.ESTIMATES`."""
    symbol = math_symbol(dataset[f"{name}_estimate"])
    if name in EFFECTIVENESS:
        return f"{name.partition('_')[0].capitalize()} effectiveness\nover the model's, {symbol}"
    return f"{symbol} (1/rad)"


def draw_band(
    axes: "Axes", time: np.ndarray, estimate: np.ndarray, sigma: np.ndarray, color: str, truth: np.ndarray | None
) -> None:
    """Draw the band `estimate` -/+ 2 `sigma` and, if `truth` is not None, the true values as a dashed line."""
    axes.fill_between(time, estimate - 2.0 * sigma, estimate + 2.0 * sigma, color=color, alpha=0.2, linewidth=0.0)
    if truth is not None:
        axes.plot(time, truth, zorder=3, **COMMAND_LINE)


def set_visible_range(axes: "Axes", lines: Sequence[np.ndarray], bands: Sequence[np.ndarray]) -> None:
    """Set the range of the vertical axis so that all `lines` are visible; an empty `lines` changes nothing.

    The edges of the `bands` extend the range beyond the lines by at most `_BAND_MAX` times the range of the lines.
    """
    if not lines:
        return
    values, edges = np.concatenate(lines), np.concatenate(bands)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    size = max(high - low, _RANGE_MIN * max(abs(low), abs(high)))
    low = min(low, max(float(np.nanmin(edges)), low - _BAND_MAX * size))
    high = max(high, min(float(np.nanmax(edges)), high + _BAND_MAX * size))
    margin = _MARGIN * size
    axes.set_ylim(low - margin, high + margin)


def draw_fault(axes: "Axes", time: np.ndarray, codes: np.ndarray) -> None:
    """Draw a dotted vertical line at the time of the first non-zero fault code, if any."""
    time_s = fault_time(time, codes)
    if time_s is not None:
        axes.axvline(time_s, color=LIMIT_COLOR, linestyle=":", linewidth=1.2)


def draw_adaptation(sheet: FlightSheet) -> "Figure":
    """Return a figure of the adaptive autopilots' estimates up to the arrivals, with a panel for each estimate."""
    names = recorded_estimates(sheet.dataset)
    figure, panels = sheet.panels(len(names))
    for axes, name in zip(panels, names, strict=True):
        lines: list[np.ndarray] = []
        bands: list[np.ndarray] = []
        for line_style in sheet.line_styles:
            estimate, sigma = (sheet.until_arrival(f"{name}_{kind}", line_style) for kind in ("estimate", "sigma"))
            if not np.isfinite(estimate).any():
                continue
            time = sheet.time[: estimate.size]
            truth = _truth(sheet, name, line_style, time)
            draw_band(axes, time, estimate, sigma, line_style.color, truth)
            sheet.plot(axes, line_style, time, estimate)
            draw_fault(axes, time, sheet.until_arrival("fault", line_style))
            lines += [estimate] if truth is None else [estimate, truth]
            bands += [estimate - 2.0 * sigma, estimate + 2.0 * sigma]
        set_visible_range(axes, lines, bands)
        axes.set_ylabel(estimate_label(sheet.dataset, name))
        axes.set_xlim(float(sheet.time[0]), float(sheet.time[sheet.arrival_index.max()]))
    has_truth = bool(sheet.scenario) and not set(names).isdisjoint(EFFECTIVENESS)
    notes = ["band: two standard deviations", *(["dashed: truth by the scenario"] if has_truth else [])]
    notes += ["dotted: a fault was found"] if np.any(sheet.dataset["fault"].values) else []
    return sheet.finish(figure, panels, "estimates of the adaptive autopilots", "; ".join(notes))


def _truth(sheet: FlightSheet, name: str, line_style: LineStyle, time: np.ndarray) -> np.ndarray | None:
    deviations = scenario_deviations(sheet.scenario, str(sheet.dataset["aircraft"].values[line_style.index]))
    return None if deviations is None or name not in EFFECTIVENESS else true_effectiveness(time, name, deviations)
