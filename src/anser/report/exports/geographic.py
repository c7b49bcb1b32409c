"""Export of a flight to KML (Google Earth) and CZML (Cesium)."""

import html
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from anser.report.labels import printed_unit
from anser.report.style import color_of
from anser.results.flight_rows import goals_over_time
from anser.spatial.wgs84 import recorded_geodetic_from_flat

_POSITION_VARIABLES = tuple(
    f"{prefix}{axis}_m" for prefix in ("goal_", "rendezvous_") for axis in ("north", "east", "altitude")
)
_QUATERNION = tuple(f"quaternion_{k}" for k in range(4))
NEEDED_VARIABLES = (
    *("latitude_deg", "longitude_deg", "altitude_m", "roll_deg", "pitch_deg", "yaw_deg", "airspeed_m_s"),
    *_QUATERNION,
    *_POSITION_VARIABLES,
)
"""Variables that the dataset of a flight must contain for the exports to KML and CZML."""

# forward, left, up from forward, right, down: half a turn about the first axis
_FRD_FROM_FLU = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Track:
    """Track of a moving point at the recorded times with a finite position; arrays of shape (samples,)."""

    name: str
    sample_index: np.ndarray  # indices of the times in the record
    time_s: np.ndarray
    longitude_deg: np.ndarray
    latitude_deg: np.ndarray
    height_m: np.ndarray  # above the WGS-84 ellipsoid


def aircraft_track(dataset: xr.Dataset, index: int) -> Track:
    """Return the track of aircraft number `index`, at the times at which position and attitude are finite."""
    columns = [dataset[name].values[:, index] for name in ("longitude_deg", "latitude_deg", "altitude_m")]
    attitude = np.stack([dataset[name].values[:, index] for name in _QUATERNION])
    name = str(dataset["aircraft"].values[index])
    return _track(dataset, name, columns, np.isfinite(attitude.sum(axis=0)))


def goal_tracks(dataset: xr.Dataset, summary: Mapping[str, Any]) -> list[Track]:
    """Return a track for each goal, at the times at which an aircraft flies to the goal."""
    spans = [_goal_spans(dataset, summary, index) for index in range(len(summary["aircraft"]))]
    names = dict.fromkeys(goal for of_aircraft in spans for goal, _ in of_aircraft)
    time_s = dataset["time"].values
    tracks = []
    for name in names:
        owner = np.full(time_s.size, -1)
        for index, of_aircraft in reversed(list(enumerate(spans))):
            for goal, flies_to_it in of_aircraft:
                owner[flies_to_it & (goal == name)] = index
        tracks.append(_track_on_local_map(dataset, name, "goal_", owner, owner >= 0))
    return tracks


def rendezvous_tracks(dataset: xr.Dataset, summary: Mapping[str, Any], index: int) -> list[tuple[str, Track]]:
    """Return (goal's name, track of the rendezvous point) for each goal of aircraft number `index`.

    A track ends at the first sample at or after the arrival; if this time is missing, the planned arrival counts; if
    both are missing, the track ends with the record.
    """
    aircraft, time_s = summary["aircraft"][index], dataset["time"].values
    end_times = (aircraft[key] for key in ("arrival_s", "planned_arrival_s") if aircraft[key] is not None)
    is_before_end = np.arange(time_s.size) <= np.searchsorted(time_s, next(end_times, np.inf))
    name = f"{aircraft['name']}: rendezvous"
    return [
        (goal, _track_on_local_map(dataset, name, "rendezvous_", index, flies_to_it & is_before_end))
        for goal, flies_to_it in _goal_spans(dataset, summary, index)
    ]


