"""Answers of the page: a plan, or the reasons for its refusal, as plain data with the positions where they bind."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.config.errors import Problem, ScenarioError
from anser.live.controls import new_tables, sliders
from anser.missions.first_plan import CertifiedFirstPlan, FirstPlan
from anser.missions.plan_output import RecordedPlan, goal_positions_n, record_certified
from anser.missions.plans import plan
from anser.missions.refusal import Refusal
from anser.numerics.arrays import first_rows
from anser.planning.holds.hold_paths import PlannedHolds
from anser.planning.limits import LIMITS
from anser.report.flight_margins import Margin
from anser.report.labels import printed_unit
from anser.scenario.schema import Scenario

_SAMPLES_MAX = 160  # samples of a track on the page
_HOLD_SAMPLES = 60
_TRACK_VARIABLES = ("north_m", "east_m", "altitude_m", "airspeed_m_s", "bank_deg")

Position = dict[str, float]
Answer = dict[str, Any]


def make_answer(scenario: Scenario, on_progress: Callable[[str], None]) -> tuple[Answer, FirstPlan]:
    """Plan a scenario by `anser.plan`; return the answer as plain data, and the plan.

    Raises ScenarioError if an aircraft cannot be trimmed at its start.
    """
    begin = time.perf_counter()
    planned = plan(scenario, on_progress)
    record = _best_record(planned)
    is_flyable = not planned.problems()
    answer: Answer = {
        "status": "planned" if is_flyable else "refused",
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
    answer["problems"] = [_refusal_problem(scenario, text, record) for text in planned.problems()]
    answer["elapsed_ms"] = 1e3 * (time.perf_counter() - begin)
    return answer, planned


def invalid_answer(error: ScenarioError) -> Answer:
    """Return the answer to a document that is not a valid scenario."""
    return {"status": "invalid", "problems": [invalid_problem(problem) for problem in error.problems]}


def invalid_problem(problem: Problem) -> dict[str, Any]:
    """Return a problem of a document for the page."""
    text = f"arrived {problem.arrived}; expected {problem.expected}"
    heading = f"{problem.path}{f' ({problem.subject})' if problem.subject else ''}: " if problem.path else ""
    return {"text": heading + text, "keys": [problem.path] if problem.path else [], "aircraft": [], "positions": []}


def plain_problem(text: str) -> dict[str, Any]:
    """Return a problem without keys and positions for the page."""
    return {"text": text, "keys": [], "aircraft": [], "positions": []}


def _best_record(planned: FirstPlan) -> RecordedPlan | None:
    """Return the record of the plan, or of the attempt with the fewest failed aircraft; None without any."""
    if not planned.refusals:
        return planned.record()
    if not isinstance(planned, CertifiedFirstPlan) or planned.outcome is None:
        return None
    attempt = planned.outcome.plan_without_holds or planned.outcome.best_attempt
    if attempt is None:
        return None
    count = len(planned.scenario.aircraft)
    attempt, tasks = attempt.leading(count), first_rows(planned.padded_tasks, count)
    return record_certified(planned.scenario, attempt, tasks, planned.airspace.gravity)


def _record_values(
    scenario: Scenario, record: RecordedPlan, holds: PlannedHolds | None, is_proven: bool
) -> dict[str, Any]:
    """Return the entries of an answer that follow from the record of a plan."""
    dataset, summary = record.dataset, record.summary
    last_s = summary["arrival"]["last_s"]
    return {
        "first_s": summary["arrival"]["first_s"],
        "last_s": last_s,
        "aircraft": [
            _aircraft_entry(dataset, entry, k, is_proven) | {"hold": _hold_track(holds, k)}
            for k, entry in enumerate(summary["aircraft"])
        ],
        "separation": _separation_entry(dataset, summary),
        "keep_outs": [
            {"name": entry["name"], "aircraft": entry["aircraft"], "clearance_m": entry["room_m"]}
            for entry in summary["keep_outs"]
        ],
        "goals": _goal_tracks(scenario, last_s if last_s is not None else scenario.timing.duration_s),
    }


def _aircraft_entry(dataset: xr.Dataset, entry: Mapping[str, Any], k: int, is_proven: bool) -> dict[str, Any]:
    rows = np.flatnonzero(np.isfinite(dataset["north_m"].values[:, k]))
    rows = rows[np.unique(np.linspace(0, rows.size - 1, min(rows.size, _SAMPLES_MAX)).round().astype(int))]
    track = {name: _rounded(dataset[name].values[rows, k]) for name in _TRACK_VARIABLES}
    track["time_s"] = _rounded(dataset["time"].values[rows])
    return {
        "name": entry["name"],
        "goal": entry["goal"],
        "arrival_s": entry["arrival_s"],
        "path": entry["path"],
        "length_m": entry["length_m"],
        "speed_mean_m_s": entry["speed_mean_m_s"],
        "proven": is_proven,
        "track": track,
        "rendezvous": {name: track[name][-1] for name in _TRACK_VARIABLES[:3]},
        "limits": [_limit_entry(limit) for limit in entry["limits"]],
    }


_LIMITS_BY_NAME = {limit.name: limit for limit in LIMITS}


def _limit_entry(entry: Mapping[str, Any]) -> dict[str, Any]:
    limit = _LIMITS_BY_NAME[entry["name"]]
    value = entry.get("bound", entry["planned"])
    margin = Margin(
        limit.description,
        "limit",
        limit.suffix,
        entry["limit"],
        value,
        not limit.is_lower_bound,
        entry["margin"] >= 0.0,
    )
    utilization = margin.utilization
    return {
        "name": entry["name"],
        "key": f"limits.{limit.scenario_key}",
        "label": limit.description,
        "unit": printed_unit(limit.unit),
        "limit": entry["limit"],
        "planned": entry["planned"],
        "bound": value,
        "margin": entry["margin"],
        "utilization": None if utilization is None or not np.isfinite(utilization) else utilization,
    }


def _separation_entry(dataset: xr.Dataset, summary: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the closest pair by required separation, else by distance; None for a single aircraft."""
    entry = summary["separation"] or summary["least_distance"]
    if entry["pair"] is None or entry["time_s"] is None:
        return None
    required_m = entry.get("horizontal_asked_m")
    return {
        "required_m": required_m,
        "least_m": entry["value_m"],
        "time_s": entry["time_s"],
        "pair": entry["pair"],
        "positions": [_position_at(dataset, name, entry["time_s"]) for name in entry["pair"]],
        "utilization": required_m / entry["value_m"] if required_m and entry["value_m"] else None,
    }


