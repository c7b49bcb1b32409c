"""Machine-readable summary of a flight (`summary.json`, format version 1): computation, files, check of the keys."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from anser.files import write_file
from anser.planning.limits import NOMINAL_BEND_M
from anser.results.arrival import closest_approach, summarize_arrivals
from anser.results.checksums import add_checksum, damaged_file_error, read_document
from anser.results.documents import finite_or_none, software_versions
from anser.results.faults import find_fault
from anser.results.flight_rows import build_flight_row, goals_over_time
from anser.results.separation import least_keep_out_room, least_separation, minimum_separation_ratio
from anser.scenario.schema import Scenario
from anser.simulation.closed_loop import HOLD, LEFT_FLEET, is_off_plan
from anser.simulation.fleet_summary import ARRIVAL_MARGIN_S, AirspeedStatistics, FleetSummary
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
    """Return (what arrived, what is expected) for the first missing or invalid key of a summary; None if valid."""
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

    - `arrival_outcome` decides on arrivals.
    - Speeds (without gusts) and position error are taken up to the arrival or, if the aircraft does not arrive, as long
      as the plan is flown. The position error is not taken in the hold.
    - Clearance, separation, keep-outs and the time outside the aerodynamic tables are taken over the whole record; the
      keep-out of an event is taken after the event.
    - `path`, `lateral_bend_m` (sideways offset that lengthens the path) and `nominal` (True: no such offset) describe
      the first plan. `lateral_bend_m` and `nominal` are None unless the planner is the published planner.
    - `fault`, in a flight with an adaptive autopilot, is the detected fault of an aircraft.

    Missing values are None, never NaN.

    Parameters
    ----------
    time_s
        Times of the record, s, increasing; shape (time,), at least two.
    history
        Arrays (time, aircraft) in SI units and radians, by key of `anser.variables`.
    wall_s
        Duration of the computation by the wall clock, s.
    paths
        Description of each aircraft's path in the first plan; empty: unknown.
    events
        Entries of the list `events`: events of the flight and their effects on the plan.
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
        If the shape of the record, or the number of entries in `surfaces`, does not match the scenario.
    """
    time = np.asarray(time_s, dtype=np.float64)
    expected = (time.size, len(scenario.aircraft))
    if time.size < 2 or history["north"].shape != expected:
        raise ValueError(
            f"the record has shape {history['north'].shape}; time (at least 2) and aircraft give {expected}"
        )
    if surfaces and len(surfaces) != expected[1]:
        raise ValueError(f"surfaces are those of {len(surfaces)} aircraft; there are {expected[1]}")
    plans = (np.asarray(history[key]).T for key in ("status", "arrival_time"))
    flight_row = build_flight_row(
        _summarize_record(time, history, scenario),
        [_planned_arrival(time, *rows) for rows in zip(*plans, strict=True)],
        scenario,
        float(time[-1]),
        goals,
        _clearances(time, history, scenario, events),
    )
    surface_lists = surfaces or [STANDARD_SURFACES] * len(scenario.aircraft)
    for column, (entry, surface_list) in enumerate(zip(flight_row.aircraft, surface_lists, strict=True)):
        record = {key: np.asarray(values)[:, column] for key, values in history.items()}
        bends = record["lateral_bend"][np.isfinite(record["lateral_bend"])]
        bend = float(bends[0]) if bends.size else None
        entry |= {"tables_left": bool(np.any(record["outside_tables"])), "path": None, "lateral_bend_m": bend}
        entry["nominal"] = None if bend is None else abs(bend) <= NOMINAL_BEND_M
        if "gust_u" in record:
            entry |= _gust_entries(time, record, scenario, surface_list)
        if "fault" in record:
            fault = find_fault(time, record["fault"], record["fault_size"], surface_list)
            entry["fault"] = None if fault is None else fault.as_dict()
    for entry, path in zip(flight_row.aircraft, paths, strict=bool(paths)):
        entry["path"] = path
    return {
        "format_version": FORMAT_VERSION,
        "scenario": {"name": scenario.name, "hash": scenario.hash},
        "versions": software_versions(),
        "seed": scenario.seed,
        "aircraft": flight_row.aircraft,
        "arrival": summarize_arrivals(scenario, flight_row.aircraft),
        "fleet": flight_row.fleet
        | {"wall_s": finite_or_none(wall_s), "simulated_s": finite_or_none(time[-1] - time[0])},
        "requirements": flight_row.requirements,
        **({"events": [dict(event) for event in events]} if events else {}),
    }


