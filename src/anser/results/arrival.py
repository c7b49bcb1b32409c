"""Arrivals: the closest pass of the rendezvous.

Whether it counts as an arrival, and how well the arrivals of a fleet fit what the scenario requires.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from anser.planning.separation import closest_fraction
from anser.scenario.schema import Scenario
from anser.simulation.closed_loop import STATUS_MESSAGES
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
    approach_end_s: float
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
    approach_end_s = min(off_plan_s, end_s)
    is_arrival = approach_end_s >= planned_s and time_s < min(approach_end_s, planned_s + ARRIVAL_MARGIN_S)
    failures = [int(code) for code in codes if code != 0]
    if failures:
        # The first one is the cause of those that follow; the last one is how it ended.
        status = "; then ".join(STATUS_MESSAGES[code] for code in dict.fromkeys((failures[0], failures[-1])))
    elif is_arrival:
        status = ARRIVED
    elif not math.isfinite(time_s):
        status = _NO_RECORD
    else:
        status = _STILL_CLOSING if approach_end_s >= planned_s else _ENDED_BEFORE
    if is_arrival:
        return Arrival(time_s, miss_m, time_s, status)
    return Arrival(math.nan, math.nan, approach_end_s, status)


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
    fraction = np.minimum(closest_fraction(start, along), allowed)
    return fraction, np.linalg.norm(start + fraction[..., None] * along, axis=-1)


_Row = Mapping[str, Any]
_MILLISECONDS_BELOW_S = 0.0995


@dataclass(frozen=True)
class ArrivalAccuracy:
    """How well arrivals fit.

    Attributes
    ----------
    kind
        "spread": of those that arrive at one time, from the first to the last; "spacing": of a sequence, the greatest
        difference of the time between two arrivals from that asked for; "error": of one aircraft alone, or of times
        and windows of their own, the greatest difference of an arrival from its planned time.
    value_s
        The number, s; None where an arrival is lacking.
    asked_s
        Time between two arrivals of a sequence, s; else None.
    """

    kind: Literal["spread", "spacing", "error"]
    value_s: float | None
    required_spacing_s: float | None = None

    def describe(self, aircraft: int) -> str:
        """Say it in a few words for so many aircraft; empty where there is no number."""
        if self.value_s is None:
            return ""
        value = format_duration(self.value_s)
        if self.kind == "spread":
            return f"arrival spread {value}"
        if self.kind == "spacing":
            return f"arrivals {self.required_spacing_s:g} s apart, spacing error {value}"
        return f"arrival {value} off its planned time" if aircraft == 1 else f"arrivals {value} off their times at most"


def format_duration(seconds: float) -> str:
    """Say a short time: in milliseconds where that reads better."""
    return f"{1000 * seconds:.2g} ms" if seconds < _MILLISECONDS_BELOW_S else f"{seconds:.2f} s"


def format_planned_arrivals(aircraft: int, first_s: float, last_s: float) -> str:
    """Say when so many aircraft are planned to arrive, in the words of a heading."""
    first, last = f"{first_s:.2f}", f"{last_s:.2f}"
    if first != last:
        return f"arrivals from {first} to {last} s"
    return f"arrives at {last} s" if aircraft == 1 else f"all arrive at {last} s"


def summarize_arrivals(scenario: Scenario, aircraft: Sequence[_Row]) -> dict[str, Any]:
    """What a summary says of the arrivals as a whole, from its rows of the aircraft; who left the fleet counts not."""
    staying = [row for row in aircraft if "left_s" not in row]
    arrivals = [row["arrival_s"] for row in staying]
    rule, spacing_s = scenario.arrival.rule, scenario.arrival.spacing_s
    known = bool(staying) and None not in (*arrivals, *(row["planned_arrival_s"] for row in staying))
    found: dict[str, Any] = {
        "rule": rule,
        "common": scenario.arrival.is_common,
        "error_max_s": max(abs(row["arrival_s"] - row["planned_arrival_s"]) for row in staying) if known else None,
    }
    if rule == "sequence" and spacing_s is not None:
        ordered = sorted(arrivals) if known else []
        gaps = [later - earlier for earlier, later in itertools.pairwise(ordered)]
        worst = max((abs(gap - spacing_s) for gap in gaps), default=None)
        found |= {"spacing_s": spacing_s, "spacing_error_max_s": worst}
    return found


def arrival_accuracy(summary: Mapping[str, Any]) -> ArrivalAccuracy:
    """Find the number in a summary; in one that does not say what was asked, all arrive at one time."""
    asked = summary.get("arrival") or {"common": True, "error_max_s": None}
    if len(summary["aircraft"]) > 1 and asked["common"]:
        return ArrivalAccuracy("spread", summary["fleet"]["arrival_spread_s"])
    if len(summary["aircraft"]) > 1 and "spacing_s" in asked:
        return ArrivalAccuracy("spacing", asked["spacing_error_max_s"], asked["spacing_s"])
    return ArrivalAccuracy("error", asked["error_max_s"])
