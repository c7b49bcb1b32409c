"""How much of the separation that was asked for a flight kept."""

from collections.abc import Mapping

import numpy as np

__all__ = ["separation_ratio"]


def separation_ratio(
    history: Mapping[str, np.ndarray],
    separation_m: tuple[float, float],
) -> float | None:
    """Least ratio of distance to separation between any two aircraft, over the whole record: approaches and holds.

    At each instant of the record the better of the two ratios counts, horizontal and vertical; 1 is just enough.

    Parameters
    ----------
    history
        `north`, `east`, `altitude` of shape (time, aircraft), m.
    separation_m
        Horizontal, and vertical or 0 where altitude does not count, m; the first is positive.

    Returns
    -------
    float or None
        None for one aircraft alone.
    """
    horizontal, vertical = separation_m
    north, east, altitude = (np.asarray(history[key]) for key in ("north", "east", "altitude"))
    least = np.inf
    for one in range(north.shape[1] - 1):
        rest = slice(one + 1, None)
        flat = np.hypot(north[:, rest] - north[:, [one]], east[:, rest] - east[:, [one]]) / horizontal
        tall = np.abs(altitude[:, rest] - altitude[:, [one]]) / vertical if vertical > 0.0 else 0.0
        least = min(least, float(np.nanmin(np.maximum(flat, tall), initial=np.inf)))
    return least if np.isfinite(least) else None
