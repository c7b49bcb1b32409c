"""Map of the worst flights of a campaign over a background of other flights, as SVG."""

from collections.abc import Callable, Sequence

import numpy as np

from anser.report.campaign_data import CampaignReport, ReplayedFlight
from anser.report.style import page_color_of

_MapProjection = Callable[[np.ndarray], np.ndarray]
_TRACK_POINTS_MAX = 240
"""Greatest number of points of a track."""
_MARGIN = 0.05
_SIZE = 1000.0
_HEIGHT_RANGE = (0.45, 1.0)
"""Least and greatest height of the map, relative to its width."""
_AFTER_S = 2.0
"""Time after its arrival during which an aircraft is still drawn, s."""


def campaign_map(report: CampaignReport) -> str:
    """Draw the replayed flights from above, as SVG; empty without replayed flights."""
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

    background = "".join(
        _track_path(to_map, lines, f"flight {replay.number}") for replay, lines in tracks if not replay.worst
    )
    worst = [(replay, lines) for replay, lines in tracks if replay.worst]
    foreground = "".join(
        f'<g class="worst-track" data-flight="{replay.number}" stroke="{page_color_of(k)}" fill="{page_color_of(k)}">'
        f"{_track_path(to_map, lines, f'flight {replay.number}, one of the worst')}"
        f"{_start_and_end_marks(to_map, lines)}</g>"
        for k, (replay, lines) in enumerate(worst)
    )
    return (
        f'<svg class="map" viewBox="0 0 {_SIZE:.0f} {height:.0f}" role="img" '
        f'aria-label="Tracks from above: the worst flights over others"><g class="other-tracks">{background}</g>'
        f"{foreground}{_scale_bar(scale, height)}</svg>"
    )


def _tracks(replay: ReplayedFlight, arrivals: np.ndarray) -> list[np.ndarray]:
    """East and north positions (m) of each aircraft until shortly after its arrival, thinned evenly."""
    data, lines = replay.tracks, []
    time = data["time"].values
    for k, arrival in enumerate(np.broadcast_to(arrivals, data.sizes["aircraft"])):
        east, north = (data[name].values[:, k] for name in ("east_m", "north_m"))
        end_s = np.inf if np.isnan(arrival) else arrival + _AFTER_S
        samples = np.flatnonzero((time <= end_s) & np.isfinite(east) & np.isfinite(north))
        if samples.size > _TRACK_POINTS_MAX:
            samples = samples[np.linspace(0, samples.size - 1, _TRACK_POINTS_MAX).round().astype(int)]
        if samples.size:
            lines.append(np.stack([east[samples], north[samples]], axis=1))
    return lines


def _track_path(to_map: _MapProjection, lines: Sequence[np.ndarray], title: str) -> str:
    path_data = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in to_map(line)) for line in lines)
    return f'<path d="{path_data}" fill="none"><title>{title}</title></path>'


def _start_and_end_marks(to_map: _MapProjection, lines: Sequence[np.ndarray]) -> str:
    """A dot at the start of each track, a square at its end."""
    marks = ""
    for line in lines:
        (x, y), (u, v) = to_map(line[[0, -1]])
        marks += f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" stroke="none"/>'
        marks += f'<rect x="{u - 4.5:.1f}" y="{v - 4.5:.1f}" width="9" height="9" stroke="var(--paper)"/>'
    return marks


def _scale_bar(scale: float, height: float) -> str:
    step = 10.0 ** np.floor(np.log10(0.25 * _SIZE / scale))
    length = next(step * m for m in (5.0, 2.0, 1.0) if step * m * scale <= 0.3 * _SIZE)
    length_label = f"{length / 1000:g} km" if length >= 1000.0 else f"{length:g} m"
    x, y = 20.0, height - 18.0
    return (
        f'<g class="scale-bar"><path d="M{x} {y - 6}V{y}H{x + length * scale:.1f}V{y - 6}" fill="none"/>'
        f'<text x="{x + 6}" y="{y - 6}">{length_label}</text>'
        f'<path d="M{_SIZE - 24} 44V16m-6 9l6 -9l6 9" fill="none"/>'
        f'<text x="{_SIZE - 24}" y="60" text-anchor="middle">N</text></g>'
    )
