"""What aircraft know of their goals, with errors of their sensors, and of one another, without a centre."""

from typing import TYPE_CHECKING

import numpy as np

from anser.report.flight_histories import marker_interval
from anser.report.flight_sheet import FlightSheet
from anser.report.style import DASHED, INK, MUTED, SMALL
from anser.report.svg_charts import pair_links, recorded_network

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_PLACE = ("north", "east", "altitude")
_BEFORE_S = (20.0, 10.0, 4.0, 0.0)
_ROWS_NAMED = 15  # pairs of aircraft; of more, the rows have no names
_COLUMNS = 4


def draw_knowledge(sheet: FlightSheet) -> "Figure":
    """How far the goal is from where it is taken to be, with the filter's band; below, ellipses before the arrival."""
    columns = min(sheet.count, _COLUMNS // 2 if sheet.figure_format.is_narrow else _COLUMNS)
    tile = min(sheet.figure_format.width / columns, 2.2)
    figure = sheet.figure(1.2 + 1.3 * sheet.panel_height + tile)
    grid = figure.add_gridspec(2, columns, height_ratios=[1.3 * sheet.panel_height, tile])
    above = figure.add_subplot(grid[0, :])
    for line_style in sheet.line_styles:
        off = [
            sheet.until_arrival(f"goal_{a}_m", line_style) - sheet.until_arrival(f"goal_estimate_{a}_m", line_style)
            for a in _PLACE
        ]
        sigma = [sheet.until_arrival(f"goal_sigma_{a}_m", line_style) for a in _PLACE]
        time = sheet.time[: off[0].size]
        every = marker_interval(time.size, line_style.index, sheet.count) if sheet.has_few_aircraft else None
        error, band = (np.sqrt(sum(x**2 for x in parts)) for parts in (off, sigma))
        above.plot(
            time, error, label=sheet.name(line_style.index), markevery=every, **sheet.line_properties(line_style)
        )
        above.plot(time, 2.0 * band, color=line_style.color, linestyle=DASHED, linewidth=0.9)
    above.set_yscale("log")
    above.set_xlabel("Time $t$ (s)")
    above.set_ylabel("Error of the goal's place (m)")
    for k in range(columns):
        axes = figure.add_subplot(grid[1, k])
        _ellipses(axes, sheet, k)
        if k == 0:
            axes.set_ylabel("North of the goal (m)")
    which = "" if columns == sheet.count else f" for the first {columns} of {sheet.count} aircraft"
    note = (
        "above: solid error, dashed two standard deviations; below: ellipses of two, 20, 10, 4, 0 s before the arrival"
        + which
    )
    return sheet.finish(figure, [above], "what the aircraft know of their goals", note)


def _ellipses(axes: "Axes", sheet: FlightSheet, k: int) -> None:
    """Ellipses of two standard deviations of the goal of one aircraft, relative to the goal."""
    from matplotlib.patches import Ellipse

    line_style, end = sheet.line_styles[k], sheet.time[sheet.arrival_index[sheet.line_styles[k].index]]
    places = (f"goal_{more}{axis}_m" for axis in ("north", "east") for more in ("", "estimate_", "sigma_"))
    of = {name: sheet.until_arrival(name, line_style) for name in (*places, "goal_correlation")}
    for back in _BEFORE_S:
        at = max(0, int(np.searchsorted(sheet.time, end - back)))
        north, east = (float(of[f"goal_sigma_{a}_m"][at]) for a in ("north", "east"))
        both = float(of["goal_correlation"][at]) * north * east
        values, vectors = np.linalg.eigh(np.array([[east**2, both], [both, north**2]]))
        angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
        lengths = 4.0 * np.sqrt(np.maximum(values[::-1], 0.0))
        centre = [float((of[f"goal_estimate_{a}_m"] - of[f"goal_{a}_m"])[at]) for a in ("east", "north")]
        axes.add_patch(Ellipse((centre[0], centre[1]), *lengths, angle=angle, fill=False, color=line_style.color))
        axes.plot(*centre, ".", color=INK, markersize=2)
    axes.plot(0.0, 0.0, "+", color=INK)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.set_title(sheet.name(line_style.index), fontsize=SMALL)
    axes.set_xlabel("East of the goal (m)")


def draw_network(sheet: FlightSheet) -> "Figure":
    """Which links are up, and how far the clocks are apart, beside what the theorem of time coordination promises."""
    network = recorded_network(sheet.dataset)
    series, pairs = network["series"], list(pair_links(sheet.dataset).items())
    figure, (above, middle, below) = sheet.panels(3)
    time, until = sheet.time, series["time_s"][-1]
    for row, (_, up) in enumerate(pairs):
        edges = np.flatnonzero(np.diff(up.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        spans = [(float(time[a]), float(time[min(b, len(time) - 1)] - time[a])) for a, b in edges]
        above.broken_barh(spans, (row - 0.35, 0.7), color=MUTED)
    if len(pairs) <= _ROWS_NAMED:
        above.set_yticks(range(len(pairs)), ["–".join(pair) for pair, _ in pairs], fontsize=SMALL)
    else:
        above.set_yticks([])
    above.set_ylabel("Link")
    middle.plot(series["time_s"], series["quality_of_service"], color=INK)
    middle.axhline(0.0, color=MUTED, linewidth=0.5)
    middle.set_ylim(-0.05, 1.05)
    middle.set_ylabel(r"Quality $\mu$")
    apart = np.maximum(np.asarray(series["coordination_error_s"]), 1e-6)
    greatest = int(np.argmax(apart))
    since = np.asarray(series["time_s"][greatest:])
    promised = apart[greatest] * np.exp(-network["promised_rate_per_s"] * (since - since[0]))
    below.semilogy(series["time_s"], apart, color=INK)
    below.semilogy(since, promised, color=INK, linestyle=DASHED)
    below.set_xlim(0.0, until)
    below.set_ylabel(r"$|Q\gamma|$ (s)")
    note = (
        f"window of {network['window_s']:g} s; below, solid: clocks; dashed: promised without further disturbance, "
        f"{network['promised_rate_per_s']:.3f} per second"
    )
    return sheet.finish(
        figure, [above, middle, below], "links, quality of service, and how far the clocks are apart", note
    )
