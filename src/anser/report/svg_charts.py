"""SVG charts of report pages: arrival errors, influences of inputs, network links, and the map of a campaign."""

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import evenly_spaced, recorded_table
from anser.report.page_templates import render

if TYPE_CHECKING:
    from markupsafe import Markup

    from anser.report.campaign_data import CampaignReport, ReplayedFlight


_STRIP_WIDTH, _FOOT_HEIGHT = 560, 34
_ARRIVAL_NAMES_WIDTH, _ARRIVAL_RIGHT = 128, 16
_ARRIVAL_HEIGHT, _ROW_MAX, _ROW_MIN, _ROW_NAMED = 260.0, 24.0, 4.0, 11.0


def arrival_strip(summary: Mapping[str, Any]) -> "Markup | str":
    """Return an SVG chart of the arrival errors in a summary, in s or ms; empty for fewer than two errors."""
    errors = [
        (k, str(aircraft["name"]), float(aircraft["arrival_s"]) - float(aircraft["planned_arrival_s"]))
        for k, aircraft in enumerate(summary["aircraft"])
        if aircraft["arrival_s"] is not None and aircraft["planned_arrival_s"] is not None
    ]
    if len(errors) < 2:
        return ""
    offsets = np.array([offset for *_, offset in errors])
    factor, unit = (1000.0, "ms") if np.abs(offsets).max() < 0.0995 else (1.0, "s")
    ticks = _ticks(float(min(offsets.min(), 0.0)) * factor, float(max(offsets.max(), 0.0)) * factor)
    row_height = float(np.clip(_ARRIVAL_HEIGHT / len(errors), _ROW_MIN, _ROW_MAX))
    bottom = row_height * len(errors) + 4
    x = _scale(ticks[0], ticks[-1], _ARRIVAL_NAMES_WIDTH, _STRIP_WIDTH - _ARRIVAL_RIGHT)
    return render(
        "arrivals.svg",
        width=_STRIP_WIDTH,
        height=bottom + _FOOT_HEIGHT,
        bottom=bottom,
        ticks=_axis_ticks(ticks, x),
        zero_x=x(0.0),
        rows=[
            {
                "index": k,
                "label": _shortened(name, 18) if row_height >= _ROW_NAMED else "",
                "x": x(offset * factor),
                "y": row_height * (position + 0.5) + 2,
            }
            for position, (k, name, offset) in enumerate(errors)
        ],
        radius=min(5.0, 0.42 * row_height),
        unit=unit,
        title_x=(_ARRIVAL_NAMES_WIDTH + _STRIP_WIDTH - _ARRIVAL_RIGHT) / 2,
    )


def _scale(low: float, high: float, x_low: float, x_high: float) -> Callable[[float], float]:
    return lambda value: x_low + (value - low) / (high - low) * (x_high - x_low)


def _axis_ticks(values: Sequence[float], x: Callable[[float], float]) -> list[dict[str, Any]]:
    return [{"x": x(v), "is_zero": v == 0, "label": f"{v:.6g}".replace("-", "−")} for v in values]


def _shortened(name: str, length: int) -> str:
    return name if len(name) <= length else name[: length - 1] + "…"


def _ticks(low: float, high: float) -> list[float]:
    """Return the ticks of an axis that spans `low` to `high`: multiples of a round step."""
    high = high if high > low else low + 1.0
    reach = max(high - low, 1e-9)
    size = 10.0 ** np.floor(np.log10(reach))
    step = next(size * m for m in (0.2, 0.25, 0.5, 1.0, 2.0, 5.0) if reach / (size * m) <= 5.5)
    lowest, highest = int(np.floor(low / step + 1e-9)), int(np.ceil(high / step - 1e-9))
    return [float(k * step) for k in range(lowest, highest + 1)]


_INFLUENCE_NAMES_WIDTH, _INFLUENCE_RIGHT, _INFLUENCE_HEAD, _INFLUENCE_ROW = 200, 14, 4, 24.0
_LABEL_LENGTH_MAX = 30
_SOBOL = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
_RANK = (-1.0, -0.5, 0.0, 0.5, 1.0)
_SOBOL_TITLE = "part of the variance: first index (narrow), total index (wide)"
_RANK_BARS, _SOBOL_BARS = (("rank", 9, 0),), (("total", 15, 5), ("first", 6, 0))
"""Bars of an input, from back to front: measure, height in pixels, and index of the colour."""


