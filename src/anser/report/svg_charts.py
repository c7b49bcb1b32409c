"""SVG charts of report pages.

Arrival times of the aircraft, influences on an output of a campaign, and communication links over time.
"""

import html
import json
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr

from anser.report.style import page_color_of

_ARRIVAL_WIDTH, _ARRIVAL_NAMES_WIDTH, _ARRIVAL_RIGHT, _ARRIVAL_FOOT = 560, 128, 16, 34
_INK, _GRID = "var(--quiet)", "var(--grid)"
_ARRIVAL_HEIGHT, _ROW_MAX, _ROW_MIN, _ROW_NAMED = 260.0, 24.0, 4.0, 11.0


def arrival_strip(summary: Mapping[str, Any]) -> str:
    """Chart of the arrival errors of a `summary.json`: early to the left, late to the right.

    Empty if fewer than two aircraft have an arrival and a planned arrival.
    """
    offsets_by_aircraft = [
        (k, str(aircraft["name"]), float(aircraft["arrival_s"]) - float(aircraft["planned_arrival_s"]))
        for k, aircraft in enumerate(summary["aircraft"])
        if aircraft["arrival_s"] is not None and aircraft["planned_arrival_s"] is not None
    ]
    if len(offsets_by_aircraft) < 2:
        return ""
    offsets = np.array([offset for *_, offset in offsets_by_aircraft])
    factor, unit = (1000.0, "ms") if np.abs(offsets).max() < 0.0995 else (1.0, "s")
    ticks = _ticks(float(min(offsets.min(), 0.0)) * factor, float(max(offsets.max(), 0.0)) * factor)
    row_tall = float(np.clip(_ARRIVAL_HEIGHT / len(offsets_by_aircraft), _ROW_MIN, _ROW_MAX))
    bottom = row_tall * len(offsets_by_aircraft) + 4

    def x(value: float) -> float:
        return _ARRIVAL_NAMES_WIDTH + (value - ticks[0]) / (ticks[-1] - ticks[0]) * (
            _ARRIVAL_WIDTH - _ARRIVAL_NAMES_WIDTH - _ARRIVAL_RIGHT
        )

    parts = [
        f'<line x1="{x(t):.1f}" x2="{x(t):.1f}" y1="0" y2="{bottom:.1f}" stroke="{_INK if t == 0 else _GRID}"/>'
        f'<text x="{x(t):.1f}" y="{bottom + 14:.1f}" text-anchor="middle">{f"{t:.6g}".replace("-", "−")}</text>'
        for t in ticks
    ]
    for position, (k, name, offset) in enumerate(offsets_by_aircraft):
        y = row_tall * (position + 0.5) + 2
        if row_tall >= _ROW_NAMED:
            label = name if len(name) <= 18 else name[:17] + "…"
            parts.append(f'<text x="0" y="{y + 4:.1f}" class="who-name">{html.escape(label)}</text>')
        radius = min(5.0, 0.42 * row_tall)
        parts.append(
            f'<line x1="{x(0.0):.1f}" x2="{x(offset * factor):.1f}" y1="{y:.1f}" y2="{y:.1f}" '
            f'stroke="{page_color_of(k)}" stroke-width="1.5"/>'
            f'<circle cx="{x(offset * factor):.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{page_color_of(k)}"/>'
        )
    parts.append(
        f'<text x="{(_ARRIVAL_NAMES_WIDTH + _ARRIVAL_WIDTH - _ARRIVAL_RIGHT) / 2:.0f}" '
        f'y="{bottom + 30:.1f}" text-anchor="middle">'
        f"arrival less planned arrival ({unit})</text>"
    )
    return (
        f'<svg class="strip" viewBox="0 0 {_ARRIVAL_WIDTH} {bottom + _ARRIVAL_FOOT:.0f}" role="img" '
        f'aria-label="Arrival less planned arrival of each aircraft">{"".join(parts)}</svg>'
    )


def _ticks(low: float, high: float) -> list[float]:
    """Three to eight round numbers that span `low` to `high` and include 0."""
    reach = max(high - low, 1e-9)
    size = 10.0 ** np.floor(np.log10(reach))
    step = next(size * m for m in (0.2, 0.25, 0.5, 1.0, 2.0, 5.0) if reach / (size * m) <= 5.5)
    lowest, highest = int(np.floor(low / step + 1e-9)), int(np.ceil(high / step - 1e-9))
    return [float(k * step) for k in range(lowest, highest + 1)]