def _summarize_record(time: np.ndarray, history: Mapping[str, np.ndarray], scenario: Scenario) -> FleetSummary:
    """Compute from a complete record, arrays (time, aircraft) by key, what `SummaryRecorder` computes in flight."""
    columns = range(history["north"].shape[1])
    aircraft = [_summarize_aircraft(time, {key: values[:, k] for key, values in history.items()}) for k in columns]
    fleet: dict[str, Any] = jax.tree.map(lambda *values: np.array(values), *aircraft)
    fleet["separation_min"] = least_separation(history)
    separation_m = scenario.separation.required_m
    fleet["separation_ratio_min"] = None if separation_m is None else minimum_separation_ratio(history, separation_m)
    fleet["keep_out_room_min"] = least_keep_out_room(time, history, scenario)
    return FleetSummary(**fleet)


def _clearances(
    time: np.ndarray, history: Mapping[str, np.ndarray], scenario: Scenario, events: Sequence[Mapping[str, Any]]
) -> list[tuple[str, float]]:
    """Return the kind of each goal to which an aircraft flew, and the least distance from it in that time, m."""
    assigned = [{"name": aircraft.name, "goal": aircraft.goal} for aircraft in scenario.aircraft]
    kinds, clearances = {goal.name: goal.kind for goal in scenario.goal}, []
    for column, goals in enumerate(goals_over_time({"aircraft": assigned, "events": events}, {"aircraft": assigned})):
        ends_s = [from_s for _, from_s in goals[1:]] + [np.inf]
        for (goal, from_s), end_s in zip(goals, ends_s, strict=True):
            flies_to_it = (time >= from_s) & (time < end_s)
            if flies_to_it.any():
                least = _finite_extreme(np.min, history["clearance"][flies_to_it, column])
                clearances.append((kinds[goal], least))
    return clearances


def _planned_arrival(time: np.ndarray, status: np.ndarray, arrival_s: np.ndarray) -> float:
    """Return the planned arrival time, s, of one aircraft's last plan, from status and planned arrival over time.

    If the aircraft left the fleet after its arrival, the result is the planned arrival at the goal. If the aircraft
    left earlier, the result is the planned time at the end of the path on which the aircraft leaves.
    """
    is_in_hold = (arrival_s <= time) & (np.cumsum(status == LEFT_FLEET) == 0)
    has_left = (status == LEFT_FLEET).any() and is_in_hold.any()
    return float(arrival_s[np.flatnonzero(is_in_hold)[-1] if has_left else -1])


