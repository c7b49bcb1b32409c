"""Geographic positions of aircraft, goals and rendezvous, and attitudes of the aircraft relative to the Earth."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

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
"""Variables of a flight that the geographic exports need."""

# forward, left, up from forward, right, down: half a turn about the first axis
_FRD_FROM_FLU = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Track:
    """Track of a moving point (aircraft, goal or rendezvous) in geographic coordinates.

    Attributes
    ----------
    name
        Name of the point.
    sample_index
        Indices of the recorded times with a finite position, shape (samples,).
    time_s
        Time, s, shape (samples,).
    longitude_deg, latitude_deg
        Position, deg, shape (samples,).
    height_m
        Height above the WGS-84 ellipsoid, m, shape (samples,).
    """

    name: str
    sample_index: np.ndarray
    time_s: np.ndarray
    longitude_deg: np.ndarray
    latitude_deg: np.ndarray
    height_m: np.ndarray


def aircraft_track(dataset: xr.Dataset, index: int) -> Track:
    """Return the track of an aircraft, as far as its position and attitude are finite."""
    columns = [dataset[name].values[:, index] for name in ("longitude_deg", "latitude_deg", "altitude_m")]
    attitude = np.stack([dataset[name].values[:, index] for name in _QUATERNION])
    name = str(dataset["aircraft"].values[index])
    return _track(dataset, name, columns, np.isfinite(attitude.sum(axis=0)))


def goal_tracks(dataset: xr.Dataset, summary: Mapping[str, Any]) -> list[Track]:
    """Return the track of each goal; a goal of several aircraft has a single track."""
    first_aircraft: dict[str, int] = {}
    for index, aircraft in enumerate(summary["aircraft"]):
        first_aircraft.setdefault(str(aircraft["goal"]), index)
    return [_track_on_local_map(dataset, name, "goal_", index, np.inf) for name, index in first_aircraft.items()]


def rendezvous_track(dataset: xr.Dataset, summary: Mapping[str, Any], index: int) -> Track:
    """Return the track of an aircraft's rendezvous point, up to the arrival."""
    aircraft = summary["aircraft"][index]
    end_times = (aircraft[key] for key in ("arrival_s", "planned_arrival_s") if aircraft[key] is not None)
    return _track_on_local_map(
        dataset, f"{aircraft['name']}: rendezvous", "rendezvous_", index, next(end_times, np.inf)
    )


def earth_fixed_attitude(dataset: xr.Dataset, index: int, track: Track) -> np.ndarray:
    """Compute the attitude of an aircraft in the Earth-fixed frame (ECEF), at the times of its track.

    Returns
    -------
    np.ndarray
        Unit quaternions, scalar last, shape (samples, 4), from body axes forward, left, up (Cesium's model axes) to
        ECEF. Signs are chosen such that neighbouring quaternions can be interpolated.
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
    """Format a time of the flight, s from `start`, as ISO 8601 in UTC to the microsecond."""
    return (start.astimezone(UTC) + timedelta(seconds=float(time_s))).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _track_on_local_map(dataset: xr.Dataset, name: str, prefix: str, index: int, end_s: float) -> Track:
    north, east, altitude = (dataset[f"{prefix}{axis}_m"].values[:, index] for axis in ("north", "east", "altitude"))
    longitude, latitude = _geodetic_deg(dataset, north, east)
    return _track(dataset, name, [longitude, latitude, altitude], dataset["time"].values <= end_s)


def _track(dataset: xr.Dataset, name: str, columns: list[np.ndarray], is_selected: np.ndarray) -> Track:
    samples = np.flatnonzero(is_selected & np.isfinite(columns).all(axis=0))
    longitude, latitude, height = (column[samples].astype(np.float64) for column in columns)
    return Track(name, samples, dataset["time"].values[samples], longitude, latitude, height)


def _geodetic_deg(dataset: xr.Dataset, north: np.ndarray, east: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return longitude and latitude (deg) of positions on the flight's local map (north and east, m)."""
    reference = [np.radians(float(dataset.attrs[f"reference_{name}_deg"])) for name in ("latitude", "longitude")]
    latitude, longitude, _ = recorded_geodetic_from_flat(np.stack([north, east, np.zeros_like(north)]), *reference, 0.0)
    return 180.0 - np.mod(180.0 - np.degrees(longitude), 360.0), np.degrees(latitude)
