"""The worst flights of a campaign drawn over others, from above, in SVG."""

from collections.abc import Callable, Sequence

import numpy as np

from anser.report.campaign_data import CampaignReport, ReplayedFlight
from anser.report.style import page_color_of

_Placing = Callable[[np.ndarray], np.ndarray]
_POINTS = 240
"""Of a track at most."""
_ROOM = 0.05
_SIZE = 1000.0
_TALL = (0.45, 1.0)
"""How high the map is, at least and at most, of its width."""
_AFTER_S = 2.0
"""How long after its arrival an aircraft is drawn."""


def campaign_map(shown: CampaignReport) -> str:
    """Draw the flights flown again; empty where there are none."""
    if not shown.replays:
        return ""
    rows = shown.dataset.sel(flight=[one.number for one in shown.replays])
    arrivals = dict(zip(rows["flight"].values.tolist(), rows["arrival_s"].values, strict=True))
    tracks = [(one, _tracks(one, arrivals[one.number])) for one in shown.replays]
    points = np.concatenate([line for _, lines in tracks for line in lines])
    low, high = points.min(axis=0), points.max(axis=0)
    wide, tall = np.maximum(high - low, 1.0) * (1.0 + 2.0 * _ROOM)
    middle, scale = 0.5 * (low + high), _SIZE / max(wide, tall / _TALL[1])
    height = float(np.clip(tall * scale, _TALL[0] * _SIZE, _TALL[1] * _SIZE))

    def placed(line: np.ndarray) -> np.ndarray:
        return np.array([0.5 * _SIZE, 0.5 * height]) + (line - middle) * scale * np.array([1.0, -1.0])

    others = "".join(_paths(placed, lines, f"flight {one.number}") for one, lines in tracks if not one.worst)
    worst = [(one, lines) for one, lines in tracks if one.worst]
    drawn = "".join(
        f'<g class="worst-track" data-flight="{one.number}" stroke="{page_color_of(k)}" fill="{page_color_of(k)}">'
        f"{_paths(placed, lines, f'flight {one.number}, one of the worst')}{_ends(placed, lines)}</g>"
        for k, (one, lines) in enumerate(worst)
    )
    return (
        f'<svg class="map" viewBox="0 0 {_SIZE:.0f} {height:.0f}" role="img" '
        f'aria-label="Tracks from above: the worst flights over others"><g class="other-tracks">{others}</g>{drawn}'
        f"{_scale_bar(scale, height)}</svg>"
    )


def _tracks(flown: ReplayedFlight, arrivals: np.ndarray) -> list[np.ndarray]:
    """East and north (m) of each aircraft until it has arrived, some of the records."""
    data, found = flown.tracks, []
    time = data["time"].values
    for k, arrival in enumerate(np.broadcast_to(arrivals, data.sizes["aircraft"])):
        east, north = (data[name].values[:, k] for name in ("east_m", "north_m"))
        until = np.inf if np.isnan(arrival) else arrival + _AFTER_S
        rows = np.flatnonzero((time <= until) & np.isfinite(east) & np.isfinite(north))
        if rows.size > _POINTS:
            rows = rows[np.linspace(0, rows.size - 1, _POINTS).round().astype(int)]
        if rows.size:
            found.append(np.stack([east[rows], north[rows]], axis=1))
    return found


def _paths(placed: _Placing, lines: Sequence[np.ndarray], words: str) -> str:
    made = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in placed(line)) for line in lines)
    return f'<path d="{made}" fill="none"><title>{words}</title></path>'


def _ends(placed: _Placing, lines: Sequence[np.ndarray]) -> str:
    """A dot where each aircraft began, a square where it was at the end."""
    made = ""
    for line in lines:
        (x, y), (u, v) = placed(line[[0, -1]])
        made += f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" stroke="none"/>'
        made += f'<rect x="{u - 4.5:.1f}" y="{v - 4.5:.1f}" width="9" height="9" stroke="var(--paper)"/>'
    return made


def _scale_bar(scale: float, height: float) -> str:
    step = 10.0 ** np.floor(np.log10(0.25 * _SIZE / scale))
    length = next(step * m for m in (5.0, 2.0, 1.0) if step * m * scale <= 0.3 * _SIZE)
    words = f"{length / 1000:g} km" if length >= 1000.0 else f"{length:g} m"
    x, y = 20.0, height - 18.0
    return (
        f'<g class="scale-bar"><path d="M{x} {y - 6}V{y}H{x + length * scale:.1f}V{y - 6}" fill="none"/>'
        f'<text x="{x + 6}" y="{y - 6}">{words}</text>'
        f'<path d="M{_SIZE - 24} 44V16m-6 9l6 -9l6 9" fill="none"/>'
        f'<text x="{_SIZE - 24}" y="60" text-anchor="middle">N</text></g>'
    )
