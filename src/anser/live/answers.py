"""Answers to the live page: a plan, or the reasons for its refusal, as plain data for JSON.

A "document" of the page is a scenario as nested dictionaries and lists, as in a scenario file. A "problem" is a message
with the keys, the aircraft and the positions that cause it.
"""

import dataclasses
import re
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from anser.config.errors import Problem, ScenarioError
from anser.live.controls import new_tables, sliders
from anser.missions.first_plan import CertifiedFirstPlan, FirstPlan, possible_arrivals
from anser.missions.plan_output import RecordedPlan, goal_positions_n, record_certified
from anser.missions.plans import plan
from anser.missions.refusal import EXCESS_MEANINGFUL, Refusal, describe_failed_attempt, earliest_common_time
from anser.numerics.arrays import first_rows
from anser.planning.certified.certified_plan import CertifiedPlan
from anser.planning.certified.search import FailedAttempt
from anser.planning.holds.hold_paths import PlannedHolds
from anser.planning.limits import LIMITS, Limit
from anser.report.flight_margins import Margin
from anser.report.labels import printed_unit
from anser.results.documents import finite_or_none
from anser.results.plan_record import ClosestApproach, PlanSamples, limit_columns
from anser.scenario.build import build_flight
from anser.scenario.schema import Scenario
from anser.scenario.schema_reach import EarlyArrival

_SAMPLES_MAX = 160  # samples of a track on the page
_HOLD_SAMPLES = 60
_COORDINATES = {"north_m": "north", "east_m": "east", "altitude_m": "altitude"}

_ARRIVAL_KEYS = ("arrive_s", "arrive_from_s", "arrive_to_s")
_AIRCRAFT_PATH = re.compile(r"aircraft\[(\d+)\]")

Position = dict[str, float]
Answer = dict[str, Any]


def make_answer(scenario: Scenario, on_progress: Callable[[str], None]) -> tuple[Answer, FirstPlan]:
    """Plan a scenario with `anser.plan`; return the answer (plan or reasons for its refusal) and the plan itself.

    `on_progress` is called with messages during the search. Raises ScenarioError if an aircraft cannot be trimmed at
    its start.
    """
    begin = time.perf_counter()
    planned = plan(scenario, on_progress)
    record, drawn = _best_record(planned), _drawn_attempts(planned)
    is_flyable = not planned.problems()
    answer: Answer = {
        "status": "planned" if is_flyable else "refused",
        "certified": isinstance(planned, CertifiedFirstPlan),  # whether the planner proves limits and separation
        "problems": [],
        "notes": list(planned.notes()),
        "rule": scenario.arrival.rule,
        "sliders": sliders(scenario),
        "templates": new_tables(scenario),
        "first_s": None,
        "last_s": None,
        "aircraft": [],
        "separation": None,
        "keep_outs": [],
        "goals": [] if record is not None else _goal_tracks(scenario, scenario.timing.duration_s),
    }
    if record is not None:
        holds = planned.holds if isinstance(planned, CertifiedFirstPlan) else None
        answer |= _record_values(scenario, record, holds, is_flyable)
        for entry, is_drawn in zip(answer["aircraft"], drawn, strict=True):
            entry["drawn"] = is_drawn
    answer["problems"] = [_refusal_problem(scenario, text, record, drawn) for text in planned.problems()]
    answer["elapsed_ms"] = 1e3 * (time.perf_counter() - begin)
    return answer, planned


def preliminary_answer(scenario: Scenario, message: FailedAttempt) -> Answer:
    """Return an answer with the status "searching" and the problems of a failed attempt at a plan.

    `message` is the progress report with the attempt; the search for a plan goes on.
    """
    reasons = describe_failed_attempt(scenario, message.attempt.leading(len(scenario.aircraft)))
    return {"status": "searching", "problems": [_refusal_problem(scenario, text, None) for text in reasons]}


def invalid_answer(error: ScenarioError) -> Answer:
    """Return the answer to a document that is not a valid scenario, with the problems of `error`."""
    return {"status": "invalid", "problems": [invalid_problem(problem) for problem in error.problems]}


