"""Export to CZML, the JSON of Cesium: a clock, moving points with labels and trails, attitudes."""

import html
import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr

from anser.report.exports.geography import (
    Track,
    aircraft_track,
    earth_fixed_attitude,
    goal_tracks,
    iso_timestamp,
    rendezvous_track,
)
from anser.report.style import color_of

# decimals: 1e-9 deg of arc and 1e-4 m are 0.1 mm, 1e-8 of a quaternion is 0.01 seconds of arc
_DEGREES, _METRES, _QUATERNION, _SECONDS = 9, 4, 8, 6
# forward, across, up, m; enlarged to be visible from a few kilometres
_SLAB_M = (60.0, 40.0, 4.0)
_INK, _PAPER = (27, 31, 36, 255), (255, 255, 255, 255)
_RATE = 4.0  # seconds of flight in a second of playback


def to_czml(dataset: xr.Dataset, summary: Mapping[str, Any], start: datetime) -> bytes:
    """Return a flight as a CZML 1.0 file.

    An aircraft is a point with a label, a trail and a flat box that shows the attitude. A goal is a point with a label;
    a rendezvous is a point, joined to the goal by a line. The file refers to no external model or image.

    Parameters
    ----------
    dataset, summary
        A flight: the contents of `flight.nc` and `summary.json`.
    start
        Date and time of the flight's time 0.
    """
    packets = list(_packets(dataset, summary, start))
    return json.dumps(packets, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def _packets(dataset: xr.Dataset, summary: Mapping[str, Any], start: datetime) -> Iterator[dict[str, Any]]:
    start_s, end_s = (float(dataset["time"].values[k]) for k in (0, -1))
    yield {
        "id": "document",
        "name": str(summary["scenario"]["name"]),
        "version": "1.0",
        "clock": {
            "interval": _interval(start, start_s, end_s),
            "currentTime": iso_timestamp(start, start_s),
            "multiplier": _RATE,
            "range": "LOOP_STOP",
            "step": "SYSTEM_CLOCK_MULTIPLIER",
        },
    }
    goals = {track.name: f"goal-{k}" for k, track in enumerate(goal_tracks(dataset, summary))}
    for track in goal_tracks(dataset, summary):
        if track.sample_index.size:
            yield _point(track, goals[track.name], start, _INK, _PAPER) | {"label": _label(track.name, _INK)}
    for index, aircraft in enumerate(summary["aircraft"]):
        yield from _aircraft(dataset, aircraft, index, start)
        rendezvous = rendezvous_track(dataset, summary, index)
        if rendezvous.sample_index.size:
            yield _point(rendezvous, f"rendezvous-{index}", start, _PAPER, _rgba(index)) | {
                "polyline": {
                    "positions": {
                        "references": [f"{goals[str(aircraft['goal'])]}#position", f"rendezvous-{index}#position"]
                    },
                    "width": 1.0,
                    "material": _solid(_rgba(index)),
                    "arcType": "NONE",
                }
            }


def _aircraft(
    dataset: xr.Dataset, aircraft: Mapping[str, Any], index: int, start: datetime
) -> Iterator[dict[str, Any]]:
    track, color = aircraft_track(dataset, index), _rgba(index)
    if not track.sample_index.size:
        return
    quaternions = earth_fixed_attitude(dataset, index, track).round(_QUATERNION)
    yield _point(track, f"aircraft-{index}", start, color, _PAPER) | {
        "description": _description(aircraft),
        "orientation": {
            "epoch": iso_timestamp(start, 0.0),
            "unitQuaternion": _flat(track.time_s.round(_SECONDS), *quaternions.T),
            "interpolationAlgorithm": "LINEAR",
            "interpolationDegree": 1,
        },
        "label": _label(track.name, color),
        "path": {
            "material": _solid(color),
            "width": 2.0,
            "leadTime": 0.0,
            "trailTime": float(track.time_s[-1] - track.time_s[0]),
            "resolution": 1.0,
        },
        "box": {"dimensions": {"cartesian": list(_SLAB_M)}, "material": _solid(color)},
    }


def _point(track: Track, key: str, start: datetime, color: tuple[int, ...], edge: tuple[int, ...]) -> dict[str, Any]:
    return {
        "id": key,
        "name": track.name,
        "availability": _interval(start, track.time_s[0], track.time_s[-1]),
        "position": {
            "epoch": iso_timestamp(start, 0.0),
            "cartographicDegrees": _flat(
                track.time_s.round(_SECONDS),
                track.longitude_deg.round(_DEGREES),
                track.latitude_deg.round(_DEGREES),
                track.height_m.round(_METRES),
            ),
            "interpolationAlgorithm": "LAGRANGE",
            "interpolationDegree": 3,
        },
        "point": {
            "pixelSize": 9.0,
            "color": {"rgba": list(color)},
            "outlineColor": {"rgba": list(edge)},
            "outlineWidth": 2.0,
        },
    }


def _label(text: str, color: tuple[int, ...]) -> dict[str, Any]:
    return {
        "text": text,
        "font": "13px sans-serif",
        "style": "FILL_AND_OUTLINE",
        "fillColor": {"rgba": list(color)},
        "outlineColor": {"rgba": list(_PAPER)},
        "outlineWidth": 3.0,
        "horizontalOrigin": "LEFT",
        "verticalOrigin": "CENTER",
        "pixelOffset": {"cartesian2": [12.0, 0.0]},
    }


def _description(aircraft: Mapping[str, Any]) -> str:
    """Return the text of the aircraft's info box. Cesium renders it as HTML, so text from files is escaped."""
    parts = [f"goal: {aircraft['goal']}", f"status: {aircraft['status']}"]
    for key, label, unit in (
        ("planned_arrival_s", "planned arrival", "s"),
        ("arrival_s", "arrival", "s"),
        ("miss_m", "miss", "m"),
    ):
        if aircraft[key] is not None:
            parts.append(f"{label}: {aircraft[key]:.2f} {unit}")
    return "<br>".join(html.escape(part) for part in parts)


def _solid(color: tuple[int, ...]) -> dict[str, Any]:
    return {"solidColor": {"color": {"rgba": list(color)}}}


def _rgba(index: int) -> tuple[int, ...]:
    return (*bytes.fromhex(color_of(index).removeprefix("#")), 255)


def _interval(start: datetime, first_s: float, last_s: float) -> str:
    return f"{iso_timestamp(start, first_s)}/{iso_timestamp(start, last_s)}"


def _flat(*columns: np.ndarray) -> list[float]:
    return np.stack(columns, axis=-1).ravel().tolist()
