"""Figure of a plan: map of paths.

Goals, keep-outs and the closest pair, and altitude, airspeed, bank and separation over time with their limits.
"""

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
    clear_direction,
    display_unit,
    draw_limit_line,
)
from anser.report.style import (
    DASHED,
    INK,
    LARGE,
    MUTED,
    PRINT_STYLE,
    SMALL,
    LineStyle,
    aircraft_line_styles,
    new_figure,
    save_drawings,
    shared_prefix,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_KM = 1e-3
_STEPS_S = (5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0)
_MARKS = 8
_SAME_TIME_S = 5e-3
_FEW_HANDLES = 5
_FEW_NAMES = 8  # up to so many have larger letters
_TINY = 1e-12
_MAP_WIDTH, _NAME_GAP, _LETTER_WIDTH = 430.0, 16.0, 0.6  # points; of a letter, as part of its size
_ASIDE_MOST = 0.22
_TIME_LETTERS = 9


def marker_period(dataset: xr.Dataset) -> float:
    """Time between two dots on a path, s."""
    times = dataset["time"].values
    return next((step for step in _STEPS_S if (times[-1] - times[0]) / step <= _MARKS), _STEPS_S[-1])


def closest_pair_names(dataset: xr.Dataset, measure: str) -> tuple[str, str] | None:
    """Names of the two aircraft that come closest by "distance" or "separation"; None where there are no two."""
    pair = dataset[f"least_{measure}_pair"].values
    if pair[0] < 0:
        return None
    names = dataset["aircraft"].values
    return str(names[pair[0]]), str(names[pair[1]])


def draw_plan_map(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle]) -> None:
    """Draw the plan over east and north, in equal scales."""
    for name, set_label in (("east_m", axes.set_xlabel), ("north_m", axes.set_ylabel)):
        set_label(f"{dataset[name].attrs['long_name']} (km)")
    _keep_outs(axes, dataset)
    _goals(axes, dataset, line_styles)
    for line_style in line_styles:
        _path(axes, dataset, line_style, len(line_styles))
    _closest(axes, dataset)
    axes.set_aspect("equal", adjustable="datalim")
    _leave_room_aside(axes, dataset, line_styles)
    axes.margins(x=0.02, y=0.1)
    _legend(axes, dataset)


def _leave_room_aside(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle]) -> None:
    """Have the map reach beyond what is drawn on either side, as far as the longest name that may stand there."""
    if len(line_styles) > NAMES_MAX:
        return
    longest = max(len(line_style.label) for line_style in line_styles) + (
        _TIME_LETTERS if _tells_times(dataset, len(line_styles)) else 0
    )
    part = min((_NAME_GAP + _LETTER_WIDTH * _letters(len(line_styles)) * longest) / _MAP_WIDTH, _ASIDE_MOST)
    (low, high), north = axes.dataLim.intervalx, axes.dataLim.intervaly[0]
    room = part / (1.0 - 2.0 * part) * (high - low)  # an equal scale may take the margins away
    axes.update_datalim([(low - room, north), (high + room, north)])


def _path(axes: "Axes", dataset: xr.Dataset, line_style: LineStyle, fleet: int) -> None:
    times = dataset["time"].values
    east, north = (_KM * dataset[name].values[:, line_style.index] for name in ("east_m", "north_m"))
    flown = np.flatnonzero(np.isfinite(east))
    axes.plot(
        east[flown],
        north[flown],
        color=line_style.color,
        linestyle=line_style.dashes,
        linewidth=line_style.width,
        zorder=3,
    )
    every = times[0] + marker_period(dataset) * np.arange(1, 1 + int((times[-1] - times[0]) / marker_period(dataset)))
    at = flown[np.isin(times[flown], every)]
    axes.plot(east[at], north[at], ".", color=line_style.color, markersize=3.0 + 2.0 * line_style.width, zorder=4)
    start, end = flown[0], flown[-1]
    axes.plot(east[start], north[start], "o", color=line_style.color, markersize=5, zorder=5)
    axes.plot(east[end], north[end], "D", color=line_style.color, markersize=5.5, zorder=6, mec="white", mew=0.6)
    if fleet <= NAMES_MAX:
        # behind the aircraft, clear of its path
        back = np.array([east[start] - east[flown[1]], north[start] - north[flown[1]]])
        side, up = back / max(float(np.hypot(*back)), _TINY)
        arrivals = dataset["arrival_time_s"].values
        words = (
            f"{line_style.label}, {arrivals[line_style.index]:.2f} s"
            if _tells_times(dataset, fleet)
            else line_style.label
        )
        annotate_position(
            axes, words, (float(east[start]), float(north[start])), (side, up), line_style.color, _letters(fleet)
        )