def without_arrival_times(values: dict[str, Any], error: ScenarioError) -> dict[str, Any] | None:
    """Return a copy of a document with the arrival rule "earliest" in place of prescribed arrival times.

    None if `error` has a problem other than an arrival time that is too early.
    """
    if not all(isinstance(problem, EarlyArrival) for problem in error.problems):
        return None
    aircraft = [
        {key: entry for key, entry in table.items() if key not in _ARRIVAL_KEYS} for table in values["aircraft"]
    ]
    return values | {"aircraft": aircraft, "arrival": {"rule": "earliest"}}


def advised_answer(error: ScenarioError, scenario: Scenario) -> Answer:
    """Return the answer to arrival times that are too early, with the earliest possible times in the problems.

    `error` has the problems of the document; `scenario` is the document's scenario with the arrival rule "earliest".
    """
    arrivals = possible_arrivals(scenario, build_flight(scenario, pad_fleet=True))
    answer = invalid_answer(error)
    for k, problem in enumerate(error.problems):
        assert isinstance(problem, EarlyArrival)
        row = _AIRCRAFT_PATH.match(problem.path)
        index = None if row is None else int(row[1])
        earliest_s = earliest_common_time(arrivals if index is None else arrivals[index : index + 1], 0.0)
        if earliest_s is not None and problem.given_s < earliest_s:
            subject = "all can arrive, each" if index is None else f'"{scenario.aircraft[index].name}" can arrive'
            expected = f"at least {earliest_s:.1f} s, the earliest time at which {subject} by itself"
            answer["problems"][k] = invalid_problem(dataclasses.replace(problem, expected=expected))
    return answer


def invalid_problem(problem: Problem) -> dict[str, Any]:
    """Return a problem of a document's key or value as plain data for the page."""
    text = f"given {problem.arrived}; expected {problem.expected}"
    heading = f"{problem.path}{f' ({problem.subject})' if problem.subject else ''}: " if problem.path else ""
    return {"text": heading + text, "keys": [problem.path] if problem.path else [], "aircraft": [], "positions": []}


def plain_problem(text: str) -> dict[str, Any]:
    """Return a message as a problem for the page, without keys, aircraft and positions."""
    return {"text": text, "keys": [], "aircraft": [], "positions": []}


def _best_record(planned: FirstPlan) -> RecordedPlan | None:
    """Return the record of the plan or, after a refusal, of the result of `_best_attempt`; None if neither exists."""
    if not planned.refusals:
        return planned.record()
    attempt = _best_attempt(planned)
    if attempt is None or not isinstance(planned, CertifiedFirstPlan):
        return None
    tasks = first_rows(planned.padded_tasks, len(planned.scenario.aircraft))
    return record_certified(planned.scenario, attempt, tasks, planned.airspace.gravity)


def _best_attempt(planned: FirstPlan) -> CertifiedPlan | None:
    """Return the certified planner's best attempt, without the aircraft that only pad arrays; None if there is none.

    An attempt that lacks only the holding patterns after the arrivals is best. If there is no such attempt, the attempt
    with the fewest failed aircraft is best.
    """
    if not isinstance(planned, CertifiedFirstPlan) or planned.outcome is None:
        return None
    attempt = planned.outcome.plan_without_holds or planned.outcome.best_attempt
    return None if attempt is None else attempt.leading(len(planned.scenario.aircraft))


def _drawn_attempts(planned: FirstPlan) -> list[bool]:
    """Return whether the page draws the path, for each aircraft in the scenario's order.

    A path of a failed attempt is not drawn if its relative excess over a limit is above `EXCESS_MEANINGFUL`. Paths that
    violate the separation or a keep-out are drawn, to show the conflict.
    """
    attempt = _best_attempt(planned) if planned.refusals else None
    if attempt is None:
        return [True] * len(planned.scenario.aircraft)
    excesses = np.asarray(attempt.certificate.excess)
    return [bool(np.all(excess <= EXCESS_MEANINGFUL)) for excess in excesses]  # not a number: no path


