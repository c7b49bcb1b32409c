"""Figures of a flight over time, for print: variables with limits, goal velocities, distances, estimation, network."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from anser.report.derived_variables import aircraft_limits, limit_value, recorded_table, required_separation
from anser.report.flight_sheet import FlightSheet
from anser.report.labels import (
    Limit,
    axis_label,
    axis_scale,
    draw_labelled_limit,
    draw_limits,
    find_line_end,
    format_owners,
    label_line_ends,
)
from anser.report.style import DASHED, INK, MUTED, SMALL, LineStyle
from anser.report.svg_charts import link_spans, pair_links
from anser.results.separation import nearest_aircraft_distance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MARGIN, _COMMAND_EXCESS_MAX = 0.05, 0.25  # relative to the range of the panel
_SPAN_MIN = {"m s-1": 2.0, "degree": 2.0, "m": 10.0, "s": 0.2, "1": 0.2}
"""Least range of a panel's axis by unit, so that a nearly constant variable looks constant."""


@dataclass(frozen=True)
class Curve:
    """A variable to be drawn over time with reference and limits."""

    name: str
    reference: str | None = None  # variable of the planned or commanded value
    low: str | None = None  # lower limit: key of the tables of `aircraft_limits`; "-" before the key negates the value
    high: str | None = None  # upper limit, like `low`
    stop_surface: str | None = None  # control surface whose stops are the limits, instead of `low` and `high`
    label: str | None = None  # instead of the variable's long name


def draw_time_histories(sheet: FlightSheet, curves: Sequence[Curve], label: str, reference_name: str = "") -> "Figure":
    """Return a figure with a panel for each curve over time, up to the arrivals; all-NaN curves are left out.

    `label` is the title; `reference_name` says what the reference variables are, such as "commanded".
    """
    available = [curve for curve in curves if np.isfinite(sheet.dataset[curve.name].values).any()]
    figure, panels = sheet.panels(len(available))
    notes = [f"{sheet.reference_text}: {reference_name}"] if reference_name else []
    for axes, curve in zip(panels, available, strict=True):
        notes += draw_curve(axes, sheet, curve)
    return sheet.finish(figure, panels, label, "; ".join(notes))


def draw_curve(
    axes: "Axes", sheet: FlightSheet, curve: Curve, line_styles: Sequence[LineStyle] | None = None
) -> list[str]:
    """Draw one variable up to the arrivals, with reference and limits, for the aircraft of `line_styles` (None: all).

    Returns a list with a note on the limits that are too far away to be drawn; empty if all are drawn.
    """
    values, time = sheet.dataset[curve.name], sheet.time
    line_styles = [
        line_style
        for line_style in line_styles or sheet.line_styles
        if np.isfinite(values.values[:, line_style.index]).any()
    ]
    tracks = [sheet.until_arrival(curve.name, line_style) for line_style in line_styles]
    factor, unit = axis_scale(values, max(float(np.nanmax(np.abs(track))) for track in tracks))
    jump_max = 180.0 if values.attrs["units"] == "degree" else np.inf
    response_lines, reference_lines, line_ends = [], [], []
    for line_style in line_styles:
        samples = slice(0, int(sheet.arrival_index[line_style.index]) + 1)
        x, y = insert_gaps(time[samples], factor * sheet.until_arrival(curve.name, line_style), jump_max)
        sheet.plot(axes, line_style, x, y)
        response_lines.append(y)
        line_ends.append(find_line_end(x, y, sheet.label(line_style), line_style))
        if curve.reference is not None:
            x, y = insert_gaps(time[samples], factor * sheet.until_arrival(curve.reference, line_style), jump_max)
            axes.plot(x, y, **sheet.reference_properties())
            reference_lines.append(y)
    visible = _visible_range(response_lines, reference_lines, factor * _SPAN_MIN[str(values.attrs["units"])])
    margin = _MARGIN * (visible[1] - visible[0])
    axes.set_ylim(visible[0] - margin, visible[1] + margin)
    hidden_limits = draw_limits(axes, _limits(sheet, curve, line_styles, factor, unit), visible)
    axes.set_ylabel(axis_label(values, curve.label, unit, sheet.label_capacity(sheet.panel_height)))
    axes.set_xlim(float(time[0]), float(time[sheet.arrival_index.max()]))
    if sheet.has_line_names:
        label_line_ends(axes, line_ends, sheet.panel_height)
    hidden_text = ", ".join(limit.label for limit in sorted(hidden_limits, key=lambda hidden: hidden.value))
    return [f"not shown: {str(values.attrs['long_name']).lower()}, {hidden_text}"] if hidden_limits else []