def _position_at(dataset: xr.Dataset, name: str, time_s: float) -> Position:
    """Return the position of an aircraft at a time, linear between the samples."""
    k = dataset["aircraft"].values.tolist().index(name)
    return {
        key: round(float(np.interp(time_s, dataset["time"].values, dataset[key].values[:, k])), 3)
        for key in _TRACK_VARIABLES[:3]
    }


def _hold_track(holds: PlannedHolds | None, k: int) -> dict[str, list[float]] | None:
    """Return the path of an aircraft's hold over the ground; None without planned holds."""
    if holds is None:
        return None
    knots = np.asarray(holds.paths.air_n)[k, :, 0] + np.asarray(holds.paths.drift_n)[k, :, 0]
    knots = knots[np.unique(np.linspace(0, len(knots) - 1, _HOLD_SAMPLES).round().astype(int))]
    return {"north_m": _rounded(knots[:, 0]), "east_m": _rounded(knots[:, 1]), "altitude_m": _rounded(-knots[:, 2])}


def _goal_tracks(scenario: Scenario, end_s: float) -> list[dict[str, Any]]:
    """Return the motion of each goal from the start to a time, s."""
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


def _refusal_problem(scenario: Scenario, text: str, record: RecordedPlan | None) -> dict[str, Any]:
    """Return a reason for a refusal with the keys that bind, and the positions where they bind."""
    names = list(text.aircraft) if isinstance(text, Refusal) else []
    keys = list(text.keys) if isinstance(text, Refusal) else []
    return {
        "text": str(text),
        "keys": keys,
        "aircraft": names,
        "positions": [] if record is None else list(_binding_positions(scenario, record, names, keys)),
    }


def _binding_positions(
    scenario: Scenario, record: RecordedPlan, names: Sequence[str], keys: Sequence[str]
) -> Iterable[Position]:
    """Yield the positions of the best attempt where a reason binds.

    Two aircraft: both at their closest approach. One aircraft: where its path demands most of the binding limit,
    otherwise its rendezvous.
    """
    dataset = record.dataset
    if len(names) == 2:
        pair = record.summary["separation"] or record.summary["least_distance"]
        time_s = pair["time_s"] if pair["pair"] is not None and set(pair["pair"]) == set(names) else None
        for name in names:
            arrival_s = float(dataset["arrival_time_s"].sel(aircraft=name))
            yield _position_at(dataset, name, arrival_s if time_s is None else time_s)
        return
    for name in names:
        k = dataset["aircraft"].values.tolist().index(name)
        limit = next((limit for limit in LIMITS if f"limits.{limit.scenario_key}" in keys), None)
        row = int(np.flatnonzero(np.isfinite(dataset["north_m"].values[:, k]))[-1])
        if limit is not None:
            variable = f"{limit.variable}_{limit.suffix}" if limit.suffix else limit.variable
            extremes = limit.extreme(dataset[variable].values[None, :, k], 0)
            row = int(np.nanargmax(-extremes if limit.is_lower_bound else extremes))
        yield {key: round(float(dataset[key].values[row, k]), 3) for key in _TRACK_VARIABLES[:3]}


def _rounded(values: np.ndarray) -> list[float]:
    """Return values for the page, to a millimetre or a thousandth of their unit."""
    return [round(float(value), 3) for value in values]
