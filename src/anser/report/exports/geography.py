"""Where aircraft, goals and rendezvous are on the Earth, and how the aircraft stand on it."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from anser.spatial.wgs84 import recorded_geodetic_from_flat

_PLACES = tuple(f"{place}{axis}_m" for place in ("goal_", "rendezvous_") for axis in ("north", "east", "altitude"))
_QUATERNION = tuple(f"quaternion_{k}" for k in range(4))
NEEDED_VARIABLES = (
    *("latitude_deg", "longitude_deg", "altitude_m", "roll_deg", "pitch_deg", "yaw_deg", "airspeed_m_s"),
    *_QUATERNION,
    *_PLACES,
)
"""Variables of a flight that the geographic exports read."""

# Forward, left, up from forward, right, down: half a turn about the first axis.
_FRD_FROM_FLU = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Track:
    """One moving point.

    Attributes
    ----------
    name
        What it is, in words of the scenario.
    kept
        Indices of the recorded times at which it is finite, shape (kept,).
    time_s, longitude_deg, latitude_deg, height_m
        Where it is then, above the WGS-84 ellipsoid; shape (kept,) each.
    """

    name: str
    sample_index: np.ndarray
    time_s: np.ndarray
    longitude_deg: np.ndarray
    latitude_deg: np.ndarray
    height_m: np.ndarray


def aircraft_track(dataset: xr.Dataset, index: int) -> Track:
    """Track of an aircraft, while its place and attitude are finite."""
    columns = [dataset[name].values[:, index] for name in ("longitude_deg", "latitude_deg", "altitude_m")]
    attitude = np.stack([dataset[name].values[:, index] for name in _QUATERNION])
    name = str(dataset["aircraft"].values[index])
    return _track(dataset, name, columns, np.isfinite(attitude.sum(axis=0)))


def goal_tracks(dataset: xr.Dataset, summary: Mapping[str, Any]) -> list[Track]:
    """Track of each goal, once, however many aircraft fly to it."""
    first: dict[str, int] = {}
    for index, row in enumerate(summary["aircraft"]):
        first.setdefault(str(row["goal"]), index)
    return [_charted_track(dataset, name, "goal_", index, np.inf) for name, index in first.items()]


def rendezvous_track(dataset: xr.Dataset, summary: Mapping[str, Any], index: int) -> Track:
    """Track of the point that an aircraft is to meet, up to its arrival."""
    row = summary["aircraft"][index]
    known = (row[key] for key in ("arrival_s", "planned_arrival_s") if row[key] is not None)
    return _charted_track(dataset, f"{row['name']}: rendezvous", "rendezvous_", index, next(known, np.inf))


def earth_fixed_attitude(dataset: xr.Dataset, index: int, track: Track) -> np.ndarray:
    """Attitude of an aircraft in the Earth-fixed frame (ECEF).

    Returns
    -------
    Unit quaternions (kept, 4), scalar last, that turn vectors from body axes forward, left, up (those of a model in
    Cesium) into ECEF; neighbours on the same half of the sphere, so that they can be interpolated.
    """
    scalar, *vector = (dataset[name].values[track.sample_index, index] for name in _QUATERNION)
    # theory section 1: this quaternion's rotation matrix takes NED vectors to body axes, so that the rotation it stands
    # for, as scipy counts, takes body vectors to NED.
    ned_from_body = Rotation.from_quat(np.stack([*vector, scalar], axis=-1))
    angles = np.stack([track.longitude_deg, -90.0 - track.latitude_deg], axis=-1)
    fixed_from_ned = Rotation.from_euler("ZY", angles, degrees=True)
    found = (fixed_from_ned * ned_from_body * _FRD_FROM_FLU).as_quat()
    turned = np.sum(found[1:] * found[:-1], axis=-1) < 0.0
    return found * np.cumprod(np.concatenate([[1.0], np.where(turned, -1.0, 1.0)]))[:, None]


def iso_timestamp(start: datetime, time_s: float) -> str:
    """Print a time of the flight, s from `start`, as ISO 8601 in UTC to the microsecond."""
    return (start.astimezone(UTC) + timedelta(seconds=float(time_s))).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _charted_track(dataset: xr.Dataset, name: str, place: str, index: int, until_s: float) -> Track:
    north, east, altitude = (dataset[f"{place}{axis}_m"].values[:, index] for axis in ("north", "east", "altitude"))
    longitude, latitude = _geodetic_deg(dataset, north, east)
    return _track(dataset, name, [longitude, latitude, altitude], dataset["time"].values <= until_s)


def _track(dataset: xr.Dataset, name: str, columns: list[np.ndarray], wanted: np.ndarray) -> Track:
    kept = np.flatnonzero(wanted & np.isfinite(columns).all(axis=0))
    longitude, latitude, height = (column[kept].astype(np.float64) for column in columns)
    return Track(name, kept, dataset["time"].values[kept], longitude, latitude, height)


def _geodetic_deg(dataset: xr.Dataset, north: np.ndarray, east: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Longitude and latitude (deg) of places on the chart of the flight, as its own aircraft have them."""
    reference = [np.radians(float(dataset.attrs[f"reference_{name}_deg"])) for name in ("latitude", "longitude")]
    latitude, longitude, _ = recorded_geodetic_from_flat(np.stack([north, east, np.zeros_like(north)]), *reference, 0.0)
    return 180.0 - np.mod(180.0 - np.degrees(longitude), 360.0), np.degrees(latitude)
