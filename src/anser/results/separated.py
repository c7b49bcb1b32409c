"""How far the aircraft of a fleet are from each other at the instants of a record."""

from collections.abc import Mapping

import numpy as np

from anser.planning import separation_ratio


def nearest_other(
    places_m: np.ndarray, separation_m: tuple[float, float] | None = None, counted: np.ndarray | None = None
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
    known = np.ones(places_m.shape[:2], dtype=bool) if counted is None else counted
    nearest = np.full(places_m.shape[:2], np.inf)
    # one after the other: all pairs at once would take memory with the square of the fleet
    for one in range(places_m.shape[1] - 1):
        rest = slice(one + 1, None)
        apart = places_m[:, rest] - places_m[:, [one]]
        if separation_m is None:
            away = np.linalg.norm(apart, axis=-1)
        else:
            away = separation_ratio(np.hypot(apart[..., 0], apart[..., 1]), np.abs(apart[..., 2]), *separation_m)
        away = np.where(known[:, rest] & known[:, [one]] & np.isfinite(away), away, np.inf)
        nearest[:, one] = np.minimum(nearest[:, one], away.min(axis=1))
        nearest[:, rest] = np.minimum(nearest[:, rest], away)
    return np.where(np.isfinite(nearest), nearest, np.nan)


def least_ratio(history: Mapping[str, np.ndarray], separation_m: tuple[float, float]) -> float | None:
    """Least ratio of distance to separation over a whole record, approaches and holds; None for one aircraft alone."""
    places = np.stack([history[key] for key in ("north", "east", "altitude")], axis=-1)
    least = np.nanmin(nearest_other(places, separation_m), initial=np.inf)
    return float(least) if np.isfinite(least) else None
