"""Map of the worst flights of a campaign over a background of other flights, as SVG."""

from typing import TYPE_CHECKING

import numpy as np

from anser.report.campaign_data import CampaignReport, ReplayedFlight
from anser.report.page_templates import render

if TYPE_CHECKING:
    from markupsafe import Markup

_TRACK_POINTS_MAX = 240
"""Greatest number of points of a track."""
_MARGIN = 0.05
_SIZE = 1000.0
_HEIGHT_RANGE = (0.45, 1.0)
"""Least and greatest height of the map, as fractions of its width."""
_AFTER_S = 2.0
"""Time after its arrival up to which an aircraft is still drawn, s."""


def campaign_map(report: CampaignReport) -> "Markup | str":
    """Draw the replayed flights, seen from above, as SVG; return an empty string without replayed flights."""
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

    lines_by_kind = {
        is_worst: [
            (replay.number, [to_map(line).tolist() for line in lines])
            for replay, lines in tracks
            if replay.worst == is_worst
        ]
        for is_worst in (False, True)
    }
    bar_length_m = _scale_bar_length(scale)
    return render(
        "campaign_map.svg",
        width=_SIZE,
        height=height,
        background=lines_by_kind[False],
        worst=lines_by_kind[True],
        bar_y=height - 18.0,
        bar_length=bar_length_m * scale,
        bar_label=f"{bar_length_m / 1000:g} km" if bar_length_m >= 1000.0 else f"{bar_length_m:g} m",
    )


def _tracks(replay: ReplayedFlight, arrivals: np.ndarray) -> list[np.ndarray]:
    """Return the track of each aircraft until shortly after its arrival, evenly thinned: east and north positions, m.

    `arrivals` are the arrival times of the aircraft, s.
    """
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


def _scale_bar_length(scale: float) -> float:
    """Return a round length for the scale bar, m: at most 0.3 of the map's width."""
    step = 10.0 ** np.floor(np.log10(0.25 * _SIZE / scale))
    return next(step * m for m in (5.0, 2.0, 1.0) if step * m * scale <= 0.3 * _SIZE)
