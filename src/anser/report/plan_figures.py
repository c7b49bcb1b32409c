"""Figures of plans: map and time histories of a plan, and families of paths of the published planner."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.labels import (
    LIMIT_COLOR,
    MARKER_SIZE,
    NAMES_MAX,
    annotate_position,
    axis_label,
    clear_direction,
    display_unit,
    draw_limit_line,
    math_symbol,
    unit_vector,
)
from anser.report.style import (
    DASHED,
    FIGURE_SUFFIXES,
    INK,
    LARGE,
    MUTED,
    PRINT_STYLE,
    SMALL,
    LineStyle,
    aircraft_line_styles,
    marker_style,
    new_figure,
    save_drawings,
    shared_prefix,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_KM = 1e-3
_STEPS_S = (5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0)
_MARKERS_PER_PATH_MAX = 8
_SAME_TIME_S = 5e-3
_ONE_ROW_HANDLES_MAX = 5
_LARGE_NAMES_MAX = 8  # a larger number of names gets a smaller font
_MAP_WIDTH, _NAME_GAP, _LETTER_WIDTH = 430.0, 16.0, 0.6  # points, points, relative to the font size
_SIDE_MARGIN_MAX = 0.22
_TIME_LENGTH = 9


def marker_period(dataset: xr.Dataset) -> float:
    """Return the time, s, between dots on a path: the shortest round number with at most 8 intervals in the plan."""
    times = dataset["time"].values
    return next((step for step in _STEPS_S if (times[-1] - times[0]) / step <= _MARKERS_PER_PATH_MAX), _STEPS_S[-1])


def closest_pair_names(dataset: xr.Dataset, measure: str) -> tuple[str, str] | None:
    """Return the names of the two aircraft that come closest in the plan; None for a single aircraft.

    `measure` is "distance" (in space) or, if a separation is required, "separation". In a separation, vertical
    distances are multiplied by the ratio of required horizontal to vertical separation.
    """
    pair = dataset[f"least_{measure}_pair"].values
    if pair[0] < 0:
        return None
    names = dataset["aircraft"].values
    return str(names[pair[0]]), str(names[pair[1]])


def draw_plan_map(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle]) -> None:
    """Draw paths, goals, keep-outs and the closest pair of a plan on a map in km, east to the right and north up."""
    for name, set_label in (("east_m", axes.set_xlabel), ("north_m", axes.set_ylabel)):
        set_label(f"{dataset[name].attrs['long_name']} (km)")
    _draw_keep_outs(axes, dataset)
    _draw_goals(axes, dataset, line_styles)
    for line_style in line_styles:
        _draw_path(axes, dataset, line_style, len(line_styles))
    _draw_closest_pair(axes, dataset)
    axes.set_aspect("equal", adjustable="datalim")
    _widen_for_names(axes, dataset, line_styles)
    axes.margins(x=0.02, y=0.1)
    _legend(axes, dataset)


def _widen_for_names(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle]) -> None:
    if len(line_styles) > NAMES_MAX:
        return
    longest_name = max(len(line_style.label) for line_style in line_styles)
    longest_name += _TIME_LENGTH if _shows_times(dataset, len(line_styles)) else 0
    name_width = _NAME_GAP + _LETTER_WIDTH * _font_size(len(line_styles)) * longest_name
    share = min(name_width / _MAP_WIDTH, _SIDE_MARGIN_MAX)
    (low, high), north = axes.dataLim.intervalx, axes.dataLim.intervaly[0]
    margin = share / (1.0 - 2.0 * share) * (high - low)  # equal scales may remove margins
    axes.update_datalim([(low - margin, north), (high + margin, north)])


def _draw_path(axes: "Axes", dataset: xr.Dataset, line_style: LineStyle, fleet: int) -> None:
    times = dataset["time"].values
    east, north = (_KM * dataset[name].values[:, line_style.index] for name in ("east_m", "north_m"))
    flown = np.flatnonzero(np.isfinite(east))
    axes.plot(east[flown], north[flown], **line_style.properties, zorder=3)
    period, color = marker_period(dataset), line_style.color
    marker_times = times[0] + period * np.arange(1, 1 + int((times[-1] - times[0]) / period))
    markers = flown[np.isin(times[flown], marker_times)]
    axes.plot(east[markers], north[markers], ".", color=color, markersize=3.0 + 2.0 * line_style.width, zorder=4)
    start, end = flown[0], flown[-1]
    axes.plot(east[start], north[start], "o", color=color, markersize=5, zorder=5)
    axes.plot(east[end], north[end], "D", color=color, markersize=5.5, zorder=6, mec="white", mew=0.6)
    if fleet <= NAMES_MAX:
        # behind the start of the path
        side = unit_vector(np.array([east[start] - east[flown[1]], north[start] - north[flown[1]]]))
        arrivals = dataset["arrival_time_s"].values
        time_text = f", {arrivals[line_style.index]:.2f} s" if _shows_times(dataset, fleet) else ""
        label = line_style.label + time_text
        position = np.array([east[start], north[start]])
        annotate_position(axes, label, position, side, line_style.color, _font_size(fleet))


def _shows_times(dataset: xr.Dataset, fleet: int) -> bool:
    return fleet <= _LARGE_NAMES_MAX and float(np.ptp(dataset["arrival_time_s"].values)) > _SAME_TIME_S


def _font_size(names: int) -> float:
    return SMALL + (1.0 if names <= _LARGE_NAMES_MAX else 0.0)


def _draw_goals(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle]) -> None:
    goals = dataset["goal"].values
    last_aircraft: dict[str, int] = {}
    for line_style in line_styles:
        goal = str(goals[line_style.index])
        arrivals = dataset["arrival_time_s"].values
        if goal not in last_aircraft or arrivals[line_style.index] > arrivals[last_aircraft[goal]]:
            last_aircraft[goal] = line_style.index
    extent = max(
        _KM * float(np.nanmax(coordinates) - np.nanmin(coordinates))
        for coordinates in (dataset["east_m"], dataset["north_m"])
    )
    end_points = [_KM * _last_position(dataset, ("east_m", "north_m"), line_style.index) for line_style in line_styles]
    end_points += [_KM * _last_position(dataset, ("goal_east_m", "goal_north_m"), k) for k in last_aircraft.values()]
    occupied = [(goal_end, MARKER_SIZE) for goal_end in end_points]
    for name, k in last_aircraft.items():
        east, north = (_KM * dataset[f"goal_{axis}_m"].values[:, k] for axis in ("east", "north"))
        finite = np.flatnonzero(np.isfinite(east))
        axes.plot(east[finite], north[finite], color=INK, linestyle=":", linewidth=1.2, zorder=6)
        axes.plot(east[0], north[0], "s", color=INK, mfc="white", markersize=5.5, mew=1.1, zorder=5)
        if len(last_aircraft) <= NAMES_MAX:
            goal_end = np.array([east[finite[-1]], north[finite[-1]]])
            side = clear_direction(goal_end, _goal_direction(dataset, k, finite), extent, occupied)
            annotate_position(axes, name, goal_end, side, INK, _font_size(len(last_aircraft)))


def _goal_direction(dataset: xr.Dataset, k: int, finite: np.ndarray) -> tuple[float, float]:
    extents = [float(np.ptp(dataset[f"goal_{axis}_m"].values[finite, k])) for axis in ("east", "north")]
    prefix = "goal_" if max(extents) > 1.0 else ""
    steps = [np.diff(dataset[f"{prefix}{axis}_m"].values[finite[-2:], k])[-1] for axis in ("east", "north")]
    return unit_vector(np.array(steps))


def _last_position(dataset: xr.Dataset, names: tuple[str, str], k: int) -> np.ndarray:
    """Return the last finite position, m, in column `k` of the two variables `names`."""
    last_sample = np.flatnonzero(np.isfinite(dataset[names[0]].values[:, k]))[-1]
    return np.array([dataset[name].values[last_sample, k] for name in names])


def _draw_keep_outs(axes: "Axes", dataset: xr.Dataset) -> None:
    from matplotlib.patches import Circle

    end = float(dataset["time"].values[-1])
    for k in range(dataset.sizes.get("keep_out", 0)):
        keep_out = {name: float(dataset[f"keep_out_{name}"].values[k]) for name in _KEEP_OUT}
        start_point = (keep_out["east_m"] * _KM, keep_out["north_m"] * _KM)
        step = (end * _KM * keep_out["velocity_east_m_s"], end * _KM * keep_out["velocity_north_m_s"])
        end_point = (start_point[0] + step[0], start_point[1] + step[1])
        radius = keep_out["radius_m"] * _KM
        style: dict[str, Any] = {"edgecolor": LIMIT_COLOR, "linewidth": 1.0, "zorder": 2}
        axes.add_patch(Circle(start_point, radius, facecolor=f"{LIMIT_COLOR}26", **style))
        if start_point != end_point:
            axes.add_patch(Circle(end_point, radius, facecolor="none", linestyle=DASHED, **style))
            arrow = {"arrowstyle": "->", "color": LIMIT_COLOR, "linewidth": 1.0}
            axes.annotate("", end_point, start_point, arrowprops=arrow, zorder=2)
        label = f"{dataset['keep_out'].values[k]}\n{keep_out['bottom_m']:,.0f} to {keep_out['top_m']:,.0f} m"
        axes.annotate(
            label,
            (start_point[0], start_point[1] - radius),
            xytext=(0, -2),
            textcoords="offset points",
            ha="center",
            va="top",
            color=LIMIT_COLOR,
            fontsize=SMALL,
            zorder=7,
        )


_KEEP_OUT = ("east_m", "north_m", "velocity_east_m_s", "velocity_north_m_s", "radius_m", "bottom_m", "top_m")


def _draw_closest_pair(axes: "Axes", dataset: xr.Dataset) -> None:
    measure = "separation" if "separation_m" in dataset else "distance"
    pair, time_s = dataset[f"least_{measure}_pair"].values, dataset[f"least_{measure}_at_s"].item()
    if pair[0] < 0:
        return
    times = dataset["time"].values
    coordinates = []
    for name in ("east_m", "north_m"):
        for k in pair:
            is_finite = np.isfinite(dataset[name].values[:, k])
            coordinates.append(_KM * np.interp(time_s, times[is_finite], dataset[name].values[is_finite, k]))
    axes.plot(coordinates[:2], coordinates[2:], color=INK, linewidth=1.0, marker="x", markersize=5, mew=1.2, zorder=7)


def _legend(axes: "Axes", dataset: xr.Dataset) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def mark(marker: str, label: str, **properties: Any) -> Line2D:
        return Line2D([], [], color=MUTED, linestyle="none", marker=marker, markersize=5, label=label, **properties)

    handles: list[Any] = [
        mark("o", "start"),
        mark("D", "rendezvous, at arrival"),
        mark("s", "goal at the start", mfc="white", mec=INK),
        Line2D([], [], color=INK, linestyle=":", linewidth=1.2, label="its way"),
    ]
    if dataset["least_distance_pair"].values[0] >= 0:
        handles.append(Line2D([], [], color=INK, marker="x", markersize=5, linewidth=1.0, label="closest pair"))
    if dataset.sizes.get("keep_out", 0):
        handles.append(
            Patch(facecolor=f"{LIMIT_COLOR}26", edgecolor=LIMIT_COLOR, label="keep-out (dashed: at the end)")
        )
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.07),
        ncols=3 if len(handles) > _ONE_ROW_HANDLES_MAX else 5,
        frameon=False,
    )


_LABEL_WIDTH = 26
_CEILING_DISTANCE_MAX = 2.0  # in ranges of the altitudes; a higher ceiling is only written as text


def draw_plan_variable(
    axes: "Axes", dataset: xr.Dataset, styles: list[LineStyle], name: str, limits: tuple[str, ...], both_signs: bool
) -> None:
    """Draw the variable `name` of all aircraft over time, and the limits in the variables "limit_" + entry of `limits`.

    If `both_signs` is True, the negated limits are drawn as well.
    """
    _draw_lines(axes, dataset, styles, name)
    signs = (1.0, -1.0) if both_signs else (1.0,)
    for limit in limits:
        values = np.unique(dataset[f"limit_{limit}"].values)
        for value in values[np.isfinite(values)]:
            for sign in signs:
                _draw_limit(axes, sign * float(value))
    axes.margins(y=0.08)


def draw_plan_altitude(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle]) -> None:
    """Draw the altitudes over time, with the allowed least and greatest altitude; a limit far above is only named."""
    _draw_lines(axes, dataset, line_styles, "altitude_m")
    floor, ceiling = (float(dataset[f"limit_altitude_{end}_m"].values[0]) for end in ("min", "max"))
    altitudes = dataset["altitude_m"].values
    highest = float(np.max(altitudes[np.isfinite(altitudes)], initial=floor))
    if np.isfinite(floor):
        _draw_limit(axes, floor)
    if np.isfinite(ceiling):
        if ceiling - highest <= _CEILING_DISTANCE_MAX * (highest - floor):
            _draw_limit(axes, ceiling)
        else:
            _annotate(axes, f"ceiling {ceiling:,.0f} m", 0.98)
            axes.set_ylim(top=highest + 0.22 * max(highest - floor, 1.0))
            return
    axes.margins(y=0.08)


def draw_plan_separation(axes: "Axes", dataset: xr.Dataset) -> None:
    """Draw the least separation over time (the least distance if none is required), and name the closest pair."""
    attributes = dataset.attrs
    has_separation = "separation_m" in dataset
    measure, name = ("separation", "separation_m") if has_separation else ("distance", "distance_min_m")
    axes.set_ylabel(_label(dataset[name]))
    if dataset[f"least_{measure}_pair"].values[0] < 0:
        axes.set_yticks([])
        _annotate(axes, "a single aircraft", 0.55)
        return
    times = dataset["time"].values
    axes.set_yscale("log")
    axes.plot(times, dataset[name].values, color=INK, linewidth=1.3)
    curves = [dataset[name].values]
    if has_separation:
        _draw_limit(axes, attributes["separation_horizontal_m"])
    if "distance_limit_m" in attributes:
        if has_separation:
            axes.plot(times, dataset["distance_min_m"].values, color=MUTED, linewidth=0.9, label="in space")
            curves.append(dataset["distance_min_m"].values)
            axes.legend(loc="lower left")
        _draw_limit(axes, attributes["distance_limit_m"])
    least_value, time_s = dataset[f"least_{measure}_m"].item(), dataset[f"least_{measure}_at_s"].item()
    axes.plot([time_s], [least_value], "x", color=INK, markersize=5, mew=1.2, clip_on=False)
    level, height = (dataset[f"least_{measure}_{part}_m"].item() for part in ("level", "height"))
    first_name, second_name = closest_pair_names(dataset, measure) or ("", "")
    axes.set_title(
        f"closest: {first_name} and {second_name} at {time_s:.1f} s, {level:,.0f} m in the plane, "
        f"{height:,.0f} m in altitude",
        fontsize=SMALL,
        loc="left",
        pad=3.0,
    )
    if has_separation and attributes["separation_vertical_m"] > 0.0:
        vertical, horizontal = (attributes[f"separation_{axis}_m"] for axis in ("vertical", "horizontal"))
        _annotate(axes, f"{vertical:g} m in altitude count as {horizontal:g} m", 0.97)
    _format_log_axis(axes, np.concatenate(curves))


def _format_log_axis(axes: "Axes", values: np.ndarray) -> None:
    """Format the ticks of a logarithmic axis as plain numbers, and extend the axis for text above `values`."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    axes.set_ylim(low * 0.9, max(high, 1.6 * float(np.nanmax(values))))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _draw_lines(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle], name: str) -> None:
    times, values = dataset["time"].values, dataset[name].values
    for line_style in line_styles:
        axes.plot(times, values[:, line_style.index], **line_style.properties, zorder=3)
        end = np.flatnonzero(np.isfinite(values[:, line_style.index]))[-1]
        mark: dict[str, Any] = {"color": line_style.color, "markersize": 3.0 + line_style.width, "clip_on": False}
        axes.plot(times[end], values[end, line_style.index], "D", zorder=4, **mark)
    axes.set_ylabel(_label(dataset[name]))