def _tells_times(dataset: xr.Dataset, fleet: int) -> bool:
    """Whether each name has its own arrival time beside it."""
    return fleet <= _FEW_NAMES and float(np.ptp(dataset["arrival_time_s"].values)) > _SAME_TIME_S


def _letters(names: int) -> float:
    return SMALL + (1.0 if names <= _FEW_NAMES else 0.0)


def _goals(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle]) -> None:
    """Each goal once: where it is at first, and its way until the last of its aircraft arrives."""
    goals = dataset["goal"].values
    last: dict[str, int] = {}
    for line_style in line_styles:
        goal = str(goals[line_style.index])
        arrivals = dataset["arrival_time_s"].values
        if goal not in last or arrivals[line_style.index] > arrivals[last[goal]]:
            last[goal] = line_style.index
    extent = max(_KM * float(np.nanmax(of) - np.nanmin(of)) for of in (dataset["east_m"], dataset["north_m"]))
    ends = [_KM * _end(dataset, ("east_m", "north_m"), line_style.index) for line_style in line_styles]
    ends += [_KM * _end(dataset, ("goal_east_m", "goal_north_m"), k) for k in last.values()]
    taken = [(end, MARKER_SIZE) for end in ends]
    for name, k in last.items():
        east, north = (_KM * dataset[f"goal_{axis}_m"].values[:, k] for axis in ("east", "north"))
        there = np.flatnonzero(np.isfinite(east))
        axes.plot(east[there], north[there], color=INK, linestyle=":", linewidth=1.2, zorder=6)
        axes.plot(east[0], north[0], "s", color=INK, mfc="white", markersize=5.5, mew=1.1, zorder=5)
        if len(last) <= NAMES_MAX:
            end = np.array([east[there[-1]], north[there[-1]]])
            side = clear_direction(end, _ahead(dataset, k, there), extent, taken)
            annotate_position(axes, name, (end[0], end[1]), side, INK, _letters(len(last)))


def _ahead(dataset: xr.Dataset, k: int, there: np.ndarray) -> tuple[float, float]:
    """Where a goal goes to, or, of one that stands, the aircraft that comes there: clear of the lines; east, north."""
    way = [float(np.ptp(dataset[f"goal_{axis}_m"].values[there, k])) for axis in ("east", "north")]
    of = "goal_" if max(way) > 1.0 else ""
    steps = [np.diff(dataset[f"{of}{axis}_m"].values[there[-2:], k])[-1] for axis in ("east", "north")]
    length = max(float(np.hypot(*steps)), _TINY)
    return float(steps[0]) / length, float(steps[1]) / length


def _end(dataset: xr.Dataset, names: tuple[str, str], k: int) -> np.ndarray:
    """Last known place of one column, m."""
    known = np.flatnonzero(np.isfinite(dataset[names[0]].values[:, k]))[-1]
    return np.array([dataset[name].values[known, k] for name in names])


def _keep_outs(axes: "Axes", dataset: xr.Dataset) -> None:
    """Circles at the start, filled; where they move, dashed ones at the last arrival and their way."""
    from matplotlib.patches import Circle

    end = float(dataset["time"].values[-1])
    for k in range(dataset.sizes.get("keep_out", 0)):
        of = {name: float(dataset[f"keep_out_{name}"].values[k]) for name in _KEEP_OUT}
        here = np.array([of["east_m"], of["north_m"]]) * _KM
        there = here + end * _KM * np.array([of["velocity_east_m_s"], of["velocity_north_m_s"]])
        radius = of["radius_m"] * _KM
        style: dict[str, Any] = {"edgecolor": LIMIT_COLOR, "linewidth": 1.0, "zorder": 2}
        axes.add_patch(Circle((here[0], here[1]), radius, facecolor=f"{LIMIT_COLOR}26", **style))
        if not np.array_equal(here, there):
            axes.add_patch(Circle((there[0], there[1]), radius, facecolor="none", linestyle=DASHED, **style))
            arrow = {"arrowstyle": "->", "color": LIMIT_COLOR, "linewidth": 1.0}
            axes.annotate("", (there[0], there[1]), (here[0], here[1]), arrowprops=arrow, zorder=2)
        words = f"{dataset['keep_out'].values[k]}\n{of['bottom_m']:,.0f} to {of['top_m']:,.0f} m"
        axes.annotate(
            words,
            (here[0], here[1] - radius),
            xytext=(0, -2),
            textcoords="offset points",
            ha="center",
            va="top",
            color=LIMIT_COLOR,
            fontsize=SMALL,
            zorder=7,
        )


