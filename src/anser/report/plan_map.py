"""A plan seen from above: paths, goals and their motion, rendezvous points, closed volumes, the nearest pair."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.aircraft_pens import Pen
from anser.report.limit_lines import CLOSED
from anser.report.place_labels import MARK, MOST_NAMES, free_side, tell_place
from anser.report.print_style import DASHED, INK, QUIET, SMALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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


def mark_step(dataset: xr.Dataset) -> float:
    """Time between two dots on a path, s."""
    times = dataset["time"].values
    return next((step for step in _STEPS_S if (times[-1] - times[0]) / step <= _MARKS), _STEPS_S[-1])


def named_pair(dataset: xr.Dataset, what: str) -> tuple[str, str] | None:
    """Names of the two aircraft that come closest by "distance" or "separation"; None where there are no two."""
    pair = dataset[f"least_{what}_pair"].values
    if pair[0] < 0:
        return None
    names = dataset["aircraft"].values
    return str(names[pair[0]]), str(names[pair[1]])


def draw_map(axes: "Axes", dataset: xr.Dataset, pens: list[Pen]) -> None:
    """Draw the plan over east and north, in equal scales."""
    for name, set_label in (("east_m", axes.set_xlabel), ("north_m", axes.set_ylabel)):
        set_label(f"{dataset[name].attrs['long_name']} (km)")
    _keep_outs(axes, dataset)
    _goals(axes, dataset, pens)
    for pen in pens:
        _path(axes, dataset, pen, len(pens))
    _closest(axes, dataset)
    axes.set_aspect("equal", adjustable="datalim")
    _leave_room_aside(axes, dataset, pens)
    axes.margins(x=0.02, y=0.1)
    _legend(axes, dataset)


def _leave_room_aside(axes: "Axes", dataset: xr.Dataset, pens: list[Pen]) -> None:
    """Have the map reach beyond what is drawn on either side, as far as the longest name that may stand there."""
    if len(pens) > MOST_NAMES:
        return
    longest = max(len(pen.label) for pen in pens) + (_TIME_LETTERS if _tells_times(dataset, len(pens)) else 0)
    part = min((_NAME_GAP + _LETTER_WIDTH * _letters(len(pens)) * longest) / _MAP_WIDTH, _ASIDE_MOST)
    (low, high), north = axes.dataLim.intervalx, axes.dataLim.intervaly[0]
    room = part / (1.0 - 2.0 * part) * (high - low)  # an equal scale may take the margins away
    axes.update_datalim([(low - room, north), (high + room, north)])


def _path(axes: "Axes", dataset: xr.Dataset, pen: Pen, fleet: int) -> None:
    times = dataset["time"].values
    east, north = (_KM * dataset[name].values[:, pen.index] for name in ("east_m", "north_m"))
    flown = np.flatnonzero(np.isfinite(east))
    axes.plot(east[flown], north[flown], color=pen.color, linestyle=pen.dashes, linewidth=pen.width, zorder=3)
    every = times[0] + mark_step(dataset) * np.arange(1, 1 + int((times[-1] - times[0]) / mark_step(dataset)))
    at = flown[np.isin(times[flown], every)]
    axes.plot(east[at], north[at], ".", color=pen.color, markersize=3.0 + 2.0 * pen.width, zorder=4)
    start, end = flown[0], flown[-1]
    axes.plot(east[start], north[start], "o", color=pen.color, markersize=5, zorder=5)
    axes.plot(east[end], north[end], "D", color=pen.color, markersize=5.5, zorder=6, mec="white", mew=0.6)
    if fleet <= MOST_NAMES:
        # behind the aircraft, clear of its path
        back = np.array([east[start] - east[flown[1]], north[start] - north[flown[1]]])
        side, up = back / max(float(np.hypot(*back)), _TINY)
        arrivals = dataset["arrival_time_s"].values
        words = f"{pen.label}, {arrivals[pen.index]:.2f} s" if _tells_times(dataset, fleet) else pen.label
        tell_place(axes, words, (float(east[start]), float(north[start])), (side, up), pen.color, _letters(fleet))


def _tells_times(dataset: xr.Dataset, fleet: int) -> bool:
    """Whether each name has its own arrival time beside it."""
    return fleet <= _FEW_NAMES and float(np.ptp(dataset["arrival_time_s"].values)) > _SAME_TIME_S


def _letters(names: int) -> float:
    return SMALL + (1.0 if names <= _FEW_NAMES else 0.0)


def _goals(axes: "Axes", dataset: xr.Dataset, pens: list[Pen]) -> None:
    """Each goal once: where it is at first, and its way until the last of its aircraft arrives."""
    goals = dataset["goal"].values
    last: dict[str, int] = {}
    for pen in pens:
        goal = str(goals[pen.index])
        arrivals = dataset["arrival_time_s"].values
        if goal not in last or arrivals[pen.index] > arrivals[last[goal]]:
            last[goal] = pen.index
    extent = max(_KM * float(np.nanmax(of) - np.nanmin(of)) for of in (dataset["east_m"], dataset["north_m"]))
    ends = [_KM * _end(dataset, ("east_m", "north_m"), pen.index) for pen in pens]
    ends += [_KM * _end(dataset, ("goal_east_m", "goal_north_m"), k) for k in last.values()]
    taken = [(end, MARK) for end in ends]
    for name, k in last.items():
        east, north = (_KM * dataset[f"goal_{axis}_m"].values[:, k] for axis in ("east", "north"))
        there = np.flatnonzero(np.isfinite(east))
        axes.plot(east[there], north[there], color=INK, linestyle=":", linewidth=1.2, zorder=6)
        axes.plot(east[0], north[0], "s", color=INK, mfc="white", markersize=5.5, mew=1.1, zorder=5)
        if len(last) <= MOST_NAMES:
            end = np.array([east[there[-1]], north[there[-1]]])
            side = free_side(end, _ahead(dataset, k, there), extent, taken)
            tell_place(axes, name, (end[0], end[1]), side, INK, _letters(len(last)))


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
        style: dict[str, Any] = {"edgecolor": CLOSED, "linewidth": 1.0, "zorder": 2}
        axes.add_patch(Circle((here[0], here[1]), radius, facecolor=f"{CLOSED}26", **style))
        if not np.array_equal(here, there):
            axes.add_patch(Circle((there[0], there[1]), radius, facecolor="none", linestyle=DASHED, **style))
            arrow = {"arrowstyle": "->", "color": CLOSED, "linewidth": 1.0}
            axes.annotate("", (there[0], there[1]), (here[0], here[1]), arrowprops=arrow, zorder=2)
        words = f"{dataset['keep_out'].values[k]}\n{of['bottom_m']:,.0f} to {of['top_m']:,.0f} m"
        axes.annotate(
            words,
            (here[0], here[1] - radius),
            xytext=(0, -2),
            textcoords="offset points",
            ha="center",
            va="top",
            color=CLOSED,
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
        return Line2D([], [], color=QUIET, linestyle="none", marker=marker, markersize=5, label=label, **more)

    handles: list[Any] = [
        mark("o", "start"),
        mark("D", "rendezvous, at arrival"),
        mark("s", "goal at the start", mfc="white", mec=INK),
        Line2D([], [], color=INK, linestyle=":", linewidth=1.2, label="its way"),
    ]
    if dataset["least_distance_pair"].values[0] >= 0:
        handles.append(Line2D([], [], color=INK, marker="x", markersize=5, linewidth=1.0, label="closest pair"))
    if dataset.sizes.get("keep_out", 0):
        handles.append(Patch(facecolor=f"{CLOSED}26", edgecolor=CLOSED, label="keep-out (dashed: at the end)"))
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.07),
        ncols=3 if len(handles) > _FEW_HANDLES else 5,
        frameon=False,
    )
