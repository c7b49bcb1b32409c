"""Figures of estimation and communication: errors of goal estimates; links and clocks of a decentralised fleet."""

from typing import TYPE_CHECKING

import numpy as np

from anser.report.flight_histories import marker_interval
from anser.report.flight_sheet import FlightSheet
from anser.report.style import DASHED, INK, MUTED, SMALL
from anser.report.svg_charts import pair_links, recorded_network

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_AXES = ("north", "east", "altitude")
_ELLIPSE_TIMES_S = (20.0, 10.0, 4.0, 0.0)
_LABELLED_ROWS_MAX = 15  # pairs of aircraft; with more pairs, the rows have no names
_COLUMNS_MAX = 4


def draw_knowledge(sheet: FlightSheet) -> "Figure":
    """Draw the errors of the goal estimates with two standard deviations; below, error ellipses before the arrival."""
    columns = min(sheet.count, _COLUMNS_MAX // 2 if sheet.figure_format.is_narrow else _COLUMNS_MAX)
    tile = min(sheet.figure_format.width / columns, 2.2)
    figure = sheet.figure(1.2 + 1.3 * sheet.panel_height + tile)
    grid = figure.add_gridspec(2, columns, height_ratios=[1.3 * sheet.panel_height, tile])
    error_axes = figure.add_subplot(grid[0, :])
    for line_style in sheet.line_styles:
        errors = [
            sheet.until_arrival(f"goal_{a}_m", line_style) - sheet.until_arrival(f"goal_estimate_{a}_m", line_style)
            for a in _AXES
        ]
        sigma = [sheet.until_arrival(f"goal_sigma_{a}_m", line_style) for a in _AXES]
        time = sheet.time[: errors[0].size]
        marker_spacing = marker_interval(time.size, line_style.index, sheet.count) if sheet.has_few_aircraft else None
        error, band = (np.sqrt(sum(x**2 for x in parts)) for parts in (errors, sigma))
        error_axes.plot(
            time,
            error,
            label=sheet.name(line_style.index),
            markevery=marker_spacing,
            **sheet.line_properties(line_style),
        )
        error_axes.plot(time, 2.0 * band, color=line_style.color, linestyle=DASHED, linewidth=0.9)
    error_axes.set_yscale("log")
    error_axes.set_xlabel("Time $t$ (s)")
    error_axes.set_ylabel("Error of the goal's place (m)")
    for k in range(columns):
        axes = figure.add_subplot(grid[1, k])
        _ellipses(axes, sheet, k)
        if k == 0:
            axes.set_ylabel("North of the goal (m)")
    selection = "" if columns == sheet.count else f" for the first {columns} of {sheet.count} aircraft"
    note = (
        "above: solid error, dashed two standard deviations; below: ellipses of two, 20, 10, 4, 0 s before the arrival"
        + selection
    )
    return sheet.finish(figure, [error_axes], "what the aircraft know of their goals", note)


def _ellipses(axes: "Axes", sheet: FlightSheet, k: int) -> None:
    """Draw ellipses of two standard deviations of one aircraft's goal estimate, relative to the true goal."""
    from matplotlib.patches import Ellipse

    line_style, end = sheet.line_styles[k], sheet.time[sheet.arrival_index[sheet.line_styles[k].index]]
    names = (f"goal_{kind}{axis}_m" for axis in ("north", "east") for kind in ("", "estimate_", "sigma_"))
    values_of = {name: sheet.until_arrival(name, line_style) for name in (*names, "goal_correlation")}
    for lead_s in _ELLIPSE_TIMES_S:
        sample = max(0, int(np.searchsorted(sheet.time, end - lead_s)))
        north, east = (float(values_of[f"goal_sigma_{a}_m"][sample]) for a in ("north", "east"))
        covariance = float(values_of["goal_correlation"][sample]) * north * east
        values, vectors = np.linalg.eigh(np.array([[east**2, covariance], [covariance, north**2]]))
        angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
        lengths = 4.0 * np.sqrt(np.maximum(values[::-1], 0.0))
        centre = [
            float((values_of[f"goal_estimate_{a}_m"] - values_of[f"goal_{a}_m"])[sample]) for a in ("east", "north")
        ]
        axes.add_patch(Ellipse((centre[0], centre[1]), *lengths, angle=angle, fill=False, color=line_style.color))
        axes.plot(*centre, ".", color=INK, markersize=2)
    axes.plot(0.0, 0.0, "+", color=INK)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.set_title(sheet.name(line_style.index), fontsize=SMALL)
    axes.set_xlabel("East of the goal (m)")


def draw_network(sheet: FlightSheet) -> "Figure":
    """Draw links, quality of service, and clock differences with their bound by the theorem of time coordination."""
    network = recorded_network(sheet.dataset)
    series, pairs = network["series"], list(pair_links(sheet.dataset).items())
    figure, (link_axes, quality_axes, clock_axes) = sheet.panels(3)
    time, end_s = sheet.time, series["time_s"][-1]
    for pair_index, (_, is_linked) in enumerate(pairs):
        edges = np.flatnonzero(np.diff(is_linked.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        spans = [(float(time[a]), float(time[min(b, len(time) - 1)] - time[a])) for a, b in edges]
        link_axes.broken_barh(spans, (pair_index - 0.35, 0.7), color=MUTED)
    if len(pairs) <= _LABELLED_ROWS_MAX:
        link_axes.set_yticks(range(len(pairs)), ["–".join(pair) for pair, _ in pairs], fontsize=SMALL)
    else:
        link_axes.set_yticks([])
    link_axes.set_ylabel("Link")
    quality_axes.plot(series["time_s"], series["quality_of_service"], color=INK)
    quality_axes.axhline(0.0, color=MUTED, linewidth=0.5)
    quality_axes.set_ylim(-0.05, 1.05)
    quality_axes.set_ylabel(r"Quality $\mu$")
    coordination_error = np.maximum(np.asarray(series["coordination_error_s"]), 1e-6)
    greatest = int(np.argmax(coordination_error))
    times_after = np.asarray(series["time_s"][greatest:])
    promised = coordination_error[greatest] * np.exp(-network["promised_rate_per_s"] * (times_after - times_after[0]))
    clock_axes.semilogy(series["time_s"], coordination_error, color=INK)
    clock_axes.semilogy(times_after, promised, color=INK, linestyle=DASHED)
    clock_axes.set_xlim(0.0, end_s)
    clock_axes.set_ylabel(r"$|Q\gamma|$ (s)")
    note = (
        f"window of {network['window_s']:g} s; below, solid: clocks; dashed: promised without further disturbance, "
        f"{network['promised_rate_per_s']:.3f} per second"
    )
    return sheet.finish(
        figure,
        [link_axes, quality_axes, clock_axes],
        "links, quality of service, and how far the clocks are apart",
        note,
    )