def _goal_spans(dataset: xr.Dataset, summary: Mapping[str, Any], index: int) -> list[tuple[str, np.ndarray]]:
    """Return the goals of an aircraft in order of time as (name, mask of the times with this goal, shape (time,))."""
    time_s = dataset["time"].values
    goals = goals_over_time(summary, json.loads(dataset.attrs.get("scenario", "{}")))[index]
    ends_s = [from_s for _, from_s in goals[1:]] + [np.inf]
    return [(goal, (time_s >= from_s) & (time_s < end_s)) for (goal, from_s), end_s in zip(goals, ends_s, strict=True)]


def earth_fixed_attitude(dataset: xr.Dataset, index: int, track: Track) -> np.ndarray:
    """Compute the attitude of an aircraft relative to the Earth-fixed axes (ECEF), at the times of its track.

    Returns unit quaternions, scalar last, shape (samples, 4), of the rotation from the body axes forward, left, up to
    ECEF. Consecutive quaternions can be interpolated.
    """
    scalar, *vector = (dataset[name].values[track.sample_index, index] for name in _QUATERNION)
    # theory section 1: this quaternion's rotation matrix takes NED vectors to body axes; in scipy's convention the
    # rotation takes body vectors to NED
    ned_from_body = Rotation.from_quat(np.stack([*vector, scalar], axis=-1))
    angles = np.stack([track.longitude_deg, -90.0 - track.latitude_deg], axis=-1)
    fixed_from_ned = Rotation.from_euler("ZY", angles, degrees=True)
    quaternions = (fixed_from_ned * ned_from_body * _FRD_FROM_FLU).as_quat()
    is_flipped = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0.0
    return quaternions * np.cumprod(np.concatenate([[1.0], np.where(is_flipped, -1.0, 1.0)]))[:, None]


def iso_timestamp(start: datetime, time_s: float) -> str:
    """Format a time of the flight, s after `start`, as ISO 8601 in UTC with microseconds."""
    return (start.astimezone(UTC) + timedelta(seconds=float(time_s))).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _track_on_local_map(
    dataset: xr.Dataset, name: str, prefix: str, index: int | np.ndarray, is_selected: np.ndarray
) -> Track:
    """Return a track with the name `name` of a goal or a rendezvous point, at the times of the mask `is_selected`.

    `prefix` is "goal_" or "rendezvous_". `index` is the index of the aircraft that has this goal or rendezvous, or an
    array with the index at each time.
    """
    samples = np.arange(dataset.sizes["time"])
    north, east, altitude = (
        dataset[f"{prefix}{axis}_m"].values[samples, index] for axis in ("north", "east", "altitude")
    )
    longitude, latitude = _geodetic_deg(dataset, north, east)
    return _track(dataset, name, [longitude, latitude, altitude], is_selected)


def _track(dataset: xr.Dataset, name: str, columns: list[np.ndarray], is_selected: np.ndarray) -> Track:
    samples = np.flatnonzero(is_selected & np.isfinite(columns).all(axis=0))
    longitude, latitude, height = (column[samples].astype(np.float64) for column in columns)
    return Track(name, samples, dataset["time"].values[samples], longitude, latitude, height)