def _summarize_aircraft(time: np.ndarray, record: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Compute the fields of a `FleetSummary` that belong to one aircraft, by name, from the record (SI, rad)."""
    status, off_plan = record["status"], np.flatnonzero(is_off_plan(record["status"]))
    end_index = int(off_plan[0]) if off_plan.size else time.size - 1
    searched = slice(0, max(end_index, 1) + 1)  # at least two samples
    offset = np.stack([record[f"rendezvous_{axis}"] - record[axis] for axis in ("north", "east", "altitude")], axis=-1)
    pass_time, pass_distance = closest_approach(
        time[searched], offset[searched], _planned_arrival(time, status, record["arrival_time"]), ARRIVAL_MARGIN_S
    )
    airspeed = record.get("airspeed_mean_wind", record["airspeed"])
    error = np.where(record["phase"] == HOLD, -np.inf, record["position_error"])
    failures = status[status != 0]
    return {
        "pass_time": pass_time,
        "pass_distance": pass_distance,
        "speeds_until_pass": _speed_statistics(time, airspeed, pass_time),
        "position_error_until_pass": _finite_extreme(np.max, error[time <= pass_time]),
        "speeds_on_plan": _speed_statistics(time, airspeed, float(time[end_index])),
        "position_error_on_plan": _finite_extreme(np.max, error[: end_index + 1]),
        "off_plan_time": float(time[end_index]) if off_plan.size else np.inf,
        "clearance_min": _finite_extreme(np.min, record["clearance"]),
        "tables_left_time": float(np.sum(np.diff(time)[record["outside_tables"][1:]])),
        "first_status": int(failures[0]) if failures.size else 0,
        "last_status": int(failures[-1]) if failures.size else 0,
        "finite": bool(np.isfinite(airspeed).all() and np.isfinite(offset).all()),
    }


def write_summary(summary: Mapping[str, Any], path: Path) -> None:
    """Write a summary to a new JSON file, with a checksum.

    Raises FileExistsError if `path` exists. Raises ValueError if a number is NaN or infinite.
    """
    text = json.dumps(add_checksum(summary), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    write_file(path, text)


def read_summary(path: Path) -> dict[str, Any]:
    """Read and verify a summary that `write_summary` wrote.

    Raises DamagedFileError if the file is damaged, has another format version, or lacks a required key.
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


def _gust_entries(
    time: np.ndarray, record: Mapping[str, np.ndarray], scenario: Scenario, surfaces: Sequence[str]
) -> dict[str, float | None]:
    """Return the entries of a summary on gusts, load factor, limited surfaces and surface travel, by key.

    `record` has the arrays (time,) of one aircraft, by key.
    """
    load, limits, intervals = record["load_factor"], scenario.limits, np.diff(time)
    is_exceeded = (load < limits.load_factor_min) | (load > limits.load_factor_max)
    travel = {
        f"{surface}_travel_deg": finite_or_none(float(np.degrees(np.sum(np.abs(np.diff(record[surface]))))))
        for surface in surfaces
    }
    return {
        "gust_max_m_s": finite_or_none(
            _finite_extreme(np.max, np.sqrt(sum(record[f"gust_{axis}"] ** 2 for axis in "uvw")))
        ),
        "load_factor_min": finite_or_none(_finite_extreme(np.min, load)),
        "load_factor_max": finite_or_none(_finite_extreme(np.max, load)),
        "load_factor_exceeded_s": float(np.sum(intervals[is_exceeded[:-1]])),
        "surfaces_limited_s": float(np.sum(intervals[record["surfaces_limited"][:-1]])),
        **travel,
    }


def _speed_statistics(time: np.ndarray, airspeed: np.ndarray, end: float) -> AirspeedStatistics:
    """Return time integral (m), minimum and maximum (m/s) of the finite airspeeds up to `end`, s; NaN if none."""
    times = np.append(time[time < end], end)
    speeds = np.append(airspeed[time < end], np.interp(end, time, airspeed))
    times, speeds = times[np.isfinite(speeds)], speeds[np.isfinite(speeds)]
    statistics: tuple[Any, ...] = (np.nan, np.nan, np.nan)
    if speeds.size:
        statistics = np.trapezoid(speeds, times), np.min(speeds), np.max(speeds)
    return AirspeedStatistics(*statistics)


def _finite_extreme(extreme: Callable[[np.ndarray], Any], values: np.ndarray) -> float:
    """Return `extreme` (`np.min` or `np.max`) of the finite values; NaN if no value is finite."""
    finite = values[np.isfinite(values)]
    return float(extreme(finite)) if finite.size else np.nan