_KEEP_OUT = ("east_m", "north_m", "velocity_east_m_s", "velocity_north_m_s", "radius_m", "bottom_m", "top_m")


def _closest(axes: "Axes", dataset: xr.Dataset) -> None:
    """Join the two that come closest, where they are then."""
    what = "separation" if "separation_m" in dataset else "distance"
    pair, at = dataset[f"least_{what}_pair"].values, dataset[f"least_{what}_at_s"].item()
    if pair[0] < 0:
        return
    times = dataset["time"].values
    places = []
    for name in ("east_m", "north_m"):
        for k in pair:
            known = np.isfinite(dataset[name].values[:, k])
            places.append(_KM * np.interp(at, times[known], dataset[name].values[known, k]))
    axes.plot(places[:2], places[2:], color=INK, linewidth=1.0, marker="x", markersize=5, mew=1.2, zorder=7)


def _legend(axes: "Axes", dataset: xr.Dataset) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def mark(marker: str, label: str, **more: Any) -> Line2D:
        return Line2D([], [], color=MUTED, linestyle="none", marker=marker, markersize=5, label=label, **more)

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
        ncols=3 if len(handles) > _FEW_HANDLES else 5,
        frameon=False,
    )


_LABEL_WIDTH = 26
_FAR = 2.0  # a ceiling that is farther above the paths than so many times their range only has its number


def draw_plan_variable(
    axes: "Axes",
    dataset: xr.Dataset,
    line_styles: list[LineStyle],
    name: str,
    limits: tuple[str, ...],
    both_signs: bool,
) -> None:
    """Draw one variable of all aircraft, and its limits by their names without `limit_` (`both`: with either sign)."""
    _lines(axes, dataset, line_styles, name)
    values = [float(value) for limit in limits for value in np.unique(dataset[f"limit_{limit}"].values)]
    for value in [
        sign * value for value in values if np.isfinite(value) for sign in ((1.0, -1.0) if both_signs else (1.0,))
    ]:
        _limit(axes, value)
    axes.margins(y=0.08)


def draw_plan_altitude(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle]) -> None:
    """Draw the altitudes, floor and ceiling; a ceiling far above is only told."""
    _lines(axes, dataset, line_styles, "altitude_m")
    floor, ceiling = (float(dataset[f"limit_altitude_{end}_m"].values[0]) for end in ("min", "max"))
    altitudes = dataset["altitude_m"].values
    highest = float(np.max(altitudes[np.isfinite(altitudes)], initial=floor))
    if np.isfinite(floor):
        _limit(axes, floor)
    if np.isfinite(ceiling):
        if ceiling - highest <= _FAR * (highest - floor):
            _limit(axes, ceiling)
        else:
            _annotate(axes, f"ceiling {ceiling:,.0f} m", 0.98)
            axes.set_ylim(top=highest + 0.22 * max(highest - floor, 1.0))
            return
    axes.margins(y=0.08)


def draw_plan_separation(axes: "Axes", dataset: xr.Dataset) -> None:
    """Draw the least separation where one is asked for, else the least distance, and name the closest pair."""
    of = dataset.attrs
    asked = "separation_m" in dataset
    what, name = ("separation", "separation_m") if asked else ("distance", "distance_min_m")
    axes.set_ylabel(_label(dataset[name]))
    if dataset[f"least_{what}_pair"].values[0] < 0:
        axes.set_yticks([])
        _annotate(axes, "a single aircraft", 0.55)
        return
    times = dataset["time"].values
    axes.set_yscale("log")
    axes.plot(times, dataset[name].values, color=INK, linewidth=1.3)
    shown = [dataset[name].values]
    if asked:
        _limit(axes, of["separation_horizontal_m"])
    if "distance_limit_m" in of:
        if asked:
            axes.plot(times, dataset["distance_min_m"].values, color=MUTED, linewidth=0.9, label="in space")
            shown.append(dataset["distance_min_m"].values)
            axes.legend(loc="lower left")
        _limit(axes, of["distance_limit_m"])
    least, at = dataset[f"least_{what}_m"].item(), dataset[f"least_{what}_at_s"].item()
    axes.plot([at], [least], "x", color=INK, markersize=5, mew=1.2, clip_on=False)
    level, height = (dataset[f"least_{what}_{part}_m"].item() for part in ("level", "height"))
    one, other = closest_pair_names(dataset, what) or ("", "")
    axes.set_title(
        f"closest: {one} and {other} at {at:.1f} s, {level:,.0f} m in the plane, {height:,.0f} m in altitude",
        fontsize=SMALL,
        loc="left",
        pad=3.0,
    )
    if asked and of["separation_vertical_m"] > 0.0:
        words = f"{of['separation_vertical_m']:g} m in altitude count as {of['separation_horizontal_m']:g} m"
        _annotate(axes, words, 0.97)
    _decades(axes, np.concatenate(shown))