def _visible_range(
    response_lines: Sequence[np.ndarray], reference_lines: Sequence[np.ndarray], span_min: float
) -> tuple[float, float]:
    """Return the range of a panel's axis, (low, high), which contains all responses and is at least `span_min` wide.

    Reference lines extend the range on either side by at most `_COMMAND_EXCESS_MAX` times the range of the responses.
    """
    responses, values = np.concatenate(response_lines), np.concatenate([*response_lines, *reference_lines])
    low, high = float(np.nanmin(responses)), float(np.nanmax(responses))
    size = max(high - low, span_min)
    excess = _COMMAND_EXCESS_MAX * size
    low, high = max(float(np.nanmin(values)), low - excess), min(float(np.nanmax(values)), high + excess)
    missing = max(span_min - (high - low), 0.0)
    return low - missing / 2, high + missing / 2


def _limits(
    sheet: FlightSheet, curve: Curve, line_styles: Sequence[LineStyle], factor: float, unit: str
) -> list[Limit]:
    """Return each different limit of a curve, multiplied by `factor`; labels have value, `unit` and aircraft names."""
    owners: dict[tuple[float, bool], list[str]] = {}
    limits = aircraft_limits(sheet.dataset)
    for line_style in line_styles:
        aircraft_table = limits[line_style.index]
        if curve.stop_surface is not None:
            bounds = aircraft_table.get("surfaces_deg", {}).get(curve.stop_surface, [None, None])
        else:
            bounds = [limit_value(aircraft_table, key) for key in (curve.low, curve.high)]
        for value, is_upper in zip(bounds, (False, True), strict=True):
            if value is not None:
                owners.setdefault((factor * float(value), is_upper), []).append(sheet.label(line_style))
    noun = "limit" if curve.stop_surface is None else "stop"
    result = []
    for (value, is_upper), names in owners.items():
        number = f"{float(f'{value:.4g}'):,g}".replace("-", "\u2212")
        number += unit if unit == "°" else f" {unit}".rstrip()
        owner_text = format_owners(names, len(line_styles))
        result.append(Limit(value, is_upper, f"{noun} {number}" + (f" ({owner_text})" if owner_text else "")))
    return result


