"""The arrival of an aircraft: the closest pass of its rendezvous, and whether that pass is an arrival."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anser.planning import nearest_fraction
from anser.simulation import STATUS_MESSAGES
from anser.simulation.fleet_summary import ARRIVAL_MARGIN_S

ARRIVED = STATUS_MESSAGES[0]
_ENDED_BEFORE = "not arrived: the flight ended before the planned arrival"
_STILL_CLOSING = "not arrived: still closing on the rendezvous when the search for the arrival ended"
_NO_RECORD = "not arrived: no finite position in the record"


@dataclass(frozen=True)
class Arrival:
    """Outcome of one aircraft's approach.

    Attributes
    ----------
    time_s, miss_m
        Time of arrival, s, and distance from the rendezvous then, m; both NaN without an arrival.
    flown_s
        End of the approach, s: the arrival, else the time at which the aircraft left its plan or the record ended.
    status
        "arrived", or what happened instead or afterwards.
    """

    time_s: float
    miss_m: float
    flown_s: float
    status: str

    @property
    def is_arrival(self) -> bool:
        """Whether the aircraft arrived, whatever happened to it afterwards."""
        return math.isfinite(self.time_s)


def arrival_outcome(
    closest_pass: tuple[float, float], planned_s: float, off_plan_s: float, end_s: float, codes: Sequence[int]
) -> Arrival:
    """Decide whether the closest pass of the rendezvous is an arrival.

    It is one if the aircraft flew its plan at least to the planned arrival, and the distance had begun to grow again
    before the search for the arrival ended: 10 s after the planned arrival, at the end of the record, or where the
    aircraft left its plan. The pass of an aircraft that crashed, broke off or was still closing is none.

    Parameters
    ----------
    closest_pass
        Time of the closest pass up to the end of the search, s, and distance then, m; NaN if there is no record.
    planned_s
        Arrival of the last plan, s.
    off_plan_s
        Time of the first sample with a status that takes the aircraft off its plan, s; infinite if there is none.
    end_s
        End of the record, s.
    codes
        Status over time, or its first and last value other than 0: indices into `STATUS_MESSAGES`.
    """
    time_s, miss_m = closest_pass
    flown_s = min(off_plan_s, end_s)
    is_arrival = flown_s >= planned_s and time_s < min(flown_s, planned_s + ARRIVAL_MARGIN_S)
    failures = [int(code) for code in codes if code != 0]
    if failures:
        # The first one is the cause of those that follow; the last one is how it ended.
        status = "; then ".join(STATUS_MESSAGES[code] for code in dict.fromkeys((failures[0], failures[-1])))
    elif is_arrival:
        status = ARRIVED
    elif not math.isfinite(time_s):
        status = _NO_RECORD
    else:
        status = _STILL_CLOSING if flown_s >= planned_s else _ENDED_BEFORE
    if is_arrival:
        return Arrival(time_s, miss_m, time_s, status)
    return Arrival(math.nan, math.nan, flown_s, status)


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