def _record_values(
    scenario: Scenario, record: RecordedPlan, holds: PlannedHolds | None, is_proven: bool
) -> dict[str, Any]:
    """Return the entries of an answer that follow from the record of a plan or attempt.

    `holds` are the planned holding patterns; `is_proven` says whether all limits are proven.
    """
    samples = record.samples
    arrivals_s = samples.arrival_times_s
    last_s = finite_or_none(np.max(arrivals_s))
    columns = list(limit_columns(samples, record.details))
    names = [aircraft.name for aircraft in scenario.aircraft]
    nearest = np.argmin(np.where(np.isfinite(samples.keep_out_margin_m), samples.keep_out_margin_m, np.inf), axis=0)
    return {
        "first_s": finite_or_none(np.min(arrivals_s)),
        "last_s": last_s,
        "aircraft": [
            _aircraft_entry(scenario, record, k, is_proven)
            | {"limits": list(_limit_entries(columns, k)), "hold": _hold_track(holds, k)}
            for k in range(len(names))
        ],
        "separation": _separation_entry(scenario, samples),
        "keep_outs": [
            {
                "name": keep_out.name,
                "aircraft": names[nearest[j]],
                "clearance_m": finite_or_none(samples.keep_out_margin_m[nearest[j], j]),
            }
            for j, keep_out in enumerate(scenario.keep_out)
        ],
        "goals": _goal_tracks(scenario, last_s if last_s is not None else scenario.timing.duration_s),
    }


def _aircraft_entry(scenario: Scenario, record: RecordedPlan, k: int, is_proven: bool) -> Answer:
    samples, details, aircraft = record.samples, record.details, scenario.aircraft[k]
    rows = np.flatnonzero(np.isfinite(samples.history["north"][:, k]))
    rows = rows[np.unique(np.linspace(0, rows.size - 1, min(rows.size, _SAMPLES_MAX)).round().astype(int))]
    track = {name: _rounded(samples.history[key][rows, k]) for name, key in _COORDINATES.items()}
    lengths_m = samples.extremes.length if details.lengths_m is None else details.lengths_m
    return {
        "name": aircraft.name,
        "goal": aircraft.goal,
        "arrival_s": finite_or_none(samples.arrival_times_s[k]),
        "path": details.paths[k],
        "length_m": finite_or_none(lengths_m[k]),
        "speed_mean_m_s": finite_or_none(samples.extremes.speed_mean[k]),
        "proven": is_proven,
        "track": track
        | {
            "time_s": _rounded(samples.time_s[rows]),
            "bank_deg": _rounded(np.degrees(samples.history["bank"][rows, k])),
        },
        "rendezvous": {name: coordinates[-1] for name, coordinates in track.items()},
    }


def _limit_entries(columns: Iterable[tuple[Limit, dict[str, np.ndarray]]], k: int) -> Iterable[Answer]:
    """Yield an entry for each finite limit of aircraft number `k`; `columns` is the result of `limit_columns`.

    `bound` is the proven extreme or, if the planner proves no bound, the extreme of the samples.
    """
    for limit, values in columns:
        limit_value, planned = values["limit_"][k], values[""][k]
        if not np.isfinite(limit_value):
            continue
        bound = values.get("bound_", values[""])[k]
        is_met = bool(bound >= limit_value if limit.is_lower_bound else bound <= limit_value)
        margin = Margin(
            limit.description,
            "limit",
            limit.suffix,
            limit_value,
            finite_or_none(bound),
            not limit.is_lower_bound,
            is_met,
        )
        yield {
            "label": limit.description,
            "unit": printed_unit(limit.unit),
            "limit": float(limit_value),
            "is_least": limit.is_lower_bound,
            "planned": finite_or_none(planned),
            "bound": margin.value,
            "utilization": finite_or_none(margin.utilization),
        }


def _separation_entry(scenario: Scenario, samples: PlanSamples) -> Answer | None:
    """Return the entry on the closest pair of aircraft in the plan; None for a single aircraft.

    If a vertical separation is required, `distances_m` and `required_m` have two values, horizontal and vertical. If
    only a horizontal separation is required, each list has the horizontal value. If no separation is required,
    `distances_m` has the distance in space, and `required_m` is empty.
    """
    closest, separation_m = _closest_approach(samples), scenario.separation.required_m
    if not np.isfinite(closest.minimum_m):
        return None
    required_m = [] if separation_m is None else [distance_m for distance_m in separation_m if distance_m > 0.0]
    time_s = closest.minimum_time_s
    return {
        "required_m": required_m,
        "distances_m": [closest.horizontal_m, closest.vertical_m] if len(required_m) > 1 else [closest.minimum_m],
        "time_s": time_s,
        "pair": [scenario.aircraft[k].name for k in closest.minimum_pair],
        "positions": [_position_at(samples, k, time_s) for k in closest.minimum_pair],
        "is_met": separation_m is None or closest.minimum_m >= separation_m[0],
    }


