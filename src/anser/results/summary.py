"""Machine-readable summary of a flight (`summary.json`, format version 1): computation, files, required keys."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.files import write_file
from anser.planning.limits import NOMINAL_BEND_M
from anser.results.arrival import Arrival, arrival_outcome, closest_approach, least_distance, summarize_arrivals
from anser.results.checksums import add_checksum, damaged_file_error, read_document
from anser.results.documents import finite_or_none, software_versions
from anser.results.requirements import evaluate_requirements, scenario_requirements
from anser.results.separation import minimum_separation_ratio
from anser.scenario.schema import Scenario
from anser.simulation.closed_loop import HOLD, LEFT_FLEET, is_off_plan
from anser.simulation.fleet_summary import ARRIVAL_MARGIN_S
from anser.variables import STANDARD_SURFACES


class _Section(BaseModel):
    model_config = ConfigDict(strict=True)


class _ScenarioKeys(_Section):
    name: str


class _AircraftKeys(_Section):
    name: str
    goal: str
    status: str
    planned_arrival_s: FiniteFloat | None
    arrival_s: FiniteFloat | None
    miss_m: FiniteFloat | None


class _FleetKeys(_Section):
    separation_min_m: FiniteFloat | None
    simulated_s: FiniteFloat


class _RequirementKeys(_Section):
    name: str
    met: bool


class _SummaryKeys(_Section):
    scenario: _ScenarioKeys
    aircraft: list[_AircraftKeys] = Field(min_length=1)
    fleet: _FleetKeys
    requirements: list[_RequirementKeys]


def summary_problem(summary: dict[str, Any]) -> tuple[str, str] | None:
    """Return the problem of the first invalid key in a summary, and the content expected; None if all are valid."""
    try:
        _SummaryKeys.model_validate(summary)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        key = ".".join(map(str, problem["loc"]))
        if problem["type"] == "missing":
            return f"no {key}", "a summary of a flight, which has one"
        return f"{problem['input']!r:.60} in {key}", problem["msg"].removeprefix("Input should be ")
    return None


FORMAT_VERSION = 1
CLEARANCE_MIN_M = {"surface": SURFACE_STAND_OFF_MIN_M, "airborne": AIRBORNE_STAND_OFF_MIN_M}
"""Least distance required from a goal of each kind, m: part of the product's scope, not of a scenario."""


def summarize(
    time_s: np.ndarray,
    history: Mapping[str, np.ndarray],
    scenario: Scenario,
    wall_s: float,
    paths: Sequence[str] = (),
    events: Sequence[Mapping[str, Any]] = (),
    goals: Sequence[str] = (),
    surfaces: Sequence[Sequence[str]] = (),
) -> dict[str, Any]:
    """Compute the summary of a flight from its complete history.

    Arrivals are those of `arrival_outcome`; without an arrival, time and miss are None. Speeds (without gusts) and
    position error count up to the arrival or, without an arrival, while the plan is flown (the hold has no planned
    position). Clearance, separation and the time outside the aerodynamic tables count over the whole record. Path and
    lateral bend are those of the first plan, which describes the whole path; `nominal` is true for a path without a
    bend. Only paths of the published planner have a bend; for other planners `lateral_bend_m` and `nominal` are None.
    Missing values are None, never NaN.

    Parameters
    ----------
    time_s
        Times of the record, s, increasing; shape (time,), at least two.
    history
        Arrays (time, aircraft) in SI units and radians, keyed as in `anser.variables`.
    wall_s
        Duration of the computation, s.
    paths
        Descriptions of the paths in the first plan, by aircraft; empty if unknown.
    events
        Events of the flight and their effects on the plan.
    goals
        Name of the final goal by aircraft, if goals were reassigned; empty: the scenario's goals.
    surfaces
        Names of the control surfaces by aircraft; empty: the standard surfaces.

    Returns
    -------
    dict
        Content of `summary.json`: plain numbers, text, lists and dicts.

    Raises
    ------
    ValueError
        If the record does not match the scenario.
    """
    time = np.asarray(time_s, dtype=np.float64)
    expected = (time.size, len(scenario.aircraft))
    if time.size < 2 or history["north"].shape != expected:
        raise ValueError(
            f"the record has shape {history['north'].shape}; time (at least 2) and aircraft give {expected}"
        )
    if surfaces and len(surfaces) != expected[1]:
        raise ValueError(f"surfaces are those of {len(surfaces)} aircraft; there are {expected[1]}")
    surface_lists = surfaces or [STANDARD_SURFACES] * len(scenario.aircraft)
    aircraft = [
        _aircraft_entry(time, history, scenario, *column_surfaces) for column_surfaces in enumerate(surface_lists)
    ]
    for entry, path in zip(aircraft, paths, strict=bool(paths)):
        entry["path"] = path
    for entry, goal in zip(aircraft, goals, strict=bool(goals)):
        entry["goal"] = goal
    arrivals = [entry["arrival_s"] for entry in aircraft if "left_s" not in entry]
    fleet: dict[str, float | None] = {
        "arrival_spread_s": None if not arrivals or None in arrivals else max(arrivals) - min(arrivals),
        "separation_min_m": _least_separation(history),
        "wall_s": finite_or_none(wall_s),
        "simulated_s": finite_or_none(time[-1] - time[0]),
    }
    if scenario.separation.required_m is not None:
        fleet["separation_ratio_min"] = minimum_separation_ratio(history, scenario.separation.required_m)
    goal_kinds = _clearance_kinds(scenario, aircraft)
    return {
        "format_version": FORMAT_VERSION,
        "scenario": {"name": scenario.name, "hash": scenario.hash},
        "versions": software_versions(),
        "seed": scenario.seed,
        "aircraft": aircraft,
        "arrival": summarize_arrivals(scenario, aircraft),
        "fleet": fleet,
        "requirements": evaluate_requirements(
            scenario_requirements(scenario), aircraft, fleet, [(kind, CLEARANCE_MIN_M[kind]) for kind in goal_kinds]
        ),
        **({"events": [dict(event) for event in events]} if events else {}),
    }