def _geodetic_deg(dataset: xr.Dataset, north: np.ndarray, east: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return longitude and latitude, deg, of positions on the flight's local map (north and east, m)."""
    reference = [np.radians(float(dataset.attrs[f"reference_{name}_deg"])) for name in ("latitude", "longitude")]
    latitude, longitude, _ = recorded_geodetic_from_flat(np.stack([north, east, np.zeros_like(north)]), *reference, 0.0)
    return 180.0 - np.mod(180.0 - np.degrees(longitude), 360.0), np.degrees(latitude)


_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
_TRACK_VARIABLES = ("airspeed_m_s", "roll_deg", "pitch_deg", "yaw_deg")
"""Variables attached to each aircraft track, which Google Earth plots with the elevation profile."""
_SCHEMA = "state"
_NOT_IN_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")
"""Characters that XML 1.0 cannot contain, not even escaped."""


def to_kml(dataset: xr.Dataset, summary: Mapping[str, Any], start: datetime) -> bytes:
    """Return the content of a KML 2.2 file of a flight: tracks of aircraft, rendezvous points and goals.

    `start` is the date and time at time 0 of the flight. Heights have the altitude mode "absolute". `gx:angles` are
    heading, -pitch and -roll, deg, with the signs of KML. The file refers to no external model or image.
    """
    root = ET.Element("kml", {"xmlns": _KML, "xmlns:gx": _GX})
    document = _child(root, "Document")
    _child(document, "name", str(summary["scenario"]["name"]))
    # Google Earth renders the description as HTML after the XML escaping is decoded: it needs HTML escaping too
    _child(document, "description", html.escape(str(dataset.attrs.get("description", ""))))
    fleet = summary["aircraft"]
    for index in range(len(fleet)):
        _style(document, f"aircraft-{index}", color_of(index), 1.0, 3.0)
        _style(document, f"rendezvous-{index}", color_of(index), 0.6, 1.0)
    _style(document, "goal", "#1b1f24", 0.8, 1.0)
    schema = _child(document, "Schema", id=_SCHEMA)
    for name in _TRACK_VARIABLES:
        field = _child(schema, "gx:SimpleArrayField", name=name, type="float")
        unit = printed_unit(str(dataset[name].attrs["units"]))
        _child(field, "displayName", f"{dataset[name].attrs['long_name']} ({unit})")

    folder = _folder(document, "Aircraft")
    for index, aircraft in enumerate(fleet):
        track = aircraft_track(dataset, index)
        description = f"goal {aircraft['goal']}; {aircraft['status']}"
        placemark = _placemark(folder, track, f"aircraft-{index}", start, description)
        if placemark is not None:
            samples = dataset.isel(time=track.sample_index, aircraft=index)
            yaw, pitch, roll = (samples[f"{angle}_deg"].values for angle in ("yaw", "pitch", "roll"))
            for heading, tilt, turn in zip(np.mod(yaw, 360.0), -pitch, -roll, strict=True):
                _child(placemark, "gx:angles", f"{heading:.5f} {tilt:.5f} {turn:.5f}")
            _arrays(placemark, dataset, index, track)
    folder = _folder(document, "Rendezvous")
    for index in range(len(fleet)):
        for _, track in rendezvous_tracks(dataset, summary, index):
            _placemark(folder, track, f"rendezvous-{index}", start)
    folder = _folder(document, "Goals")
    for track in goal_tracks(dataset, summary):
        _placemark(folder, track, "goal", start)
    ET.indent(root, " ")
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def _placemark(
    parent: ET.Element, track: Track, style: str, start: datetime, description: str = ""
) -> ET.Element | None:
    """Add a placemark with a track to `parent`; return the element of the track, None for an empty track.

    `style` is the name of a style in the file; `start` is the date and time at time 0.
    """
    if not track.sample_index.size:
        return None
    mark = _child(parent, "Placemark")
    _child(mark, "name", track.name)
    if description:
        _child(mark, "description", html.escape(description))
    _child(mark, "styleUrl", f"#{style}")
    element = _child(mark, "gx:Track")
    _child(element, "altitudeMode", "absolute")
    for time in track.time_s:
        _child(element, "when", iso_timestamp(start, time))
    for longitude, latitude, height in zip(track.longitude_deg, track.latitude_deg, track.height_m, strict=True):
        _child(element, "gx:coord", f"{longitude:.9f} {latitude:.9f} {height:.4f}")
    return element


def _arrays(element: ET.Element, dataset: xr.Dataset, index: int, track: Track) -> None:
    data = _child(_child(element, "ExtendedData"), "SchemaData", schemaUrl=f"#{_SCHEMA}")
    for name in _TRACK_VARIABLES:
        array = _child(data, "gx:SimpleArrayData", name=name)
        for value in dataset[name].values[track.sample_index, index]:
            _child(array, "gx:value", f"{value:.5f}")


def _style(parent: ET.Element, style_id: str, color: str, scale: float, width: float) -> None:
    red, green, blue = (color[k : k + 2] for k in (1, 3, 5))
    kml_color = f"ff{blue}{green}{red}".lower()  # alpha, blue, green, red
    style = _child(parent, "Style", id=style_id)
    for element, field, size in (("Icon", "scale", scale), ("Label", "scale", 0.8), ("Line", "width", width)):
        part = _child(style, f"{element}Style")
        _child(part, "color", kml_color)
        _child(part, field, f"{size:g}")


def _folder(parent: ET.Element, name: str) -> ET.Element:
    folder = _child(parent, "Folder")
    _child(folder, "name", name)
    return folder


def _child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    child = ET.SubElement(parent, tag, attributes)
    child.text = text if text is None else _NOT_IN_XML.sub("\N{REPLACEMENT CHARACTER}", text)
    return child


# decimals: 1e-9 deg of arc and 1e-4 m are 0.1 mm, 1e-8 of a quaternion is 0.01 seconds of arc
_DEGREE_DECIMALS, _METRE_DECIMALS, _QUATERNION_DECIMALS, _SECOND_DECIMALS = 9, 4, 8, 6
# forward, across, up, m; enlarged to be visible from a few kilometres
_SLAB_M = (60.0, 40.0, 4.0)
_INK, _PAPER = (27, 31, 36, 255), (255, 255, 255, 255)
_RATE = 4.0  # seconds of flight in a second of playback


def to_czml(dataset: xr.Dataset, summary: Mapping[str, Any], start: datetime) -> bytes:
    """Return the content of a CZML 1.0 file of a flight: aircraft with attitude and trail, goals, rendezvous points.

    `start` is the date and time at time 0 of the flight. The file refers to no external model or image.
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
        for place, (goal, rendezvous) in enumerate(rendezvous_tracks(dataset, summary, index)):
            key = f"rendezvous-{index}" + (f"-{place}" if place else "")
            if rendezvous.sample_index.size:
                yield _point(rendezvous, key, start, _PAPER, _rgba(index)) | {
                    "polyline": {
                        "positions": {"references": [f"{goals[goal]}#position", f"{key}#position"]},
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
    quaternions = earth_fixed_attitude(dataset, index, track).round(_QUATERNION_DECIMALS)
    yield _point(track, f"aircraft-{index}", start, color, _PAPER) | {
        "description": _description(aircraft),
        "orientation": {
            "epoch": iso_timestamp(start, 0.0),
            "unitQuaternion": _flat(track.time_s.round(_SECOND_DECIMALS), *quaternions.T),
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
                track.time_s.round(_SECOND_DECIMALS),
                track.longitude_deg.round(_DEGREE_DECIMALS),
                track.latitude_deg.round(_DEGREE_DECIMALS),
                track.height_m.round(_METRE_DECIMALS),
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
    """Return the HTML text of an aircraft's info box in Cesium, from its entry in the summary; texts are escaped."""
    parts = [f"goal: {aircraft['goal']}", f"status: {aircraft['status']}"]
    for name, unit in (("planned_arrival", "s"), ("arrival", "s"), ("miss", "m")):
        value = aircraft[f"{name}_{unit}"]
        if value is not None:
            parts.append(f"{name.replace('_', ' ')}: {value:.2f} {unit}")
    return "<br>".join(html.escape(part) for part in parts)


def _solid(color: tuple[int, ...]) -> dict[str, Any]:
    return {"solidColor": {"color": {"rgba": list(color)}}}


def _rgba(index: int) -> tuple[int, ...]:
    return (*bytes.fromhex(color_of(index).removeprefix("#")), 255)


def _interval(start: datetime, first_s: float, last_s: float) -> str:
    return f"{iso_timestamp(start, first_s)}/{iso_timestamp(start, last_s)}"


def _flat(*columns: np.ndarray) -> list[float]:
    return np.stack(columns, axis=-1).ravel().tolist()
