"""How far the aircraft of a fleet are from each other at the instants of a record."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from anser.aircraft_files.library import span_of
from anser.planning.separation import separation_ratio
from anser.scenario.build_aircraft import build_airframe_of
from anser.scenario.schema import Scenario

NO_SEPARATION = "no separation was required"
_NEAR_SPANS = 3.0


def separation_attributes(scenario: Scenario) -> dict[str, int | float]:
    """Attributes of a dataset of several aircraft: whether a separation is required, and which distance is near.

    `near_distance_m` is three wing spans of the widest aircraft; it is left out if no airframe tells its span.
    """
    if len(scenario.aircraft) == 1:
        return {}
    spans = []
    for aircraft in {(one.type, one.variant, one.airframe): one for one in scenario.aircraft}.values():
        with contextlib.suppress(ValueError):  # an airframe in code need not tell its span
            spans.append(float(span_of(build_airframe_of(aircraft))))
    near = {"near_distance_m": _NEAR_SPANS * max(spans)} if spans else {}
    return {"separation_required": int(scenario.requires_separation), **near}


def is_judged_by_separation(summary: Mapping[str, Any]) -> bool:
    """Whether a flight was judged by how near two aircraft came; one aircraft alone has no other."""
    names = (entry["name"] for entry in summary["requirements"])
    return len(summary["aircraft"]) == 1 or any(name.startswith("separation") for name in names)


def proximity_warning(least_m: Sequence[float | None] | np.ndarray, attributes: Mapping[Any, Any]) -> str:
    """Warn of flights in which two aircraft came nearer than three spans; empty if there is none.

    Parameters
    ----------
    least_m
        Least distance of two aircraft in each flight, m; NaN or None where there is none.
    attributes
        Of the dataset, as of `separation_attributes`.
    """
    near_m = attributes.get("near_distance_m")
    if near_m is None:
        return ""
    distances = np.asarray(least_m, dtype=float)
    near = distances[distances < near_m]
    if not near.size:
        return ""
    words = f"two aircraft came within {near.min():.1f} m of each other"
    limit = f"less than three spans ({near_m:.1f} m)"
    return (
        f"{words}, {limit}" if distances.size == 1 else f"{words}; {limit} in {near.size} of {distances.size} flights"
    )


def nearest_aircraft_distance(
    positions_m: np.ndarray, separation_m: tuple[float, float] | None = None, is_included: np.ndarray | None = None
) -> np.ndarray:
    """Least distance of each aircraft to any other, or least ratio of distance to separation; (time, aircraft).

    Parameters
    ----------
    places_m
        (time, aircraft, axis), the third axis vertical.
    separation_m
        Horizontal, and vertical or 0 where altitude does not count; the better of the two ratios counts. None: distance
        in space, m.
    counted
        Which aircraft count at which instant, (time, aircraft); None: all.

    Returns
    -------
    np.ndarray
        NaN where there is no other one that counts.
    """
    known = np.ones(positions_m.shape[:2], dtype=bool) if is_included is None else is_included
    nearest = np.full(positions_m.shape[:2], np.inf)
    # one after the other: all pairs at once would take memory with the square of the fleet
    for one in range(positions_m.shape[1] - 1):
        rest = slice(one + 1, None)
        apart = positions_m[:, rest] - positions_m[:, [one]]
        if separation_m is None:
            away = np.linalg.norm(apart, axis=-1)
        else:
            away = separation_ratio(np.hypot(apart[..., 0], apart[..., 1]), np.abs(apart[..., 2]), *separation_m)
        away = np.where(known[:, rest] & known[:, [one]] & np.isfinite(away), away, np.inf)
        nearest[:, one] = np.minimum(nearest[:, one], away.min(axis=1))
        nearest[:, rest] = np.minimum(nearest[:, rest], away)
    return np.where(np.isfinite(nearest), nearest, np.nan)


def minimum_separation_ratio(history: Mapping[str, np.ndarray], separation_m: tuple[float, float]) -> float | None:
    """Least ratio of distance to separation over a whole record, approaches and holds; None for one aircraft alone."""
    places = np.stack([history[key] for key in ("north", "east", "altitude")], axis=-1)
    least = np.nanmin(nearest_aircraft_distance(places, separation_m), initial=np.inf)
    return float(least) if np.isfinite(least) else None
