"""When two moving points are nearest to each other, from a sampled record of the offset between them."""

import numpy as np

from anser.planning import nearest_fraction


def closest_approach(
    time_s: np.ndarray, offset: np.ndarray, planned_arrival_s: float | None, margin_s: float = 10.0
) -> tuple[float, float]:
    """Time and distance of the first pass of a moving rendezvous.

    Between samples the offset is taken as linear in time, and its distance is minimised exactly. Only the record up to
    `planned_arrival_s + margin_s` counts, so that a later, nearer pass of the hold around the goal does not.

    Parameters
    ----------
    time_s
        Times of the record, s, increasing; shape (time,).
    offset
        Rendezvous less aircraft, m, in axes that do not turn; shape (time, 3). Samples that are not finite are
        left out.
    planned_arrival_s
        Planned arrival time, s; None searches the whole record.
    margin_s
        How long after the planned arrival the pass may still be, s.

    Returns
    -------
    tuple[float, float]
        Time of closest approach, s, and distance then, m; both NaN when no finite sample lies in the window.

    Raises
    ------
    ValueError
        The shapes do not fit together, or the record has fewer than two samples.
    """
    time, points = np.asarray(time_s, dtype=np.float64), np.asarray(offset, dtype=np.float64)
    if time.ndim != 1 or time.size < 2 or points.shape != (time.size, 3):
        raise ValueError(f"need time (T,) with T >= 2 and offset (T, 3), not {time.shape} and {points.shape}")
    step = np.diff(time)
    end = np.inf if planned_arrival_s is None else planned_arrival_s + margin_s
    allowed = np.clip((end - time[:-1]) / step, 0.0, 1.0)
    fraction, distance = _segment_minima(points, allowed)
    # A segment that begins after the window has no part in it.
    distance = np.where((time[:-1] <= end) & np.isfinite(distance), distance, np.inf)
    nearest = int(np.argmin(distance))
    if not np.isfinite(distance[nearest]):
        return float("nan"), float("nan")
    return float(time[nearest] + fraction[nearest] * step[nearest]), float(distance[nearest])


def least_distance(offset: np.ndarray) -> np.ndarray:
    """Least length of offsets that are linear between samples.

    Parameters
    ----------
    offset
        Offsets between pairs of points, m; shape (time, pair, 3).

    Returns
    -------
    np.ndarray
        Least distance of each pair, m, shape (pair,); NaN for a pair without two neighbouring finite samples.
    """
    _, distance = _segment_minima(offset, np.ones((offset.shape[0] - 1, 1)))
    least = np.min(np.where(np.isfinite(distance), distance, np.inf), axis=0)
    return np.where(np.isfinite(least), least, np.nan)


def _segment_minima(points: np.ndarray, allowed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fraction of each segment, at most `allowed`, where it is nearest to the origin, and the distance there."""
    # A record may hold values that are not finite; a segment with one has a distance that is not finite either.
    points = np.where(np.isfinite(points), points, np.nan)
    start, along = points[:-1], np.diff(points, axis=0)
    fraction = np.minimum(nearest_fraction(start, along), allowed)
    return fraction, np.linalg.norm(start + fraction[..., None] * along, axis=-1)
