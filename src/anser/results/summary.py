"""The machine-readable summary of a flight, format version 1."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from anser.results.arrival import closest_approach, least_distance
from anser.results.path_words import NOMINAL_BEND_M
from anser.results.provenance import versions
from anser.results.requirements import Requirement, judge
from anser.results.separated import least_ratio

__all__ = ["FORMAT_VERSION", "FlightFacts", "read_summary", "summarize", "write_summary"]

FORMAT_VERSION = 1

_ARRIVED = "arrived"
_STILL_CLOSING = "not arrived: still closing on the rendezvous when the search for the arrival ended"
_NO_RECORD = "not arrived: no finite position in the record"


@dataclass(frozen=True)
class FlightFacts:
    """What a summary must know of the scenario and the plan; one entry per aircraft, in the order of the history.

    Attributes
    ----------
    scenario_name, scenario_hash, seed
        Identity of the scenario; the seed is None where nothing is random.
    aircraft_names, goal_names
        Names of the aircraft and of the goals that they meet.
    goal_kinds
        Kinds of these goals, one word each: "surface", "airborne".
    planned_arrivals_s
        Planned arrival times, s; None for an aircraft without a plan.
    minimum_clearances_m
        Least distance that each aircraft must keep from its goal, m.
    requirements
        What the scenario asks of the flight besides these clearances.
    status_messages
        Message of each status code other than 0.
    arrival_margin_s
        How long after its planned arrival an aircraft may still arrive, s.
    separation_m
        Horizontal and vertical separation that is asked for, m; None where none is asked.
    paths
        How the path of each goes in the first plan, in words; empty where nobody tells.
    """

    scenario_name: str
    scenario_hash: str
    seed: int | None
    aircraft_names: tuple[str, ...]
    goal_names: tuple[str, ...]
    goal_kinds: tuple[str, ...]
    planned_arrivals_s: tuple[float | None, ...]
    minimum_clearances_m: tuple[float, ...]
    requirements: tuple[Requirement, ...] = ()
    status_messages: Mapping[int, str] = field(default_factory=dict)
    arrival_margin_s: float = 10.0
    separation_m: tuple[float, float] | None = None
    paths: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        rows = {
            "goal_names": self.goal_names,
            "goal_kinds": self.goal_kinds,
            "planned_arrivals_s": self.planned_arrivals_s,
            "minimum_clearances_m": self.minimum_clearances_m,
            **({"paths": self.paths} if self.paths else {}),
        }
        for name, row in rows.items():
            if len(row) != len(self.aircraft_names):
                raise ValueError(f"{name} has {len(row)} entries for {len(self.aircraft_names)} aircraft")


def summarize(
    time_s: np.ndarray, history: Mapping[str, np.ndarray], facts: FlightFacts, wall_s: float
) -> dict[str, Any]:
    """Sum up a flight from its full-resolution history.

    Speeds and position error count up to the arrival; clearance, separation and the time outside the aerodynamic tables
    over the whole record. Path and lateral bend are those of the first plan, which describes the whole path;
    `nominal` says whether it goes without a bend. Only paths of the published planner have such a bend: of others
    `lateral_bend_m` and `nominal` are None. What does not exist is None, never NaN.

    Parameters
    ----------
    time_s
        Times of the record, s, increasing; shape (time,), at least two.
    history
        Arrays of shape (time, aircraft) in SI units and radians, keyed as in `anser.variables`.
    facts
        What the scenario and the plan say.
    wall_s
        How long the computation took, s.

    Returns
    -------
    dict
        The contract of `summary.json`: plain numbers, text, lists and dicts.

    Raises
    ------
    ValueError
        The record does not fit the facts, or a requirement is unknown.
    """
    time = np.asarray(time_s, dtype=np.float64)
    expected = (time.size, len(facts.aircraft_names))
    if time.size < 2 or history["north"].shape != expected:
        raise ValueError(
            f"the record has shape {history['north'].shape}; time (at least 2) and aircraft give {expected}"
        )
    aircraft = [_aircraft(time, history, facts, column) for column in range(len(facts.aircraft_names))]
    arrivals = [row["arrival_s"] for row in aircraft]
    fleet: dict[str, float | None] = {
        "arrival_spread_s": None if None in arrivals else max(arrivals) - min(arrivals),
        "separation_min_m": _least_separation(history),
        "wall_s": _number(wall_s),
        "simulated_s": _number(time[-1] - time[0]),
    }
    if facts.separation_m is not None:
        fleet["separation_ratio_min"] = least_ratio(history, facts.separation_m)
    return {
        "format_version": FORMAT_VERSION,
        "scenario": {"name": facts.scenario_name, "hash": facts.scenario_hash},
        "versions": versions(),
        "seed": facts.seed,
        "aircraft": aircraft,
        "fleet": fleet,
        "requirements": judge(
            facts.requirements, aircraft, fleet, tuple(zip(facts.goal_kinds, facts.minimum_clearances_m, strict=True))
        ),
    }


def write_summary(summary: Mapping[str, Any], path: Path) -> None:
    """Write a summary as JSON.

    Raises
    ------
    FileExistsError
        `path` exists: a summary is never overwritten.
    ValueError
        The summary holds a number that JSON has not (NaN, infinity).
    """
    text = json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    if path.exists():
        raise FileExistsError(f"{path} exists; a summary is not overwritten: choose another folder")
    with path.open("x", encoding="utf-8") as file:
        file.write(text)


def read_summary(path: Path) -> dict[str, Any]:
    """Read a summary that `write_summary` wrote.

    Raises
    ------
    ValueError
        The file is not a summary of this format version.
    """
    summary = json.loads(path.read_text(encoding="utf-8"))
    found = summary.get("format_version") if isinstance(summary, dict) else None
    if found != FORMAT_VERSION:
        raise ValueError(f"{path} has format_version {found!r}; this version of anser reads {FORMAT_VERSION}")
    return summary


def _aircraft(time: np.ndarray, history: Mapping[str, np.ndarray], facts: FlightFacts, column: int) -> dict[str, Any]:
    record = {key: np.asarray(values)[:, column] for key, values in history.items()}
    planned = facts.planned_arrivals_s[column]
    offset = np.stack([record[f"rendezvous_{axis}"] - record[axis] for axis in ("north", "east", "altitude")], axis=-1)
    arrival, miss = closest_approach(time, offset, planned, facts.arrival_margin_s)
    mean, least, greatest = _speed_until(time, record["airspeed"], arrival)
    bends = record["lateral_bend"][np.isfinite(record["lateral_bend"])]
    bend = float(bends[0]) if bends.size else None
    tables_left_s = float(np.sum(np.diff(time)[record["outside_tables"][:-1]]))
    search_end = time[-1] if planned is None else min(time[-1], planned + facts.arrival_margin_s)
    return {
        "name": facts.aircraft_names[column],
        "goal": facts.goal_names[column],
        "planned_arrival_s": _number(planned),
        "arrival_s": _number(arrival),
        "miss_m": _number(miss),
        "speed_mean_m_s": mean,
        "speed_min_m_s": least,
        "speed_max_m_s": greatest,
        "clearance_min_m": _least(record["clearance"]),
        "tables_left": bool(np.any(record["outside_tables"])),
        "tables_left_s": tables_left_s,
        "position_error_max_m": _greatest(
            record["position_error"][time <= (arrival if np.isfinite(arrival) else np.inf)]
        ),
        "path": facts.paths[column] if facts.paths else None,
        "nominal": None if bend is None else abs(bend) <= NOMINAL_BEND_M,
        "lateral_bend_m": bend,
        "status": _status(record["status"], facts.status_messages, arrival, search_end),
    }


def _status(codes: np.ndarray, messages: Mapping[int, str], arrival: float, search_end: float) -> str:
    failed = codes[codes != 0]
    if failed.size:
        # The first one is the cause of those that follow; the last one is how it ended.
        ends = dict.fromkeys((int(failed[0]), int(failed[-1])))
        return "; then ".join(messages.get(code, f"status {code}, which has no message") for code in ends)
    if not np.isfinite(arrival):
        return _NO_RECORD
    return _ARRIVED if arrival < search_end else _STILL_CLOSING


def _speed_until(
    time: np.ndarray, airspeed: np.ndarray, arrival: float
) -> tuple[float | None, float | None, float | None]:
    """Mean over time, least and greatest airspeed from the start to the arrival, or to the end without one."""
    end = arrival if np.isfinite(arrival) else time[-1]
    times = np.append(time[time < end], end)
    speeds = np.append(airspeed[time < end], np.interp(end, time, airspeed))
    times, speeds = times[np.isfinite(speeds)], speeds[np.isfinite(speeds)]
    if speeds.size == 0:
        return None, None, None
    duration = times[-1] - times[0]
    mean = np.trapezoid(speeds, times) / duration if duration > 0.0 else speeds[0]
    return float(mean), float(np.min(speeds)), float(np.max(speeds))


def _least_separation(history: Mapping[str, np.ndarray]) -> float | None:
    position = np.stack([history["north"], history["east"], history["altitude"]], axis=-1)
    # One aircraft against all after it: the memory of all pairs at once would grow with the square of the fleet.
    pairs = [least_distance(position[:, i + 1 :] - position[:, i : i + 1]) for i in range(position.shape[1] - 1)]
    return _least(np.concatenate(pairs)) if pairs else None


def _least(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.min(finite)) if finite.size else None


def _greatest(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.max(finite)) if finite.size else None


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None