def insert_gaps(x: np.ndarray, y: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y with a NaN wherever y jumps by more than `jump`, to cut the line of a wrapped angle."""
    differences = np.abs(np.diff(y))
    indices = np.flatnonzero(np.where(np.isfinite(differences), differences, 0.0) > jump) + 1
    return np.insert(x, indices, x[indices]), np.insert(y, indices, np.nan)


_NED_AXES = ("north", "east", "down")
GOAL_VELOCITIES = tuple(Curve(f"goal_estimate_velocity_{axis}_m_s", f"goal_velocity_{axis}_m_s") for axis in _NED_AXES)
"""Curves of the goal velocity's north, east and down components: estimated, with the true velocity as reference."""
_CHANGE_MIN_M_S = 0.02  # smaller changes are not drawn
_STANDSTILL_M_S = 0.05


def has_changing_goals(dataset: xr.Dataset) -> bool:
    """Whether the true or the estimated velocity of a goal changes by more than 0.02 m/s before the arrival."""
    return any(_changing_goals(FlightSheet(dataset), curve) for curve in GOAL_VELOCITIES)


def draw_goal_velocities(sheet: FlightSheet) -> "Figure":
    """Return a figure of the goals' changing velocity components over time; a note states the constant velocities."""
    panel_curves = [(curve, line_styles) for curve in GOAL_VELOCITIES if (line_styles := _changing_goals(sheet, curve))]
    figure, panels = sheet.panels(len(panel_curves))
    notes = [f"lines: recovered from the line of sight; {sheet.reference_text}: true"]
    for axes, (curve, line_styles) in zip(panels, panel_curves, strict=True):
        draw_curve(axes, sheet, curve, line_styles)
    plotted = {line_style.index for _, line_styles in panel_curves for line_style in line_styles}
    steady = dict.fromkeys(
        _steady_velocity_text(sheet, line_style) for line_style in sheet.line_styles if line_style.index not in plotted
    )
    return sheet.finish(
        figure, panels, "velocities of the goals as the aircraft estimate them", "; ".join([*notes, *steady])
    )


def _changing_goals(sheet: FlightSheet, curve: Curve) -> list[LineStyle]:
    names = [name for name in (curve.name, curve.reference) if name is not None]
    return [
        line_style
        for line_style in sheet.line_styles
        if any(float(np.ptp(sheet.until_arrival(name, line_style))) > _CHANGE_MIN_M_S for name in names)
    ]


def _steady_velocity_text(sheet: FlightSheet, line_style: LineStyle) -> str:
    north, east, down = (float(sheet.until_arrival(f"goal_velocity_{axis}_m_s", line_style)[-1]) for axis in _NED_AXES)
    speed, goal = np.hypot(north, east), sheet.goal_name(line_style)
    if np.hypot(speed, down) < _STANDSTILL_M_S:
        return f"{goal} stands"
    text = f"{goal} keeps {speed:.3g} m/s on course {np.degrees(np.arctan2(east, north)) % 360.0:.0f}°"
    return text if abs(down) < _STANDSTILL_M_S else f"{text}, {abs(down):.2g} m/s {'down' if down > 0.0 else 'up'}"


_RANGE = "range_to_rendezvous_m"
_POSITION, _VELOCITY = ("north_m", "east_m", "altitude_m"), ("north_m_s", "east_m_s", "down_m_s")
_DISTANCE_FLOOR_M = 1e-3  # below the accuracy of the simulation; keeps the logarithm finite


def zero_effort_miss_m(dataset: xr.Dataset) -> np.ndarray:
    """Compute the zero-effort miss, m, shape (time, aircraft).

    The zero-effort miss is the least future distance to the rendezvous if aircraft and goal keep their velocities.
    After the closest approach it is the present distance. Distances on a round Earth are those of the local map.
    """
    offset = np.stack([(dataset[f"rendezvous_{a}"] - dataset[a]).values for a in _POSITION], axis=-1)
    goal_n, velocity_n = (
        np.stack([dataset[f"{prefix}_{a}"].values for a in _VELOCITY], axis=-1) * (1.0, 1.0, -1.0)
        for prefix in ("goal_velocity", "velocity")
    )
    if dataset.attrs.get("earth_model") == "wgs84" and dataset.sizes["time"] > 1:
        # the goal's velocity is that on the local map; the aircraft's recorded velocity is the true one
        position = np.stack([dataset[a].values for a in _POSITION], axis=-1)
        velocity_n = np.gradient(position, dataset["time"].values, axis=0)
    rate = goal_n - velocity_n
    squared = np.sum(rate**2, axis=-1)
    time_to_go = np.divide(-np.sum(offset * rate, axis=-1), squared, out=np.zeros_like(squared), where=squared > 0.0)
    return np.linalg.norm(offset + np.maximum(time_to_go, 0.0)[..., np.newaxis] * rate, axis=-1)


def draw_miss(sheet: FlightSheet) -> "Figure":
    """Return a figure of zero-effort and required miss up to the arrivals, on a logarithmic axis."""
    figure, (axes,) = sheet.panels(1)
    _draw_lines(axes, sheet, np.maximum(zero_effort_miss_m(sheet.dataset), _DISTANCE_FLOOR_M), sheet.arrival_index)
    axes.set_ylabel("Zero-effort miss (m)")
    _make_logarithmic(axes, sheet, _requirement(sheet, "miss_max_m", is_upper=True))
    note = "least distance to the rendezvous if aircraft and goal kept their velocities from here on"
    return sheet.finish(figure, [axes], "predicted miss of the rendezvous", note)


def draw_ranges(sheet: FlightSheet) -> "Figure":
    """Return a figure of the ranges to the rendezvous up to the arrivals, with a linear and a logarithmic panel."""
    figure, panels = sheet.panels(2)
    values = sheet.dataset[_RANGE]
    factor, unit = axis_scale(values, float(np.nanmax(values.values[: sheet.arrival_index.max() + 1])))
    _draw_lines(panels[0], sheet, factor * values.values, sheet.arrival_index)
    panels[0].set_ylim(bottom=0.0)
    _draw_lines(panels[1], sheet, np.maximum(values.values, _DISTANCE_FLOOR_M), sheet.arrival_index)
    label_length = sheet.label_capacity(sheet.panel_height)
    panels[0].set_ylabel(axis_label(values, unit=unit, length=label_length))
    panels[1].set_ylabel(axis_label(values, length=label_length))
    _make_logarithmic(panels[1], sheet, None)
    _label_lines(panels[0], sheet)
    return sheet.finish(figure, panels, "ranges to the rendezvous", "above linear, below logarithmic")


def draw_separation(sheet: FlightSheet) -> "Figure":
    """Return a figure of each aircraft's distance to the nearest aircraft, and ratio of distance to separation."""
    required = required_separation(sheet.scenario)
    positions = np.stack([sheet.dataset[name].values for name in _POSITION], axis=-1)
    end_index = np.full(sheet.count, len(sheet.time) - 1)
    figure, panels = sheet.panels(1 if required is None else 2)
    _draw_lines(panels[0], sheet, nearest_aircraft_distance(positions), end_index)
    panels[0].set_ylabel(_short(sheet, "Least distance to another (m)", "Distance (m)"))
    _make_logarithmic(panels[0], sheet, _requirement(sheet, "separation_min_m", is_upper=False))
    note = ""
    if required is not None:
        _draw_lines(panels[1], sheet, nearest_aircraft_distance(positions, required), end_index)
        panels[1].set_ylabel(_short(sheet, "Distance over separation", "Distance over\nseparation"))
        above = f", or {required[1]:g} m in altitude" if required[1] else " in the plane"
        _make_logarithmic(panels[1], sheet, Limit(1.0, False, "required"))
        note = f"required separation: {required[0]:g} m{above}"
    return sheet.finish(figure, panels, "distances between the aircraft", note)


def _requirement(sheet: FlightSheet, key: str, *, is_upper: bool) -> Limit | None:
    value = sheet.scenario.get("requirements", {}).get(key)
    return None if value is None else Limit(float(value), is_upper, f"required: {value:g} m")


def _short(sheet: FlightSheet, label: str, short: str) -> str:
    return label if len(label) <= sheet.label_capacity(sheet.panel_height) else short


def _draw_lines(axes: "Axes", sheet: FlightSheet, values: np.ndarray, end_index: np.ndarray) -> None:
    for line_style in sheet.line_styles:
        samples = slice(0, int(end_index[line_style.index]) + 1)
        sheet.plot(axes, line_style, sheet.time[samples], values[samples, line_style.index])
    axes.set_xlim(float(sheet.time[0]), float(sheet.time[end_index.max()]))


def _make_logarithmic(axes: "Axes", sheet: FlightSheet, limit: Limit | None) -> None:
    axes.set_yscale("log")
    if limit is not None:
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, 0.6 * limit.value), max(high, 1.5 * limit.value))
        draw_labelled_limit(axes, limit)
    _label_lines(axes, sheet)