def influence_strip(influences: Sequence[Mapping[str, Any]], output: str) -> "Markup | str":
    """Return an SVG chart of an output's sensitivity to each input; empty if no sensitivity is known.

    `influences` is the list `entries` of `Influences.as_dict`.
    """
    by_path: dict[str, dict[str, Mapping[str, Any]]] = {}
    for influence in influences:
        if influence["output"] == output:
            by_path.setdefault(influence["path"], {})[influence["measure"]] = influence
    if not by_path:
        return ""
    has_ranks = "rank" in next(iter(by_path.values()))
    ticks, bars = (_RANK, _RANK_BARS) if has_ranks else (_SOBOL, _SOBOL_BARS)
    ordered = sorted(by_path.items(), key=lambda item: -abs(item[1][bars[0][0]]["value"]))
    bottom = _INFLUENCE_HEAD + _INFLUENCE_ROW * len(ordered)
    unclipped_x = _scale(ticks[0], ticks[-1], _INFLUENCE_NAMES_WIDTH, _STRIP_WIDTH - _INFLUENCE_RIGHT)

    def x(value: float) -> float:
        return unclipped_x(min(max(value, ticks[0]), ticks[-1]))

    return render(
        "influences.svg",
        width=_STRIP_WIDTH,
        height=bottom + _FOOT_HEIGHT,
        bottom=bottom,
        output=output,
        title="rank correlation" if has_ranks else _SOBOL_TITLE,
        title_x=(_INFLUENCE_NAMES_WIDTH + _STRIP_WIDTH - _INFLUENCE_RIGHT) / 2,
        ticks=_axis_ticks(ticks, x),
        rows=[
            {
                "label": path if len(path) <= _LABEL_LENGTH_MAX else "…" + path[1 - _LABEL_LENGTH_MAX :],
                "description": f"{path}: {_influence_text(measures)}",
                "y": _INFLUENCE_HEAD + _INFLUENCE_ROW * (position + 0.5),
                "bars": [_influence_bar(measures[measure], x, *look) for measure, *look in bars],
            }
            for position, (path, measures) in enumerate(ordered)
        ],
    )


def _influence_text(measures: Mapping[str, Mapping[str, Any]]) -> str:
    return "; ".join(
        f"{name} {influence['value']:.3f} ({influence['low']:.3f} to {influence['high']:.3f})"
        for name, influence in measures.items()
    )


def _influence_bar(
    influence: Mapping[str, Any], x: Callable[[float], float], height: int, color_index: int
) -> dict[str, Any]:
    start, stop = sorted((x(0.0), x(influence["value"])))
    interval = {"low": x(influence["low"]), "high": x(influence["high"])}
    return {"start": start, "width": max(stop - start, 0.8), "height": height, "color_index": color_index, **interval}


_LINKS_WIDTH, _LINKS_NAMES_WIDTH, _LINKS_RIGHT, _LINKS_ROW, _QUALITY_HEIGHT = 900, 190, 10, 16, 70
_PAIRS_MAX = 45


def pair_links(dataset: xr.Dataset) -> dict[tuple[str, str], np.ndarray]:
    """Return a mask (time,) for each pair of aircraft names: True while the first aircraft hears the second."""
    names, heard = [str(name) for name in dataset["aircraft"].values], dataset["heard_from"].values
    return {(names[i], names[k]): (heard[:, i] >> k) & 1 == 1 for i, k in combinations(range(len(names)), 2)}


