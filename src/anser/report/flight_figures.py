"""Figures of a flight for print: tracks, altitudes, ranges, guidance, the goals' estimated velocities, the plan."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.flown_beside_plan import HOLD, asked_separation, is_certified, scenario_of
from anser.report.labels import axis_label, plain
from anser.report.links_strip import network_of, pair_links
from anser.report.print_style import (
    DASHED,
    FIGURE_SUFFIXES,
    INK,
    LARGE,
    PRINT_STYLE,
    QUIET,
    SMALL,
    marker_of,
    new_figure,
    save_drawings,
)
from anser.results import nearest_other

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH = 6.5  # inches: the text of a page
_GUIDANCE = (
    ("airspeed_m_s", "airspeed_command_m_s"),
    ("path_angle_deg", "path_angle_command_deg"),
    ("course_deg", "course_command_deg"),
)
_VELOCITIES = tuple(
    (f"goal_estimate_velocity_{axis}_m_s", f"goal_velocity_{axis}_m_s") for axis in ("north", "east", "down")
)
_ALTITUDE, _RANGE = ("altitude_m", "reference_altitude_m"), "range_to_rendezvous_m"
_PLAN = ("lateral_bend_m", "planned_length_m", "arrival_time_s")
NEEDED_VARIABLES = (
    *(f"{place}{axis}_m" for place in ("", "reference_", "goal_", "rendezvous_") for axis in ("north", "east")),
    *(name for pair in (*_GUIDANCE, *_VELOCITIES, _ALTITUDE) for name in pair),
    *(_RANGE, *_PLAN, "phase"),
)
"""Variables of a flight that these figures draw."""

_MARKS = 8  # on a line over time
_SPAN_MIN = {"m s-1": 2.0, "degree": 2.0, "m": 10.0, "s": 0.2}
"""Least height of a panel: what hardly moves must not look as if it did."""
_FEW = 7  # aircraft; of more, the lines are thinner


def draw_flight(
    dataset: xr.Dataset, name: str, folder: Path, suffixes: Sequence[str] = FIGURE_SUFFIXES
) -> tuple[Path, ...]:
    """Draw each of `FLIGHT_FIGURES` up to the arrivals into `NAME-FIGURE` of a folder.

    Parameters
    ----------
    dataset
        The flight, as `flight.nc` holds it.
    name
        What the names of the files begin with.
    folder
        To write into; returns the paths of its new files.
    suffixes
        Kinds of files, of `FIGURE_SUFFIXES`.
    """
    drawings = {f"{name}-{key}": draw for key, draw in figures_of(dataset).items()}
    return save_drawings(drawings, dataset, PRINT_STYLE, folder, suffixes)


def figures_of(dataset: xr.Dataset) -> dict[str, Callable[[xr.Dataset], "Figure"]]:
    """What can be drawn of a flight, by name."""
    known = KNOWLEDGE_FIGURES if "goal_sigma_north_m" in dataset else {}
    talked = NETWORK_FIGURES if network_of(dataset) else {}
    alone = dataset.sizes["aircraft"] == 1
    figures = {key: draw for key, draw in FLIGHT_FIGURES.items() if not (alone and key == "separation")}
    return figures | known | talked


def _tracks(dataset: xr.Dataset) -> "Figure":
    figure = _figure(dataset, 5.4)
    axes = figure.subplots()
    meeting = _meetings(dataset)
    period = _nice(float(dataset["time"].values[meeting.max()]) / 12)
    for k, last in enumerate(meeting):
        until = slice(0, int(last) + 1)
        north, east = (dataset[f"{axis}_m"].values[until, k] for axis in ("north", "east"))
        goal = [dataset[f"goal_{axis}_m"].values[until, k] for axis in ("east", "north")]
        planned = [dataset[f"reference_{axis}_m"].values[until, k] for axis in ("east", "north")]
        met = [dataset[f"rendezvous_{axis}_m"].values[last, k] for axis in ("east", "north")]
        of = _look(dataset, k)
        ticks = np.searchsorted(dataset["time"].values[until], np.arange(0.0, 1e5, period))
        axes.plot(east, north, markevery=list(np.unique(ticks[ticks <= last])), label=_name(dataset, k), **of)
        axes.plot(*planned, color=INK, linestyle=DASHED, linewidth=0.8, zorder=3)
        axes.plot(*goal, color=of["color"], linestyle=(0, (1, 1.2)), linewidth=1.3)
        axes.plot(goal[0][0], goal[1][0], linestyle="none", marker="s", fillstyle="none", color=INK, markersize=5)
        axes.plot(*met, linestyle="none", marker="*", color=INK, markersize=8, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    axes.set_xlabel(axis_label(dataset["east_m"]))
    axes.set_ylabel(axis_label(dataset["north_m"]))
    note = f"marks every {period:g} s; dashed: planned; dotted: goal, from its square; star: rendezvous at the arrival"
    return _finish(figure, [axes], dataset, "tracks over ground up to the arrival", note)


def _ranges(dataset: xr.Dataset) -> "Figure":
    figure = _figure(dataset, 3.2)
    panels = list(figure.subplots(1, 2))
    for axes, scale in zip(panels, ("linear", "log"), strict=True):
        _panel(axes, dataset, _RANGE, None)
        axes.set_yscale(scale)
        axes.set_xlabel("Time $t$ (s)")
    panels[0].set_ylim(bottom=0.0)
    panels[1].set_ylabel("")
    return _finish(figure, panels, dataset, "ranges to the rendezvous", "left linear, right logarithmic")


def _profile(dataset: xr.Dataset) -> "Figure":
    limits = scenario_of(dataset).get("limits", {})
    figure = _over_time(
        dataset, [_ALTITUDE, _GUIDANCE[0]], "altitude and airspeed", "dashed: planned, commanded; line: limit"
    )
    for axes, key in zip(figure.axes, ("altitude", "speed"), strict=True):
        unit = {"altitude": "m", "speed": "m_s"}[key]
        for end in ("min", "max"):
            value = limits.get(f"{key}_{end}_{unit}")
            if value is not None:
                _limit_line(axes, float(value))
    return figure


def _limit_line(axes: "Axes", value: float) -> None:
    """A line where a limit is, if that is within what the panel shows."""
    low, high = axes.get_ylim()
    if low <= value <= high:
        axes.axhline(value, color=QUIET, linewidth=0.8)


def _separation(dataset: xr.Dataset) -> "Figure":
    """Least distance of each aircraft to any other until the flight ends, and its ratio to the separation asked for."""
    asked = asked_separation(scenario_of(dataset))
    time = dataset["time"].values
    places = np.stack([dataset[name].values for name in ("north_m", "east_m", "altitude_m")], axis=-1)
    drawn: list[tuple[str, np.ndarray, float | None]] = [("Least distance to another (m)", nearest_other(places), None)]
    if asked is not None:
        drawn.append(("Distance over separation", nearest_other(places, asked), 1.0))
    figure = _figure(dataset, 1.4 + 1.9 * len(drawn))
    panels = list(figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0])
    for axes, (words, values, least) in zip(panels, drawn, strict=True):
        for k in range(values.shape[1]):
            every = _marked_every(time.size, k, values.shape[1])
            axes.plot(time, values[:, k], label=_name(dataset, k), markevery=every, **_look(dataset, k))
        axes.set_yscale("log")
        axes.set_ylabel(words)
        if least is not None:
            axes.axhline(least, color=INK, linewidth=0.8)
    panels[-1].set_xlabel("Time $t$ (s)")
    note = ""
    if asked is not None:
        note = f"asked for: {asked[0]:g} m" + (f", or {asked[1]:g} m in altitude" if asked[1] else "")
    return _finish(figure, panels, dataset, "distances between the aircraft", note)


def _plan(dataset: xr.Dataset) -> "Figure":
    if is_certified(scenario_of(dataset)):  # its paths have no such parameter
        names, words = _PLAN[1:], "length and arrival time of the plan"
    else:
        names, words = _PLAN, "shape parameter, length and arrival time of the plan"
    return _over_time(dataset, [(name, None) for name in names], words, "")


FLIGHT_FIGURES: dict[str, Callable[[xr.Dataset], "Figure"]] = {
    "tracks": _tracks,
    "altitudes": lambda dataset: _over_time(dataset, [_ALTITUDE], "altitudes", "dashed: planned"),
    "profile": _profile,
    "separation": _separation,
    "ranges": _ranges,
    "guidance": lambda dataset: _over_time(dataset, _GUIDANCE, "guidance commands and responses", "dashed: command"),
    "goal-velocity": lambda dataset: _over_time(
        dataset,
        _VELOCITIES,
        "velocities of the goals as the aircraft estimate them",
        "with marks: recovered from the line of sight; dashed: true",
    ),
    "plan": _plan,
}
"""Name of each figure, and what draws it; that of the separation only where there are two aircraft."""


def _knowledge(dataset: xr.Dataset) -> "Figure":
    """How far the goal is from where it is taken to be, with the filter's band; below, ellipses before the arrival."""
    from matplotlib.patches import Ellipse

    meeting, time = _meetings(dataset), dataset["time"].values
    count = dataset.sizes["aircraft"]
    columns = min(count, 4)
    figure = _figure(dataset, 5.6)
    grid = figure.add_gridspec(2, columns)
    above = figure.add_subplot(grid[0, :])
    for k, last in enumerate(meeting):
        until = slice(0, int(last) + 1)
        off = [(dataset[f"goal_{a}_m"] - dataset[f"goal_estimate_{a}_m"]).values[until, k] for a in _PLACE]
        sigma = [dataset[f"goal_sigma_{a}_m"].values[until, k] for a in _PLACE]
        look = _look(dataset, k)
        above.plot(time[until], np.sqrt(sum(x**2 for x in off)), label=_name(dataset, k), markevery=0.1, **look)
        above.plot(time[until], 2 * np.sqrt(sum(x**2 for x in sigma)), color=look["color"], linestyle=DASHED)
    above.set_yscale("log")
    above.set_xlabel("Time $t$ (s)")
    above.set_ylabel("Error of the goal's place (m)")
    for k in range(columns):
        axes, last = figure.add_subplot(grid[1, k]), int(meeting[k])
        for back in (20.0, 10.0, 4.0, 0.0):
            at = max(0, int(np.searchsorted(time, time[last] - back)))
            north, east = (float(dataset[f"goal_sigma_{a}_m"].values[at, k]) for a in ("north", "east"))
            both = float(dataset["goal_correlation"].values[at, k]) * north * east
            values, vectors = np.linalg.eigh(np.array([[east**2, both], [both, north**2]]))
            angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
            axes_lengths = 4.0 * np.sqrt(np.maximum(values[::-1], 0.0))
            centre = [
                float((dataset[f"goal_estimate_{a}_m"] - dataset[f"goal_{a}_m"]).values[at, k])
                for a in ("east", "north")
            ]
            ring = Ellipse(
                (centre[0], centre[1]), *axes_lengths, angle=angle, fill=False, color=_look(dataset, k)["color"]
            )
            axes.add_patch(ring)
            axes.plot(*centre, ".", color=INK, markersize=2)
        axes.plot(0.0, 0.0, "+", color=INK)
        axes.set_aspect("equal", adjustable="datalim")
        axes.autoscale_view()
        axes.set_title(_name(dataset, k), fontsize=SMALL)
        axes.set_xlabel("East of the goal (m)")
        if k == 0:
            axes.set_ylabel("North of the goal (m)")
    note = (
        "above: solid error, dashed two standard deviations; below: ellipses of two, 20, 10, 4, 0 s before the arrival"
    )
    return _finish(figure, [above], dataset, "what the aircraft know of their goals", note)