def _closest_approach(samples: PlanSamples) -> ClosestApproach:
    """Return the closest approach, measured by separation or, if no separation is required, by distance in space."""
    return samples.closest_by_distance if samples.closest_by_separation is None else samples.closest_by_separation


def _position_at(samples: PlanSamples, k: int, time_s: float) -> Position:
    """Return the position of aircraft number `k` at a time, linear between the samples."""
    return {
        name: round(float(np.interp(time_s, samples.time_s, samples.history[key][:, k])), 3)
        for name, key in _COORDINATES.items()
    }


def _hold_track(holds: PlannedHolds | None, k: int) -> dict[str, list[float]] | None:
    """Return north, east and altitude (m) along the holding pattern of aircraft `k`; None if no holds are planned."""
    if holds is None:
        return None
    knots = np.asarray(holds.paths.air_n)[k, :, 0] + np.asarray(holds.paths.drift_n)[k, :, 0]
    knots = knots[np.unique(np.linspace(0, len(knots) - 1, _HOLD_SAMPLES).round().astype(int))]
    return {"north_m": _rounded(knots[:, 0]), "east_m": _rounded(knots[:, 1]), "altitude_m": _rounded(-knots[:, 2])}


def _goal_tracks(scenario: Scenario, end_s: float) -> list[dict[str, Any]]:
    """Return the track of each goal from time 0 to `end_s`, s: name, north, east and altitude, m."""
    tracks = []
    for goal in scenario.goal:
        corners_s = [] if goal.waypoints is None else [point.time_s for point in goal.waypoints if point.time_s < end_s]
        times_s = np.unique([0.0, *corners_s, end_s])
        positions_n = goal_positions_n(goal, times_s)
        tracks.append(
            {
                "name": goal.name,
                "north_m": _rounded(positions_n[:, 0]),
                "east_m": _rounded(positions_n[:, 1]),
                "altitude_m": _rounded(-positions_n[:, 2]),
            }
        )
    return tracks


def _refusal_problem(
    scenario: Scenario, text: str, record: RecordedPlan | None, drawn: Sequence[bool] = ()
) -> dict[str, Any]:
    """Return `text`, a reason for a refusal, as a problem for the page: text, keys, aircraft, positions.

    `record` is the best attempt, None if unknown; `drawn` says which aircraft's paths the page draws.
    """
    names = list(text.aircraft) if isinstance(text, Refusal) else []
    keys = list(text.keys) if isinstance(text, Refusal) else []
    return {
        "text": str(text),
        "keys": keys,
        "aircraft": names,
        "positions": [] if record is None else list(_binding_positions(scenario, record, names, keys, drawn)),
    }


def _binding_positions(
    scenario: Scenario, record: RecordedPlan, names: Sequence[str], keys: Sequence[str], drawn: Sequence[bool]
) -> Iterable[Position]:
    """Yield the positions at which the page marks a reason for a refusal that concerns the aircraft `names`.

    - Two aircraft: positions at the fleet's closest approach; if another pair is closest, positions at their arrivals
    - Any other number: on each drawn path, the extreme of the first limit in `keys`; if no key is a limit, the end
    """
    samples = record.samples
    indices = {aircraft.name: k for k, aircraft in enumerate(scenario.aircraft)}
    if len(names) == 2:
        closest, pair = _closest_approach(samples), {indices[name] for name in names}
        time_s = closest.minimum_time_s if set(closest.minimum_pair) == pair else None
        for name in names:
            k = indices[name]
            yield _position_at(samples, k, float(samples.arrival_times_s[k]) if time_s is None else time_s)
        return
    for k in (indices[name] for name in names if drawn[indices[name]]):
        limit = next((limit for limit in LIMITS if f"limits.{limit.scenario_key}" in keys), None)
        row = int(np.flatnonzero(np.isfinite(samples.history["north"][:, k]))[-1])
        if limit is not None:
            extremes = limit.extreme(samples.history[limit.variable][None, :, k], 0)
            row = int(np.nanargmax(-extremes if limit.is_lower_bound else extremes))
        yield {axis: round(float(samples.history[key][row, k]), 3) for axis, key in _COORDINATES.items()}


def _rounded(values: np.ndarray) -> list[float]:
    """Return values for the page, rounded to three decimals (a millimetre)."""
    return np.round(values, 3).tolist()
