"""Distances between the aircraft of a fleet, and from keep-outs, at the times of a record."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from anser.aircraft_files.library import span_of
from anser.planning.separation import keep_out_room, separation_ratio
from anser.results.arrival import least_distance
from anser.scenario.build_aircraft import build_airframe_of
from anser.scenario.schema import Scenario

NO_SEPARATION = "no separation was required"
_NEAR_SPANS = 3.0


def separation_attributes(scenario: Scenario) -> dict[str, int | float]:
    """Return the dataset attributes on the separation of a fleet; empty for a single aircraft.

    - `separation_required`: 1 if the scenario requires a separation, 0 if not
    - `near_distance_m`: distance of a near miss, three wing spans of the widest aircraft; omitted if no span is known
    """
    if len(scenario.aircraft) == 1:
        return {}
    spans = []
    for aircraft in scenario.aircraft:
        with contextlib.suppress(ValueError):  # airframes in code may have no span
            spans.append(float(span_of(build_airframe_of(aircraft))))
    proximity = {"near_distance_m": _NEAR_SPANS * max(spans)} if spans else {}
    return {"separation_required": int(scenario.requires_separation), **proximity}


def is_judged_by_separation(summary: Mapping[str, Any]) -> bool:
    """Whether a flight's requirements include a separation; True for a single aircraft, which needs no separation."""
    names = (entry["name"] for entry in summary["requirements"])
    return len(summary["aircraft"]) == 1 or any(name.startswith("separation") for name in names)


def proximity_warning(
    least_m: Sequence[float | None] | np.ndarray,  # least distance of two aircraft by flight, m; NaN or None if missing
    attributes: Mapping[Any, Any],  # attributes of the dataset, from `separation_attributes`
) -> str:
    """Return a warning if two aircraft came closer than three wing spans in any flight; empty if not."""
    near_m = attributes.get("near_distance_m")
    if near_m is None:
        return ""
    distances = np.asarray(least_m, dtype=float)
    close_distances = distances[distances < near_m]
    if not close_distances.size:
        return ""
    finding = f"two aircraft came within {close_distances.min():.1f} m of each other"
    limit = f"less than three spans ({near_m:.1f} m)"
    return (
        f"{finding}, {limit}"
        if distances.size == 1
        else f"{finding}; {limit} in {close_distances.size} of {distances.size} flights"
    )


def nearest_aircraft_distance(
    positions_m: np.ndarray,  # positions (time, aircraft, axis), m; the third axis is vertical
    # required horizontal and vertical separation, m; vertical 0: the vertical distance is ignored. The larger of the
    # horizontal and the vertical ratio counts. None: the result is the distance in space, m
    separation_m: tuple[float, float] | None = None,
) -> np.ndarray:
    """Compute the distance (m) of each aircraft to the nearest aircraft, or the least ratio of distance to separation.

    Returns shape (time, aircraft); NaN if no other aircraft has a finite position.
    """
    nearest = np.full(positions_m.shape[:2], np.inf)
    # one aircraft at a time: the memory of all pairs would grow with the square of the fleet
    for index in range(positions_m.shape[1] - 1):
        later = slice(index + 1, None)
        offset = positions_m[:, later] - positions_m[:, [index]]
        if separation_m is None:
            distance = np.linalg.norm(offset, axis=-1)
        else:
            distance = separation_ratio(np.hypot(offset[..., 0], offset[..., 1]), np.abs(offset[..., 2]), *separation_m)
        distance = np.where(np.isfinite(distance), distance, np.inf)
        nearest[:, index] = np.minimum(nearest[:, index], distance.min(axis=1))
        nearest[:, later] = np.minimum(nearest[:, later], distance)
    return np.where(np.isfinite(nearest), nearest, np.nan)


def least_separation(history: Mapping[str, np.ndarray]) -> float | None:
    """Return the least distance between two aircraft over a record, m, with linear motion between samples.

    `history` has the positions, arrays (time, aircraft) by key. The distance is None for a single aircraft, and NaN if
    no pair has two consecutive finite samples.
    """
    positions = np.stack([history[key] for key in ("north", "east", "altitude")], axis=-1)
    if positions.shape[1] > 2 and np.isfinite(positions).all():
        # Between two samples, a distance falls below its values at both samples by at most the longest motion of an
        # aircraft in a step. A pair that stays farther apart than that cannot have the least distance.
        nearest = nearest_aircraft_distance(positions).min(axis=0)
        motion_max = np.linalg.norm(np.diff(positions, axis=0), axis=-1).max()
        positions = positions[:, nearest <= nearest.min() + motion_max]
    # one aircraft at a time: the memory of all pairs would grow with the square of the fleet
    pairs = [least_distance(positions[:, i + 1 :] - positions[:, i : i + 1]) for i in range(positions.shape[1] - 1)]
    if not pairs:
        return None
    least = np.concatenate(pairs)
    return float(np.nanmin(least)) if np.isfinite(least).any() else np.nan


def minimum_separation_ratio(history: Mapping[str, np.ndarray], separation_m: tuple[float, float]) -> float | None:
    """Return the least ratio of distance to required separation over a record; None for a single aircraft.

    `history` has the positions, arrays (time, aircraft) by key; `separation_m` is the required horizontal and vertical
    separation, m.
    """
    positions = np.stack([history[key] for key in ("north", "east", "altitude")], axis=-1)
    minimum = np.nanmin(nearest_aircraft_distance(positions, separation_m), initial=np.inf)
    return float(minimum) if np.isfinite(minimum) else None


def least_keep_out_room(time_s: np.ndarray, history: Mapping[str, np.ndarray], scenario: Scenario) -> np.ndarray:
    """Return the least distance of each aircraft outside the keep-outs, m, shape (aircraft,); negative inside.

    Only the samples of the record count. The keep-out of an event counts after the event. `history` has the positions,
    arrays (time, aircraft) by key. The distance is infinite if the scenario has no keep-outs.
    """
    appearing = [(event.keep_out, event.time_s) for event in scenario.event if event.keep_out is not None]
    least = np.full(history["north"].shape[1], np.inf)
    for volume, start_s in [*((volume, 0.0) for volume in scenario.keep_out), *appearing]:
        is_present, (velocity_north, velocity_east, _) = time_s >= start_s, volume.velocity_m_s()
        age_s = time_s[is_present, None] - start_s
        north, east, altitude = (history[key][is_present] for key in ("north", "east", "altitude"))
        distance = np.hypot(
            north - volume.north_m - velocity_north * age_s, east - volume.east_m - velocity_east * age_s
        )
        room = keep_out_room(distance, altitude, volume.radius_m, volume.bottom_m, volume.top_m)
        least = np.fmin(least, np.fmin.reduce(room, axis=0, initial=np.inf))
    return least