def _draw_limit(axes: "Axes", value: float) -> None:
    draw_limit_line(axes, value)
    axes.annotate(
        f"{value:,.6g}".replace("-", "\u2212"),
        (1.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(8, 0),
        textcoords="offset points",
        va="center",
        color=LIMIT_COLOR,
        fontsize=SMALL,
    )


def _annotate(axes: "Axes", text: str, height: float) -> None:
    axes.text(0.99, height, text, transform=axes.transAxes, ha="right", va="top", color=MUTED, fontsize=SMALL)


def _label(values: xr.DataArray) -> str:
    return textwrap.fill(f"{values.attrs['long_name']} ({display_unit(values)})", _LABEL_WIDTH)


def draw_plan(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw map, altitudes, airspeeds, bank angles and separation of a plan into new files `plan.svg` and `plan.png`.

    `dataset` must be a result of `anser.results.plan_dataset`. Returns the paths of the files. Raises FileExistsError
    if one of the files exists.
    """
    return save_drawings({"plan": _plan}, dataset, {**PRINT_STYLE, "svg.hashsalt": "anser-plan"}, folder)


def _plan(dataset: xr.Dataset) -> "Figure":
    line_styles = aircraft_line_styles(dataset)
    _, figure = new_figure((13.0, 8.6))
    grid = figure.add_gridspec(4, 2, width_ratios=[1.25, 1.0])
    map_axes = figure.add_subplot(grid[:, 0])
    panels = [figure.add_subplot(grid[grid_row, 1]) for grid_row in range(4)]
    draw_plan_map(map_axes, dataset, line_styles)
    draw_plan_altitude(panels[0], dataset, line_styles)
    speed_limits = ("airspeed_min_m_s", "airspeed_max_m_s")
    draw_plan_variable(panels[1], dataset, line_styles, "airspeed_m_s", speed_limits, both_signs=False)
    draw_plan_variable(panels[2], dataset, line_styles, "bank_deg", ("bank_max_deg",), both_signs=True)
    draw_plan_separation(panels[3], dataset)
    end = dataset["time"].values[-1]
    for axes in panels:
        axes.set_xlim(dataset["time"].values[0], end)
        axes.tick_params(labelbottom=axes is panels[-1])
    panels[-1].set_xlabel("Time $t$ (s)")
    figure.align_ylabels(panels)
    figure.suptitle("\n".join(_heading(dataset, line_styles)), fontsize=LARGE)
    return figure


def _heading(dataset: xr.Dataset, line_styles: list[LineStyle]) -> list[str]:
    attributes = dataset.attrs
    arrivals = dataset["arrival_time_s"].values
    earliest, latest = float(np.min(arrivals)), float(np.max(arrivals))
    is_common = latest - earliest < 5e-3
    arrival_text = f"arrival at {latest:.2f} s" if is_common else f"arrivals from {earliest:.2f} s to {latest:.2f} s"
    fleet = "1 aircraft" if len(line_styles) == 1 else f"{len(line_styles)} aircraft"
    rule = f'rule "{attributes["rule"]}"'
    heading = f"{attributes['title']}: {fleet}, {arrival_text} ({rule}), {attributes['planner']} planner"
    note = f"dots: every {marker_period(dataset):g} s; dashed: limits of the scenario"
    if prefix := shared_prefix(dataset):
        note += f'; names without "{prefix}"'
    lines = [heading, note]
    problems = attributes["problems"].split("\n") if attributes["problems"] else []
    if problems:
        problem_count = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        lines.append(f"not flyable: {problems[0]}{problem_count}")
    return lines


_FAMILIES = {
    # parameter, ordinate of the path, angle with the greatest change, heading
    "b4": ("lateral_shape_m_s4", "east_m", "course_command_deg", "Paths bent sideways"),
    "c4": ("vertical_shape_m_s4", "altitude_m", "path_angle_command_deg", "Paths bent vertically"),
}


def draw_shapes(dataset: xr.Dataset, family: str, folder: Path) -> tuple[Path, ...]:
    """Draw a family of paths of the published planner into new files `shape-b4` or `shape-c4`, SVG, PNG and PDF.

    `family` is the parameter that bends the paths sideways ("b4") or vertically ("c4"). Returns the paths of the files.
    Raises FileExistsError if one of the files exists.
    """
    parameter, ordinate, angle, heading = _FAMILIES[family]

    def draw(dataset: xr.Dataset) -> "Figure":
        _, figure = new_figure((6.5, 5.2))
        grid = figure.subplots(2, 2)
        time = dataset["time"].values
        for k in range(dataset.sizes["path"]):
            path = dataset.isel(path=k)
            style = {"markevery": (4 * k, 24), **marker_style(k)}
            label = f"{math_symbol(path[parameter])} = {_signed(path[parameter])} {display_unit(path[parameter])}"
            grid[0, 0].plot(path["north_m"].values, path[ordinate].values, label=label, **style)
            for axes, name in ((grid[0, 1], "airspeed_command_m_s"), (grid[1, 0], angle)):
                axes.plot(time, path[name].values, **style)
        for axes, name in ((grid[0, 0], ordinate), (grid[0, 1], "airspeed_command_m_s"), (grid[1, 0], angle)):
            axes.set_ylabel(axis_label(dataset[name]))
        grid[0, 0].set_xlabel(axis_label(dataset["north_m"]))
        for axes in (grid[0, 1], grid[1, 0]):
            axes.set_xlabel("Time $t$ (s)")
        lengths, values = grid[1, 1], dataset[parameter].values
        for name, style in (
            ("length_m", {"color": INK, "linestyle": "solid"}),
            ("length_estimate_m", {"color": MUTED, "linestyle": DASHED}),
        ):
            members = (dataset[f"member_{variable}"].values for variable in (parameter, name))
            lengths.plot(*members, label=dataset[name].attrs["long_name"], **style)
        published = dataset["length_published_m"]
        style = {"linestyle": "none", "marker": "o", "fillstyle": "none", "color": INK}
        lengths.plot(values, published.values, label=published.attrs["long_name"], **style)
        lengths.set_xlabel(axis_label(dataset[parameter]))
        lengths.set_ylabel(axis_label(dataset["length_m"]))
        lengths.legend(loc="best")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        final_path_angle = dataset["final_path_angle_deg"]
        figure.suptitle(
            f"{heading}: {time[-1]:g} s, {math_symbol(final_path_angle)} = {_signed(final_path_angle[0])}°",
            fontsize=LARGE,
        )
        return figure

    return save_drawings({f"shape-{family}": draw}, dataset, PRINT_STYLE, folder, FIGURE_SUFFIXES)


def _signed(value: xr.DataArray) -> str:
    return f"{float(value):g}".replace("-", "\N{MINUS SIGN}")