_INFLUENCE_WIDTH, _INFLUENCE_NAMES_WIDTH, _INFLUENCE_RIGHT, _INFLUENCE_HEAD, _INFLUENCE_FOOT, _INFLUENCE_ROW = (
    560,
    200,
    14,
    4,
    34,
    24.0,
)
_INFLUENCE_INK, _INFLUENCE_GRID = "var(--quiet)", "var(--grid)"
_LABEL_LENGTH_MAX = 30
_SOBOL = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
_RANK = (-1.0, -0.5, 0.0, 0.5, 1.0)
_TITLES = {"first": "part of the variance: first index (narrow), total index (wide)", "rank": "rank correlation"}


def influence_strip(influences: Sequence[Mapping[str, Any]], output: str) -> str:
    """Chart of the influences on one output, the greatest first; empty without influences.

    Parameters
    ----------
    influences
        `entries` of `Influences.as_dict`.
    output
        Name of the output.
    """
    by_path: dict[str, dict[str, Mapping[str, Any]]] = {}
    for influence in influences:
        if influence["output"] == output:
            by_path.setdefault(influence["path"], {})[influence["measure"]] = influence
    if not by_path:
        return ""
    ranks = "rank" in next(iter(by_path.values()))
    ticks, measure = (_RANK, "rank") if ranks else (_SOBOL, "total")
    ordered = sorted(by_path.items(), key=lambda item: -abs(item[1][measure]["value"]))
    bottom = _INFLUENCE_HEAD + _INFLUENCE_ROW * len(ordered)

    def x(value: float) -> float:
        within = min(max(value, ticks[0]), ticks[-1])
        return _INFLUENCE_NAMES_WIDTH + (within - ticks[0]) / (ticks[-1] - ticks[0]) * (
            _INFLUENCE_WIDTH - _INFLUENCE_NAMES_WIDTH - _INFLUENCE_RIGHT
        )

    parts = [
        f'<line x1="{x(t):.1f}" x2="{x(t):.1f}" y1="0" y2="{bottom:.1f}" '
        f'stroke="{_INFLUENCE_INK if t == 0 else _INFLUENCE_GRID}"/>'
        f'<text x="{x(t):.1f}" y="{bottom + 14:.1f}" text-anchor="middle">{f"{t:g}".replace("-", "−")}</text>'
        for t in ticks
    ]
    for position, (path, measures) in enumerate(ordered):
        y = _INFLUENCE_HEAD + _INFLUENCE_ROW * (position + 0.5)
        label = path if len(path) <= _LABEL_LENGTH_MAX else "…" + path[1 - _LABEL_LENGTH_MAX :]
        text = "; ".join(
            f"{name} {influence['value']:.3f} ({influence['low']:.3f} to {influence['high']:.3f})"
            for name, influence in measures.items()
        )
        title = f"<title>{html.escape(f'{path}: {text}')}</title>"
        bars = (
            _influence_bar(x, measures["rank"], y, 9.0, page_color_of(0))
            if ranks
            else _influence_bar(x, measures["total"], y, 15.0, page_color_of(5))
            + _influence_bar(x, measures["first"], y, 6.0, page_color_of(0))
        )
        name = f'<text x="0" y="{y + 4:.1f}" class="who-name">{html.escape(label)}</text>'
        parts.append(f"<g>{title}{name}{bars}</g>")
    text = _TITLES["rank" if ranks else "first"]
    middle = (_INFLUENCE_NAMES_WIDTH + _INFLUENCE_WIDTH - _INFLUENCE_RIGHT) / 2
    parts.append(f'<text x="{middle:.0f}" y="{bottom + 30:.1f}" text-anchor="middle">{text}</text>')
    return (
        f'<svg class="strip" viewBox="0 0 {_INFLUENCE_WIDTH} {bottom + _INFLUENCE_FOOT:.0f}" role="img" '
        f'aria-label="{html.escape(output)}: {text}">{"".join(parts)}</svg>'
    )


def _influence_bar(x: Any, influence: Mapping[str, Any], y: float, height: float, color: str) -> str:
    """Bar from 0, with a line across its end for the confidence interval."""
    start, stop = sorted((x(0.0), x(influence["value"])))
    return (
        f'<rect x="{start:.1f}" y="{y - 0.5 * height:.1f}" width="{max(stop - start, 0.8):.1f}" height="{height:g}" '
        f'fill="{color}"/><path d="M{x(influence["low"]):.1f} {y:.1f}H{x(influence["high"]):.1f}" stroke="var(--ink)" '
        f'stroke-width="1.2" fill="none"/>'
    )


