"""Which links of a fleet without a centre were up when, in SVG; beside it the network's quality of service."""

import html
import json
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr

_WIDTH, _NAMES, _RIGHT, _ROW, _BELOW = 900, 190, 10, 16, 70
_PAIRS_MOST = 45
_UP, _INK, _GRID, _LINE = "var(--link)", "var(--quiet)", "var(--grid)", "var(--quality)"


def network_of(dataset: xr.Dataset) -> dict[str, Any]:
    """What the dataset carries of its network; empty where it carries nothing that can be read."""
    try:
        found = json.loads(dataset.attrs.get("network", "{}"))
    except (TypeError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def pair_links(dataset: xr.Dataset) -> dict[tuple[str, str], np.ndarray]:
    """Of each pair of aircraft, at which records it heard each other."""
    names, heard = [str(name) for name in dataset["aircraft"].values], dataset["heard_from"].values
    return {(names[i], names[k]): (heard[:, i] >> k) & 1 == 1 for i, k in combinations(range(len(names)), 2)}


def links_strip(dataset: xr.Dataset) -> str:
    """One row for each pair of aircraft, filled while they hear each other; below, the quality of service over time.

    Empty for a fleet that is planned for by a centre.
    """
    if "heard_from" not in dataset:
        return ""
    time, pairs = dataset["time"].values, list(pair_links(dataset).items())[:_PAIRS_MOST]
    end, tall = float(time[-1]) or 1.0, _ROW * len(pairs)

    def x(value: float) -> float:
        return _NAMES + value / end * (_WIDTH - _NAMES - _RIGHT)

    parts = []
    for row, ((one, other), up) in enumerate(pairs):
        edges = np.flatnonzero(np.diff(up.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        last = len(time) - 1
        path = "".join(
            f"M{x(float(time[a])):.1f} {row * _ROW + _ROW / 2:.1f}H{x(float(time[min(b, last)])):.1f}" for a, b in edges
        )
        parts.append(
            f'<text x="0" y="{row * _ROW + 12}">{html.escape(_short(one))} – {html.escape(_short(other))}</text>'
            f'<path d="{path}" stroke="{_UP}" stroke-width="{_ROW - 5}" fill="none"/>'
        )
    parts.append(_quality(network_of(dataset), tall + 10, x))
    ticks = np.linspace(0.0, end, 7)
    parts += [f'<text x="{x(t):.1f}" y="{tall + _BELOW + 14}" text-anchor="middle">{t:.0f}</text>' for t in ticks]
    parts.append(f'<text x="{x(0.5 * end):.1f}" y="{tall + _BELOW + 30}" text-anchor="middle">time (s)</text>')
    return (
        f'<svg class="strip" viewBox="0 0 {_WIDTH} {tall + _BELOW + 36}" role="img" aria-label="Which aircraft heard '
        f'each other when, and the quality of service of the network">{"".join(parts)}</svg>'
    )


def _quality(network: Mapping[str, Any], top: float, x: Any) -> str:
    series = network.get("series")
    if not series:
        return ""
    height = _BELOW - 20

    def y(value: float) -> float:
        return top + height * (1.0 - min(value, 1.0))

    points = zip(series["time_s"], series["quality_of_service"], strict=True)
    path = "M" + "L".join(f"{x(t):.1f} {y(mu):.1f}" for t, mu in points)
    grid = "".join(
        f'<line x1="{x(0.0):.1f}" x2="{_WIDTH - _RIGHT}" y1="{y(v):.1f}" y2="{y(v):.1f}" stroke="{_GRID}"/>'
        f'<text x="{_NAMES - 6}" y="{y(v) + 4:.1f}" text-anchor="end">{v:g}</text>'
        for v in (0.0, 1.0)
    )
    return (
        f'{grid}<path d="{path}" stroke="{_LINE}" stroke-width="1.5" fill="none"/>'
        f'<text x="0" y="{top + 14:.1f}" fill="{_INK}">quality of service</text>'
    )


def _short(name: str) -> str:
    return name if len(name) <= 12 else name[:11] + "…"