def _clearance_kinds(scenario: Scenario, aircraft: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return for each aircraft the kind of goal that sets its required distance.

    After a reassignment of goals, it is the kind with the greater distance.
    """
    kind_by_goal = {goal.name: goal.kind for goal in scenario.goal}
    return [
        max((kind_by_goal[entry["goal"]], kind_by_goal[config.goal]), key=CLEARANCE_MIN_M.__getitem__)
        for entry, config in zip(aircraft, scenario.aircraft, strict=True)
    ]


def write_summary(summary: Mapping[str, Any], path: Path) -> None:
    """Write a summary as JSON, with a checksum.

    Raises
    ------
    FileExistsError
        If `path` exists: a summary is never overwritten.
    ValueError
        If the summary contains a number without JSON representation (NaN, infinity).
    """
    text = json.dumps(add_checksum(summary), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    write_file(path, text)


def read_summary(path: Path) -> dict[str, Any]:
    """Read and verify a summary that `write_summary` wrote.

    Raises
    ------
    DamagedFileError
        If the file is not a complete summary of this format version.
    """
    summary, _ = read_document(path)
    version = summary.get("format_version")
    if version != FORMAT_VERSION:
        raise damaged_file_error(
            path, f"format_version {version!r}", f"{FORMAT_VERSION}, which this version of anser reads"
        )
    problem = summary_problem(summary)
    if problem is not None:
        raise damaged_file_error(path, *problem)
    return summary


def _aircraft_entry(
    time: np.ndarray, history: Mapping[str, np.ndarray], scenario: Scenario, column: int, surfaces: Sequence[str]
) -> dict[str, Any]:
    """Return the entry of the aircraft in `column` of the history, without its description of the path."""
    record = {key: np.asarray(values)[:, column] for key, values in history.items()}
    planned = float(record["arrival_time"][-1])
    approach = _approach(time, record, planned)
    mean, minimum, maximum = _speed_statistics(
        time, record.get("airspeed_mean_wind", record["airspeed"]), approach.approach_end_s
    )
    bends = record["lateral_bend"][np.isfinite(record["lateral_bend"])]
    bend = float(bends[0]) if bends.size else None
    tables_left_s = float(np.sum(np.diff(time)[record["outside_tables"][:-1]]))
    departure_samples = np.flatnonzero(record["status"] == LEFT_FLEET)
    has_left = departure_samples.size > 0
    return {
        **({"left_s": float(time[departure_samples[0]])} if has_left else {}),
        "name": scenario.aircraft[column].name,
        "goal": scenario.aircraft[column].goal,
        "planned_arrival_s": None if has_left else finite_or_none(planned),
        "arrival_s": None if has_left else finite_or_none(approach.time_s),
        "miss_m": None if has_left else finite_or_none(approach.miss_m),
        "speed_mean_m_s": mean,
        "speed_min_m_s": minimum,
        "speed_max_m_s": maximum,
        "clearance_min_m": _finite_extreme(np.min, record["clearance"]),
        "tables_left": bool(np.any(record["outside_tables"])),
        "tables_left_s": tables_left_s,
        "position_error_max_m": _finite_extreme(
            np.max, record["position_error"][(time <= approach.approach_end_s) & (record["phase"] != HOLD)]
        ),
        **(_gust_entries(time, record, scenario, surfaces) if "gust_u" in record else {}),
        "path": None,
        "nominal": None if bend is None else abs(bend) <= NOMINAL_BEND_M,
        "lateral_bend_m": bend,
        "status": approach.status,
    }


def _approach(time: np.ndarray, record: Mapping[str, np.ndarray], planned_s: float) -> Arrival:
    """Return the outcome of one aircraft's approach, from its record."""
    offset = np.stack([record[f"rendezvous_{axis}"] - record[axis] for axis in ("north", "east", "altitude")], axis=-1)
    off_plan = np.flatnonzero(is_off_plan(record["status"]))
    end_index = int(off_plan[0]) if off_plan.size else time.size - 1
    off_plan_s = float(time[end_index]) if off_plan.size else np.inf
    searched = slice(0, max(end_index, 1) + 1)  # at least two samples
    closest_pass = closest_approach(time[searched], offset[searched], planned_s, ARRIVAL_MARGIN_S)
    return arrival_outcome(closest_pass, planned_s, off_plan_s, float(time[-1]), record["status"].tolist())


def _gust_entries(
    time: np.ndarray, record: Mapping[str, np.ndarray], scenario: Scenario, surfaces: Sequence[str]
) -> dict[str, float | None]:
    """Return the effects of gusts: load-factor extremes, time outside its limits, s, travel of each surface, deg."""
    load, limits, intervals = record["load_factor"], scenario.limits, np.diff(time)
    is_exceeded = (load < limits.load_factor_min) | (load > limits.load_factor_max)
    travel = {
        f"{surface}_travel_deg": finite_or_none(float(np.degrees(np.sum(np.abs(np.diff(record[surface]))))))
        for surface in surfaces
    }
    return {
        "gust_max_m_s": _finite_extreme(np.max, np.sqrt(sum(record[f"gust_{axis}"] ** 2 for axis in "uvw"))),
        "load_factor_min": _finite_extreme(np.min, load),
        "load_factor_max": _finite_extreme(np.max, load),
        "load_factor_exceeded_s": float(np.sum(intervals[is_exceeded[:-1]])),
        "surfaces_limited_s": float(np.sum(intervals[record["surfaces_limited"][:-1]])),
        **travel,
    }


def _speed_statistics(
    time: np.ndarray, airspeed: np.ndarray, end: float
) -> tuple[float | None, float | None, float | None]:
    """Return the time mean, minimum and maximum of the airspeed, m/s, from the start to the time `end`, s."""
    times = np.append(time[time < end], end)
    speeds = np.append(airspeed[time < end], np.interp(end, time, airspeed))
    times, speeds = times[np.isfinite(speeds)], speeds[np.isfinite(speeds)]
    if speeds.size == 0:
        return None, None, None
    duration = times[-1] - times[0]
    mean = np.trapezoid(speeds, times) / duration if duration > 0.0 else speeds[0]
    return float(mean), float(np.min(speeds)), float(np.max(speeds))


def _least_separation(history: Mapping[str, np.ndarray]) -> float | None:
    """Return the least distance between two aircraft over the record, m; None for a single aircraft."""
    position = np.stack([history["north"], history["east"], history["altitude"]], axis=-1)
    # One aircraft at a time: the memory of all pairs would grow with the square of the fleet.
    pairs = [least_distance(position[:, i + 1 :] - position[:, i : i + 1]) for i in range(position.shape[1] - 1)]
    return _finite_extreme(np.min, np.concatenate(pairs)) if pairs else None


def _finite_extreme(extreme: Callable[[np.ndarray], Any], values: np.ndarray) -> float | None:
    """Return the minimum or maximum of the finite values, by `extreme` (`np.min`, `np.max`); None without any."""
    finite = values[np.isfinite(values)]
    return float(extreme(finite)) if finite.size else None