_LINKS_WIDTH, _LINKS_NAMES_WIDTH, _LINKS_RIGHT, _LINKS_ROW, _QUALITY_HEIGHT = 900, 190, 10, 16, 70
_PAIRS_MAX = 45
_LINK_COLOR, _LINKS_INK, _LINKS_GRID, _QUALITY_COLOR = "var(--link)", "var(--quiet)", "var(--grid)", "var(--quality)"


def recorded_network(dataset: xr.Dataset) -> dict[str, Any]:
    """Network data carried by the dataset; empty if missing or unreadable."""
    try:
        network = json.loads(dataset.attrs.get("network", "{}"))
    except (TypeError, ValueError):
        return {}
    return network if isinstance(network, dict) else {}


def pair_links(dataset: xr.Dataset) -> dict[tuple[str, str], np.ndarray]:
    """For each pair of aircraft, whether the second was heard by the first at each recorded time."""
    names, heard = [str(name) for name in dataset["aircraft"].values], dataset["heard_from"].values
    return {(names[i], names[k]): (heard[:, i] >> k) & 1 == 1 for i, k in combinations(range(len(names)), 2)}


def links_strip(dataset: xr.Dataset) -> str:
    """Chart of the links between each pair of aircraft, with the quality of service over time below.

    Empty for a fleet with a central planner.
    """
    if "heard_from" not in dataset:
        return ""
    time, pairs = dataset["time"].values, list(pair_links(dataset).items())[:_PAIRS_MAX]
    end, rows_height = float(time[-1]) or 1.0, _LINKS_ROW * len(pairs)

    def x(value: float) -> float:
        return _LINKS_NAMES_WIDTH + value / end * (_LINKS_WIDTH - _LINKS_NAMES_WIDTH - _LINKS_RIGHT)

    parts = []
    for index, ((first_name, second_name), is_linked) in enumerate(pairs):
        edges = np.flatnonzero(np.diff(is_linked.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        last_sample = len(time) - 1
        path = "".join(
            f"M{x(float(time[a])):.1f} {index * _LINKS_ROW + _LINKS_ROW / 2:.1f}"
            f"H{x(float(time[min(b, last_sample)])):.1f}"
            for a, b in edges
        )
        parts.append(
            f'<text x="0" y="{index * _LINKS_ROW + 12}">{html.escape(_short_name(first_name))} – '
            f"{html.escape(_short_name(second_name))}</text>"
            f'<path d="{path}" stroke="{_LINK_COLOR}" stroke-width="{_LINKS_ROW - 5}" fill="none"/>'
        )
    parts.append(_quality(recorded_network(dataset), rows_height + 10, x))
    ticks = np.linspace(0.0, end, 7)
    parts += [
        f'<text x="{x(t):.1f}" y="{rows_height + _QUALITY_HEIGHT + 14}" text-anchor="middle">{t:.0f}</text>'
        for t in ticks
    ]
    parts.append(
        f'<text x="{x(0.5 * end):.1f}" y="{rows_height + _QUALITY_HEIGHT + 30}" text-anchor="middle">time (s)</text>'
    )
    return (
        f'<svg class="strip" viewBox="0 0 {_LINKS_WIDTH} {rows_height + _QUALITY_HEIGHT + 36}" role="img" '
        'aria-label="Which aircraft heard '
        f'each other when, and the quality of service of the network">{"".join(parts)}</svg>'
    )


def _quality(network: Mapping[str, Any], top: float, x: Any) -> str:
    series = network.get("series")
    if not series:
        return ""
    height = _QUALITY_HEIGHT - 20

    def y(value: float) -> float:
        return top + height * (1.0 - min(value, 1.0))

    points = zip(series["time_s"], series["quality_of_service"], strict=True)
    path = "M" + "L".join(f"{x(t):.1f} {y(mu):.1f}" for t, mu in points)
    grid = "".join(
        f'<line x1="{x(0.0):.1f}" x2="{_LINKS_WIDTH - _LINKS_RIGHT}" y1="{y(v):.1f}" y2="{y(v):.1f}" '
        f'stroke="{_LINKS_GRID}"/>'
        f'<text x="{_LINKS_NAMES_WIDTH - 6}" y="{y(v) + 4:.1f}" text-anchor="end">{v:g}</text>'
        for v in (0.0, 1.0)
    )
    return (
        f'{grid}<path d="{path}" stroke="{_QUALITY_COLOR}" stroke-width="1.5" fill="none"/>'
        f'<text x="0" y="{top + 14:.1f}" fill="{_LINKS_INK}">quality of service</text>'
    )


def _short_name(name: str) -> str:
    return name if len(name) <= 12 else name[:11] + "…"