def _decades(axes: "Axes", values: np.ndarray) -> None:
    """Plain numbers at the ticks of a logarithmic axis, with room above for words."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    axes.set_ylim(low * 0.9, max(high, 1.6 * float(np.nanmax(values))))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _lines(axes: "Axes", dataset: xr.Dataset, line_styles: list[LineStyle], name: str) -> None:
    times, values = dataset["time"].values, dataset[name].values
    for line_style in line_styles:
        axes.plot(
            times,
            values[:, line_style.index],
            color=line_style.color,
            linestyle=line_style.dashes,
            linewidth=line_style.width,
            zorder=3,
        )
        end = np.flatnonzero(np.isfinite(values[:, line_style.index]))[-1]
        axes.plot(
            times[end],
            values[end, line_style.index],
            "D",
            color=line_style.color,
            markersize=3.0 + line_style.width,
            zorder=4,
            clip_on=False,
        )
    axes.set_ylabel(_label(dataset[name]))


def _limit(axes: "Axes", value: float) -> None:
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


def _annotate(axes: "Axes", words: str, height: float) -> None:
    axes.text(0.99, height, words, transform=axes.transAxes, ha="right", va="top", color=MUTED, fontsize=SMALL)


def _label(values: xr.DataArray) -> str:
    return textwrap.fill(f"{values.attrs['long_name']} ({display_unit(values)})", _LABEL_WIDTH)


_STYLE = {**PRINT_STYLE, "svg.hashsalt": "anser-plan"}


def draw_plan(dataset: xr.Dataset, folder: Path) -> tuple[Path, ...]:
    """Draw a plan into `plan.svg` and `plan.png` of a folder.

    Parameters
    ----------
    dataset
        As `anser.results.plan_record` makes it.
    folder
        To write into; returns the paths of its new files.
    """
    return save_drawings({"plan": _plan}, dataset, _STYLE, folder)


def _plan(dataset: xr.Dataset) -> "Figure":
    line_styles = aircraft_line_styles(dataset)
    _, figure = new_figure((13.0, 8.6))
    grid = figure.add_gridspec(4, 2, width_ratios=[1.25, 1.0])
    above = figure.add_subplot(grid[:, 0])
    panels = [figure.add_subplot(grid[row, 1]) for row in range(4)]
    draw_plan_map(above, dataset, line_styles)
    draw_plan_altitude(panels[0], dataset, line_styles)
    draw_plan_variable(
        panels[1], dataset, line_styles, "airspeed_m_s", ("airspeed_min_m_s", "airspeed_max_m_s"), both_signs=False
    )
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
    of = dataset.attrs
    arrivals = dataset["arrival_time_s"].values
    first, last = float(np.min(arrivals)), float(np.max(arrivals))
    common = last - first < 5e-3
    when = f"arrival at {last:.2f} s" if common else f"arrivals from {first:.2f} s to {last:.2f} s"
    fleet = "1 aircraft" if len(line_styles) == 1 else f"{len(line_styles)} aircraft"
    lines = [f'{of["title"]}: {fleet}, {when} (rule "{of["rule"]}"), {of["planner"]} planner']
    note = f"dots: every {marker_period(dataset):g} s; dashed: limits of the scenario"
    prefix = shared_prefix(dataset)
    if prefix:
        note += f'; names without "{prefix}"'
    lines.append(note)
    problems = of["problems"].split("\n") if of["problems"] else []
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        lines.append(f"not flyable: {problems[0]}{more}")
    return lines