def _network(dataset: xr.Dataset) -> "Figure":
    """Which links are up, and how far the clocks are apart, beside what the theorem of time coordination promises."""
    network = network_of(dataset)
    series, pairs = network["series"], list(pair_links(dataset).items())
    figure = _figure(dataset, 5.6)
    above, middle, below = figure.subplots(3, 1, sharex=True, height_ratios=[1.2, 1.0, 1.4])
    time, until = dataset["time"].values, series["time_s"][-1]
    for row, (_, up) in enumerate(pairs):
        edges = np.flatnonzero(np.diff(up.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        spans = [(time[a], time[min(b, len(time) - 1)] - time[a]) for a, b in edges]
        above.broken_barh(spans, (row - 0.35, 0.7), color=QUIET)
    above.set_yticks(range(len(pairs)), ["–".join(pair) for pair, _ in pairs], fontsize=SMALL)
    above.set_ylabel("Link")
    middle.plot(series["time_s"], series["quality_of_service"], color=INK)
    middle.axhline(0.0, color=QUIET, linewidth=0.5)
    middle.set_ylim(-0.05, 1.05)
    middle.set_ylabel(r"Quality $\mu$")
    apart = np.maximum(np.asarray(series["coordination_error_s"]), 1e-6)
    greatest = int(np.argmax(apart))
    since = np.asarray(series["time_s"][greatest:])
    promised = apart[greatest] * np.exp(-network["promised_rate_per_s"] * (since - since[0]))
    below.semilogy(series["time_s"], apart, color=INK, label="clocks")
    below.semilogy(since, promised, color=INK, linestyle=DASHED, label="promised without further disturbance")
    below.set_xlim(0.0, until)
    below.set_ylabel(r"$|Q\gamma|$ (s)")
    below.set_xlabel("Time $t$ (s)")
    note = f"window of {network['window_s']:g} s; promised rate {network['promised_rate_per_s']:.3f} per second"
    return _finish(figure, [below], dataset, "links, quality of service, and how far the clocks are apart", note)


_PLACE = ("north", "east", "altitude")
NETWORK_FIGURES: dict[str, Callable[[xr.Dataset], "Figure"]] = {"network": _network}
"""Of flights without a centre."""
KNOWLEDGE_FIGURES: dict[str, Callable[[xr.Dataset], "Figure"]] = {"knowledge": _knowledge}
"""Of flights with sensors that have errors."""


def _figure(dataset: xr.Dataset, height: float) -> "Figure":
    """Figure of a height (inches) without its legend's further rows."""
    rows = -(-dataset.sizes["aircraft"] // _columns(dataset))
    return new_figure((_WIDTH, height + 0.16 * rows))[1]


def _columns(dataset: xr.Dataset) -> int:
    """Columns of the legend: as many as the longest name lets stand side by side."""
    longest = max(len(str(name)) for name in dataset["aircraft"].values)
    return max(1, min(6, dataset.sizes["aircraft"], int(_WIDTH / (0.62 + 0.065 * longest))))


def _look(dataset: xr.Dataset, index: int) -> dict[str, Any]:
    return marker_of(index) | {"linewidth": 1.5 if dataset.sizes["aircraft"] <= _FEW else 0.9}


def _over_time(dataset: xr.Dataset, pairs: Sequence[tuple[str, str | None]], words: str, note: str) -> "Figure":
    """Panels under one another, each with what was done and, dashed, what was asked for."""
    figure = _figure(dataset, 1.4 + 1.55 * len(pairs))
    panels = list(figure.subplots(len(pairs), 1, sharex=True, squeeze=False)[:, 0])
    for axes, (name, wanted) in zip(panels, pairs, strict=True):
        _panel(axes, dataset, name, wanted)
    panels[-1].set_xlabel("Time $t$ (s)")
    figure.align_ylabels(panels)
    return _finish(figure, panels, dataset, words, note)


def _panel(axes: "Axes", dataset: xr.Dataset, name: str, wanted: str | None) -> None:
    meeting = _meetings(dataset)
    time = dataset["time"].values
    jump = 180.0 if dataset[name].attrs["units"] == "degree" else np.inf
    drawn = []
    for k, last in enumerate(meeting):
        until = slice(0, int(last) + 1)
        x, y = with_gaps(time[until], dataset[name].values[until, k].astype(np.float64), jump)
        every = _marked_every(x.size, k, meeting.size)
        axes.plot(x, y, markevery=every, label=_name(dataset, k), **_look(dataset, k))
        drawn.append(y)
        if wanted is not None:
            x, y = with_gaps(time[until], dataset[wanted].values[until, k].astype(np.float64), jump)
            axes.plot(x, y, color=INK, linestyle=DASHED, linewidth=0.8, zorder=3)
            drawn.append(y)
    ends = [float(f(np.concatenate(drawn))) for f in (np.nanmin, np.nanmax)]
    missing = _SPAN_MIN.get(str(dataset[name].attrs["units"]), 0.0) - (ends[1] - ends[0])
    if missing > 0.0:
        axes.set_ylim(ends[0] - missing / 2, ends[1] + missing / 2)
    axes.set_ylabel(axis_label(dataset[name]))
    axes.set_xlim(float(time[0]), float(time[meeting.max()]))


def _marked_every(samples: int, index: int, count: int) -> tuple[int, int]:
    """Which samples of one line of some bear a mark: in turn, so that equal lines show all their marks."""
    step = max(samples // _MARKS, 1)
    return index * step // count, step


def with_gaps(x: np.ndarray, y: np.ndarray, jump: float) -> tuple[np.ndarray, np.ndarray]:
    """Put a gap wherever y jumps by more than `jump`, so that no line is drawn across a wrapped angle.

    Parameters
    ----------
    x, y
        Samples, shape (samples,).
    jump
        Greatest difference of neighbours that is still drawn, in the unit of y.
    """
    steps = np.abs(np.diff(y))
    at = np.flatnonzero(np.where(np.isfinite(steps), steps, 0.0) > jump) + 1
    return np.insert(x, at, x[at]), np.insert(y, at, np.nan)


def _finish(figure: "Figure", panels: Sequence["Axes"], dataset: xr.Dataset, words: str, note: str) -> "Figure":
    if dataset.sizes["aircraft"] > 1:
        columns = _columns(dataset)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=columns)
    title = plain(dataset.attrs.get("title", "flight"))
    figure.suptitle(f"{title}: {words}", fontsize=LARGE)
    if note:
        panels[0].set_title(note, fontsize=SMALL, color=QUIET)
    return figure


def _meetings(dataset: xr.Dataset) -> np.ndarray:
    """Index of the last time before each aircraft begins its hold; the last of the flight where it never does."""
    held = dataset["phase"].values >= HOLD
    return np.where(held.any(axis=0), np.maximum(held.argmax(axis=0), 1), held.shape[0]) - 1


def _name(dataset: xr.Dataset, index: int) -> str:
    return plain(dataset["aircraft"].values[index])


def _nice(least: float) -> float:
    """Smallest of 1, 2, 5, 10, 20, ... that is no smaller."""
    scale = 10.0 ** np.floor(np.log10(max(least, 1e-3)))
    return float(next(step for step in (scale, 2 * scale, 5 * scale, 10 * scale) if step >= least))