def _label_lines(axes: "Axes", sheet: FlightSheet) -> None:
    if sheet.has_line_names:
        lines = zip(axes.lines, sheet.line_styles, strict=False)  # the remaining lines are limits
        line_data = [(line_style, *(np.asarray(values) for values in line.get_data())) for line, line_style in lines]
        line_ends = [find_line_end(x, y, sheet.label(line_style), line_style) for line_style, x, y in line_data]
        label_line_ends(axes, line_ends, sheet.panel_height)


_AXES = ("north", "east", "altitude")
_ELLIPSE_TIMES_S = (20.0, 10.0, 4.0, 0.0)
_LABELLED_ROWS_MAX = 15  # pairs of aircraft; with more pairs, the rows have no names
_COLUMNS_MAX = 4


def draw_knowledge(sheet: FlightSheet) -> "Figure":
    """Return a figure of the goal estimates: errors with two standard deviations and, below, error ellipses."""
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
        error, band = (np.sqrt(sum(x**2 for x in parts)) for parts in (errors, sigma))
        sheet.plot(error_axes, line_style, time, error)
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
    """Draw ellipses of two standard deviations of the goal estimate of aircraft `k`, relative to the true goal."""
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
    """Return a figure of the network: links, quality of service, and clock differences with their guaranteed decay."""
    network = recorded_table(sheet.dataset, "network")
    series, pairs = network["series"], list(pair_links(sheet.dataset).items())
    figure, (link_axes, quality_axes, clock_axes) = sheet.panels(3)
    end_s = series["time_s"][-1]
    for pair_index, (_, is_linked) in enumerate(pairs):
        spans = [(start, stop - start) for start, stop in link_spans(sheet.time, is_linked)]
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
