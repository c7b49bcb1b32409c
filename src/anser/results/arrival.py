"""Arrivals: closest pass of the rendezvous, the conditions of an arrival, and the accuracy of a fleet's arrivals."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from anser.planning.separation import closest_fraction
from anser.scenario.schema import Scenario
from anser.simulation.closed_loop import LEFT_FLEET, STATUS_MESSAGES
from anser.simulation.fleet_summary import ARRIVAL_MARGIN_S

ARRIVED = STATUS_MESSAGES[0]
AS_PLANNED = frozenset({ARRIVED, STATUS_MESSAGES[LEFT_FLEET]})
"""Statuses that are no failure: "arrived", and the status of an aircraft that left the fleet by an event."""
_ENDED_BEFORE = "not arrived: the flight ended before the planned arrival"
_STILL_CLOSING = "not arrived: still closing on the rendezvous when the search for the arrival ended"
_NO_RECORD = "not arrived: no finite position in the record"

THEN = "; then "
"""Text between the first and the last status of an aircraft."""


@dataclass(frozen=True)
class Arrival:
    """Outcome of one aircraft's approach."""

    time_s: float  # time of the arrival, s; NaN if the aircraft did not arrive
    miss_m: float  # distance from the rendezvous at the arrival, m; NaN if the aircraft did not arrive
    # time of the arrival, s; if there is no arrival, time at which the aircraft left its plan or the record ended, s
    approach_end_s: float
    # "arrived" (also if the aircraft left the fleet later), or the first and last failure, or why there is no arrival
    status: str

    @property
    def is_arrival(self) -> bool:
        """Whether the aircraft passed the rendezvous as planned, even if it failed afterwards."""
        return math.isfinite(self.time_s)


def arrival_outcome(
    # time, s, and distance, m, of the closest pass, see `closest_approach`; NaN without a record
    closest_pass: tuple[float, float],
    planned_s: float,  # planned arrival time of the last plan, s
    off_plan_s: float,  # time of the first sample with an off-plan status, s; infinite if always on the plan
    end_s: float,  # end of the record, s
    codes: Sequence[int],  # status codes (indices into `STATUS_MESSAGES`) over time, or the first and last non-zero one
) -> Arrival:
    """Decide whether the closest pass of the rendezvous is an arrival, and return the outcome of the approach.

    The pass is an arrival if two conditions are met:

    - The aircraft flew its plan at least until the planned arrival.
    - The distance increased again before the aircraft left its plan, before the end of the record, and within 10 s of
      the planned arrival.
    """
    time_s, miss_m = closest_pass
    approach_end_s = min(off_plan_s, end_s)
    is_arrival = approach_end_s >= planned_s and time_s < min(approach_end_s, planned_s + ARRIVAL_MARGIN_S)
    failures = [int(code) for code in codes if code != 0]
    # An aircraft may leave the fleet after its arrival.
    if failures and not (is_arrival and set(failures) == {LEFT_FLEET}):
        # The first failure causes the later ones; the last is the final state.
        status = THEN.join(STATUS_MESSAGES[code] for code in dict.fromkeys((failures[0], failures[-1])))
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
    time_s: np.ndarray,  # times of the record, s, increasing; shape (time,)
    # rendezvous minus aircraft position, m, in non-rotating axes; shape (time, 3). Non-finite samples are ignored
    offset: np.ndarray,
    planned_arrival_s: float | None,  # planned arrival time, s; None searches the whole record
    margin_s: float = 10.0,  # allowed delay of the pass after the planned arrival, s
) -> tuple[float, float]:
    """Return the time (s) and distance (m) of the closest pass of a moving rendezvous.

    The offset is linear between samples. Passes later than `planned_arrival_s + margin_s` do not count, since an
    aircraft in the hold may come closer. Time and distance are NaN if no interval between two consecutive finite
    samples starts by then.

    Raises ValueError if the shapes do not match, or the record has fewer than two samples.
    """
    time, points = np.asarray(time_s, dtype=np.float64), np.asarray(offset, dtype=np.float64)
    if time.ndim != 1 or time.size < 2 or points.shape != (time.size, 3):
        raise ValueError(f"need time (T,) with T >= 2 and offset (T, 3), not {time.shape} and {points.shape}")
    step = np.diff(time)
    end = np.inf if planned_arrival_s is None else planned_arrival_s + margin_s
    fraction_max = np.clip((end - time[:-1]) / step, 0.0, 1.0)
    fraction, distance = _segment_minima(points, fraction_max)
    # Segments after the window do not count.
    distance = np.where((time[:-1] <= end) & np.isfinite(distance), distance, np.inf)
    nearest_segment = int(np.argmin(distance))
    if not np.isfinite(distance[nearest_segment]):
        return float("nan"), float("nan")
    return float(time[nearest_segment] + fraction[nearest_segment] * step[nearest_segment]), float(
        distance[nearest_segment]
    )


def least_distance(
    offset: np.ndarray,  # offsets between the points of each pair, m; shape (time, pair, 3)
) -> np.ndarray:
    """Compute the least distance of each pair of points over time, m, with linear motion between samples.

    Returns shape (pair,); NaN for a pair that has no two consecutive finite samples.
    """
    _, distance = _segment_minima(offset, np.ones((offset.shape[0] - 1, 1)))
    minimum = np.min(np.where(np.isfinite(distance), distance, np.inf), axis=0)
    return np.where(np.isfinite(minimum), minimum, np.nan)