def link_spans(time: np.ndarray, is_linked: np.ndarray) -> list[tuple[float, float]]:
    """Return the spans of time (from, to), s, in which `is_linked`, a mask of the times, is True."""
    edges = np.flatnonzero(np.diff(is_linked.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    return [(float(time[start]), float(time[min(stop, len(time) - 1)])) for start, stop in edges]


def links_strip(dataset: xr.Dataset) -> "Markup | str":
    """Return an SVG chart of a network's links and quality of service over time; empty if the planner is central."""
    if "heard_from" not in dataset:
        return ""
    time, pairs = dataset["time"].values, list(pair_links(dataset).items())
    count, pairs = len(pairs), pairs[:_PAIRS_MAX]
    end, rows_height = float(time[-1]) or 1.0, _LINKS_ROW * len(pairs)
    x = _scale(0.0, end, _LINKS_NAMES_WIDTH, _LINKS_WIDTH - _LINKS_RIGHT)
    return render(
        "links.svg",
        width=_LINKS_WIDTH,
        bottom=rows_height + _QUALITY_HEIGHT,
        bar_height=_LINKS_ROW - 5,
        zero_x=_LINKS_NAMES_WIDTH,
        right=_LINKS_WIDTH - _LINKS_RIGHT,
        rows=[
            {
                "label": " – ".join(_shortened(name, 12) for name in names),
                "y": index * _LINKS_ROW + _LINKS_ROW // 2,
                "spans": [(x(start), x(stop)) for start, stop in link_spans(time, is_linked)],
            }
            for index, (names, is_linked) in enumerate(pairs)
        ],
        quality=_quality(recorded_table(dataset, "network").get("series"), rows_height + 10, x),
        ticks=[{"x": x(t), "label": f"{t:.0f}"} for t in np.linspace(0.0, end, 7)],
        title_x=x(0.5 * end),
        left_out=f"first {len(pairs)} of {count} pairs" if count > len(pairs) else "",
    )


def _quality(series: Mapping[str, Any] | None, top: float, x: Callable[[float], float]) -> dict[str, Any] | None:
    if not series:
        return None

    def y(value: float) -> float:
        return top + (_QUALITY_HEIGHT - 20) * (1.0 - min(value, 1.0))

    points = zip(series["time_s"], series["quality_of_service"], strict=True)
    return {
        "top": top,
        "levels": [{"value": value, "y": y(value)} for value in (0, 1)],
        "points": [(x(time_s), y(quality)) for time_s, quality in points],
    }


_TRACK_POINTS_MAX = 240
"""Greatest number of points of a track on the map."""
_MARGIN = 0.05
_SIZE = 1000.0
_HEIGHT_RANGE = (0.45, 1.0)
"""Least and greatest height of the map, as fractions of its width."""
_AFTER_S = 2.0
"""Time for which an aircraft is still drawn after the arrival, s."""


def campaign_map(report: "CampaignReport") -> "Markup | str":
    """Return an SVG map of the tracks of a campaign's replayed flights; empty if no flight was replayed."""
    if not report.replays:
        return ""
    replayed = report.dataset.sel(flight=[replay.number for replay in report.replays])
    arrivals = dict(zip(replayed["flight"].values.tolist(), replayed["arrival_s"].values, strict=True))
    tracks = [(replay, _tracks(replay, arrivals[replay.number])) for replay in report.replays]
    points = np.concatenate([line for _, lines in tracks for line in lines])
    low, high = points.min(axis=0), points.max(axis=0)
    width, extent_north = np.maximum(high - low, 1.0) * (1.0 + 2.0 * _MARGIN)
    middle, scale = 0.5 * (low + high), _SIZE / max(width, extent_north / _HEIGHT_RANGE[1])
    height = float(np.clip(extent_north * scale, _HEIGHT_RANGE[0] * _SIZE, _HEIGHT_RANGE[1] * _SIZE))

    def to_map(line: np.ndarray) -> np.ndarray:
        return np.array([0.5 * _SIZE, 0.5 * height]) + (line - middle) * scale * np.array([1.0, -1.0])

    drawn = [(replay, [to_map(line).tolist() for line in lines]) for replay, lines in tracks]
    bar_length_m = _scale_bar_length(scale)
    return render(
        "campaign_map.svg",
        width=_SIZE,
        height=height,
        background=[(replay.number, lines) for replay, lines in drawn if not replay.worst],
        worst=[(replay.number, lines) for replay, lines in drawn if replay.worst],
        bar_y=height - 18.0,
        bar_length=bar_length_m * scale,
        bar_label=f"{bar_length_m / 1000:g} km" if bar_length_m >= 1000.0 else f"{bar_length_m:g} m",
    )


def _tracks(replay: "ReplayedFlight", arrivals: np.ndarray) -> list[np.ndarray]:
    """Return east and north, m, shape (points, 2), of each aircraft's track in a replayed flight.

    A track ends `_AFTER_S` after the aircraft's time in `arrivals`, s; NaN: at the end of the record.
    """
    data, lines = replay.tracks, []
    time = data["time"].values
    for k, arrival in enumerate(np.broadcast_to(arrivals, data.sizes["aircraft"])):
        east, north = (data[name].values[:, k] for name in ("east_m", "north_m"))
        end_s = np.inf if np.isnan(arrival) else arrival + _AFTER_S
        is_drawn = (time <= end_s) & np.isfinite(east) & np.isfinite(north)
        samples = evenly_spaced(np.flatnonzero(is_drawn), _TRACK_POINTS_MAX)
        if samples.size:
            lines.append(np.stack([east[samples], north[samples]], axis=1))
    return lines


def _scale_bar_length(scale: float) -> float:
    step = 10.0 ** np.floor(np.log10(0.25 * _SIZE / scale))
    return next(step * m for m in (5.0, 2.0, 1.0) if step * m * scale <= 0.3 * _SIZE)