def _segment_minima(points: np.ndarray, fraction_max: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the point nearest to the origin on each segment between consecutive `points` (time, ..., axis), m.

    Returns two arrays (time - 1, ...): the fraction of the segment at the point, at most `fraction_max`, and the
    distance from the origin, m; NaN if an endpoint is not finite.
    """
    # A segment with a non-finite value has a non-finite distance.
    points = np.where(np.isfinite(points), points, np.nan)
    start, change = points[:-1], np.diff(points, axis=0)
    fraction = np.minimum(closest_fraction(start, change), fraction_max)
    return fraction, np.linalg.norm(start + fraction[..., None] * change, axis=-1)


_Entry = Mapping[str, Any]
_MILLISECONDS_BELOW_S = 0.0995


@dataclass(frozen=True)
class ArrivalAccuracy:
    """Accuracy of the arrival times of a fleet in one flight: the worst value of one of three measures.

    - "spread", for common arrivals: time between the first and the last arrival
    - "spacing", for a sequence: largest deviation of an interval between two consecutive arrivals from the required one
    - "error", for a single aircraft or individual times: largest deviation of an arrival from its planned time
    """

    kind: Literal["spread", "spacing", "error"]
    value_s: float | None  # None if an arrival is missing
    required_spacing_s: float | None = None  # None except for "spacing"

    def describe(self, aircraft: int) -> str:
        """Return the accuracy as text, for a fleet of `aircraft` aircraft; empty if an arrival is missing."""
        if self.value_s is None:
            return ""
        value = format_duration(self.value_s)
        if self.kind == "spread":
            return f"arrival spread {value}"
        if self.kind == "spacing":
            return f"arrivals {self.required_spacing_s:g} s apart, spacing error {value}"
        return f"arrival {value} off its planned time" if aircraft == 1 else f"arrivals {value} off their times at most"


def format_duration(seconds: float) -> str:
    """Format a duration, s, with unit: "1.50 s" or, below 0.1 s, "15 ms"."""
    return f"{1000 * seconds:.2g} ms" if seconds < _MILLISECONDS_BELOW_S else f"{seconds:.2f} s"


def format_planned_arrivals(aircraft: int, first_s: float, last_s: float) -> str:
    """Format the first and the last planned arrival time (s) of `aircraft` aircraft, as in "all arrive at 60.00 s"."""
    first_text, last_text = f"{first_s:.2f}", f"{last_s:.2f}"
    if first_text != last_text:
        return f"arrivals from {first_text} to {last_text} s"
    return f"arrives at {last_text} s" if aircraft == 1 else f"all arrive at {last_text} s"


def summarize_arrivals(scenario: Scenario, aircraft: Sequence[_Entry]) -> dict[str, Any]:
    """Return the entry `arrival` of a summary: arrival rule, whether the arrival time is common, and errors, s.

    The errors are the largest deviation of an arrival from its planned time and, in a sequence with a required spacing,
    from this spacing; None if an arrival is missing. Aircraft that left the fleet before their arrival do not count.
    """
    staying = [entry for entry in aircraft if "left_s" not in entry]
    arrivals = [entry["arrival_s"] for entry in staying]
    rule, spacing_s = scenario.arrival.rule, scenario.arrival.spacing_s
    has_times = bool(staying) and None not in (*arrivals, *(entry["planned_arrival_s"] for entry in staying))
    arrival_summary: dict[str, Any] = {
        "rule": rule,
        "common": scenario.arrival.is_common,
        "error_max_s": max(abs(entry["arrival_s"] - entry["planned_arrival_s"]) for entry in staying)
        if has_times
        else None,
    }
    if rule == "sequence" and spacing_s is not None:
        ordered = sorted(staying, key=lambda entry: entry["planned_arrival_s"]) if has_times else []
        errors = [_spacing_error(earlier, later, spacing_s) for earlier, later in itertools.pairwise(ordered)]
        worst = max(errors, default=None)
        arrival_summary |= {"spacing_s": spacing_s, "spacing_error_max_s": worst}
    return arrival_summary


def _spacing_error(earlier: _Entry, later: _Entry, spacing_s: float) -> float:
    """Return the absolute deviation, s, of the interval between two arrivals from the planned multiple of a spacing."""
    gap_s, planned_s = (later[key] - earlier[key] for key in ("arrival_s", "planned_arrival_s"))
    places = max(1, round(planned_s / spacing_s)) if spacing_s > 0.0 else 1
    return abs(gap_s - places * spacing_s)


def arrival_accuracy(summary: Mapping[str, Any]) -> ArrivalAccuracy:
    """Return the arrival accuracy of a flight from its summary."""
    # summaries of older versions lack the entry; their arrivals were simultaneous
    requirement = summary.get("arrival") or {"common": True, "error_max_s": None}
    if len(summary["aircraft"]) > 1 and requirement["common"]:
        return ArrivalAccuracy("spread", summary["fleet"]["arrival_spread_s"])
    if len(summary["aircraft"]) > 1 and "spacing_s" in requirement:
        return ArrivalAccuracy("spacing", requirement["spacing_error_max_s"], requirement["spacing_s"])
    return ArrivalAccuracy("error", requirement["error_max_s"])
