"""Random fleets with an event in flight: whether the other aircraft replan, arrive by the rule and stay separated.

``python -m trials.lost_aircraft --seeds 0:500 --out build/lost-aircraft.jsonl``

Seeds already in the file are skipped.

Each fleet is flown to the end. If the remaining aircraft miss the arrival rule, the independent checker searches for a
plan from their state at the event, by another method: it may prove the refusal, find nothing, or contradict it.
"""

import argparse
import json
import math
import time
from collections import Counter
from pathlib import Path
from typing import Any

import jax
import numpy as np

from anser.compiling import enable_compilation_cache
from anser.config import ScenarioError
from anser.missions import FlightResult, NoPlanError, plan, run
from anser.missions.first_plan import CertifiedFirstPlan
from anser.planning import TimedPath
from anser.scenario import Scenario, loads
from anser.scenario.schema_airspace import Event
from trials.data import ArrivalRule, FleetLimits, Goals, KeepOutCylinders, PlanCase, Starts, WindProfile
from trials.search import second_search

_BOX_M, _APART_M, _DURATION_S, _LATEST_S = 13_000.0, 300.0, 255.0, 254.0
_HOLD_S = 30.0  # time to go below which no aircraft is replanned: more than `freeze_s` and the planner's committed time
_WARNING_S = 20.0  # least flight time to a keep-out that appears: a closer aircraft could not avoid it
_KINDS = {
    "aircraft-leaves": 0.45,
    "thrust-lost": 0.15,
    "goal-sensor-lost": 0.1,
    "goal-stops": 0.06,
    "goal-turns": 0.08,
    "keep-out-appears": 0.08,
    "arrival-put-off": 0.08,
}
_ITERATIONS = 3000  # of the checker's solver
_REDRAWN = 40


def size_of(seed: int) -> int:
    """Number of aircraft of a seed, 3 to 8."""
    return int(np.random.default_rng([22, seed]).integers(3, 9))


def random_text(count: int, rng: np.random.Generator) -> str:
    """A random fleet, separated at the start and at the arrivals, without an event."""
    starts, goals = _places(rng, count, _BOX_M, 1500.0), _places(rng, count, 0.35 * _BOX_M, 1000.0)
    rule = rng.choice(["together", "sequence", "at"], p=[0.6, 0.3, 0.1])
    spacing_s = float(np.round(rng.uniform(5.0, 15.0), 1))
    arrival = {
        "together": 'rule = "together"',
        "sequence": f'rule = "sequence"\nspacing_s = {spacing_s}',
        "at": f'rule = "at"\ntime_s = {np.round(rng.uniform(140.0, 180.0), 1)}',
    }[str(rule)]
    wind, course = rng.uniform(0.0, 10.0), rng.uniform(0.0, 360.0)
    parts = [
        f'format = 2\nname = "lost-aircraft"\n[timing]\nduration_s = {_DURATION_S}\n'
        f"freeze_s = 4.0\n[fleet]\nspeed_m_s = 150.0\n[arrival]\n{arrival}\n[wind]\nspeed_m_s = {wind:.2f}\n"
        f"from_deg = {course:.1f}\n[limits]\nbank_max_deg = 60.0\n[separation]\nhorizontal_m = {_APART_M}\n"
        "vertical_m = 150.0\n"
    ]
    for k, (start, goal) in enumerate(zip(starts, goals, strict=True)):
        moving = rng.random() < 0.6
        speed, drift = (rng.uniform(3.0, 20.0), rng.uniform(0.0, 360.0)) if moving else (0.0, 0.0)
        level = 500.0 + 250.0 * k
        parts.append(
            f'[[aircraft]]\nname = "aircraft-{k + 1}"\ngoal = "goal-{k + 1}"\n'
            f"start = {{ north_m = {start[0]:.1f}, east_m = {start[1]:.1f}, altitude_m = {rng.uniform(900, 2800):.1f}, "
            f"speed_m_s = {rng.uniform(140, 165):.1f}, course_deg = {rng.uniform(0, 360):.1f} }}\n"
            f"rendezvous = {{ stand_off_up_m = {level:.1f} }}\n"
            f'[[goal]]\nname = "goal-{k + 1}"\nkind = "surface"\nnorth_m = {goal[0]:.1f}\neast_m = {goal[1]:.1f}\n'
            f"speed_m_s = {speed:.2f}\ncourse_deg = {drift:.1f}\n"
        )
    return "".join(parts)


def _places(rng: np.random.Generator, count: int, size_m: float, spacing_m: float) -> np.ndarray:
    positions: list[np.ndarray] = []
    while len(positions) < count:
        candidate = rng.uniform(-size_m, size_m, 2)
        if all(np.hypot(*(candidate - position)) > spacing_m for position in positions):
            positions.append(candidate)
    return np.array(positions)


def random_event(rng: np.random.Generator, planned: CertifiedFirstPlan) -> str | None:
    """An event at a random time before the first arrival; None if the drawn keep-out cannot be avoided."""
    names = [aircraft.name for aircraft in planned.scenario.aircraft]
    arrivals = np.asarray(planned.plan.arrival_times)
    kind = str(rng.choice(list(_KINDS), p=list(_KINDS.values())))
    at_s = round(float(rng.uniform(5.0, max(arrivals.min() - _HOLD_S, 10.0))), 1)
    index = int(rng.integers(len(names)))
    text = f'[[event]]\ntime_s = {at_s}\nkind = "{kind}"\n'
    if kind in ("aircraft-leaves", "thrust-lost", "goal-sensor-lost"):
        text += f'aircraft = "{names[index]}"\n'
    if kind == "aircraft-leaves" and rng.random() < 0.3:
        text += 'goal_taken_over_by = "nearest"\n'
    if kind == "thrust-lost":
        text += f"thrust_left = {rng.uniform(0.3, 0.8):.2f}\n"
    if kind in ("goal-stops", "goal-turns"):
        text += f'goal = "goal-{index + 1}"\n'
    if kind == "goal-turns":
        text += f"course_deg = {rng.uniform(0, 360):.1f}\n"
    if kind == "arrival-put-off":
        text += f"later_s = {rng.uniform(5, 30):.1f}\n"
    if kind == "keep-out-appears":
        radius_m = float(rng.uniform(300, 900))
        position = _ahead(planned, index, at_s, radius_m)
        if position is None:
            return None
        text += (
            f'keep_out = {{ name = "storm", north_m = {position[0]:.1f}, east_m = {position[1]:.1f}, '
            f"radius_m = {radius_m:.0f} }}\n"
        )
    return text


def _ahead(planned: CertifiedFirstPlan, index: int, at_s: float, radius_m: float) -> np.ndarray | None:
    """Position on the way of an aircraft, halfway to its arrival; None if another aircraft is already close to it."""
    paths, arrivals = planned.plan.paths, np.asarray(planned.plan.arrival_times)
    positions_at = jax.vmap(TimedPath.position_n, in_axes=(0, None))
    position = np.asarray(positions_at(paths, at_s + max(_WARNING_S, 0.5 * (arrivals[index] - at_s))))[index, :2]
    distances = np.hypot(*(np.asarray(positions_at(paths, at_s))[:, :2] - position).T)
    is_close = distances < radius_m + _WARNING_S * np.asarray(planned.tasks.limits.speed_min)
    return None if is_close.any() else position


def judged(scenario: Scenario, event: Event, flown: FlightResult) -> str:
    """The independent checker's verdict on a refusal: "proved", "not found" or "found".

    The checker plans the replannable aircraft, from their state at the event, with the planner's limits. The only other
    aircraft in its task is the departed one, as a cylinder with its final motion: the checker's plan may be infeasible.
    """
    planned, now_s = flown.planned, event.time_s
    assert isinstance(planned, CertifiedFirstPlan)
    data = flown.dataset
    names = [aircraft.name for aircraft in scenario.aircraft]
    arrivals = np.asarray(planned.plan.arrival_times)
    time_index = int(np.searchsorted(data["time"].values, now_s))

    def series(kind: str) -> np.ndarray:
        return np.stack([data[f"{kind}{axis}"].values for axis in ("north_m_s", "east_m_s", "down_m_s")], axis=-1)

    positions = np.stack([data["north_m"].values, data["east_m"].values, -data["altitude_m"].values], axis=-1)
    velocities, goal_v = series("velocity_"), series("goal_velocity_")
    goals_n = np.stack(
        [data["goal_north_m"].values, data["goal_east_m"].values, -data["goal_altitude_m"].values], axis=-1
    )
    replanned = [
        k
        for k, name in enumerate(names)
        if arrivals[k] - now_s > 15.0 and not (event.kind == "aircraft-leaves" and name == event.aircraft)
    ]
    step = float(data["time"].values[1] - data["time"].values[0])
    accelerations = np.gradient(velocities[time_index - 2 : time_index + 3], step, axis=0)[2]
    limits = {
        name: np.asarray(getattr(planned.tasks.limits, name))[replanned].copy()
        for name in FleetLimits.__dataclass_fields__
    }
    if event.kind == "thrust-lost" and names.index(str(event.aircraft)) in replanned:
        index, thrust_fraction = replanned.index(names.index(str(event.aircraft))), event.thrust_left or 0.0
        thrust_range = limits["acceleration_max"][index] + limits["deceleration_max"][index]
        limits["acceleration_max"][index] = thrust_fraction * thrust_range - limits["deceleration_max"][index]
    stand_off = np.array([_ned(scenario.aircraft[k].rendezvous.stand_off_m) for k in replanned])
    unprescribed = np.full(len(replanned), np.nan)
    rule = scenario.arrival.rule
    times = arrivals[replanned] + (event.later_s or 0.0)
    order = np.argsort(times)
    is_evenly_spaced = np.allclose(np.diff(times[order]), scenario.arrival.spacing_s or 0.0)
    name = {"together": "together", "at": "at", "sequence": "sequence" if is_evenly_spaced else "times"}[rule]
    profile = scenario.wind.profile_m_s
    winds = np.array([_ned(velocity) for _, velocity in profile])
    case = PlanCase(
        Starts(now_s, positions[time_index, replanned], velocities[time_index, replanned], accelerations[replanned]),
        Goals(
            np.full((len(replanned), 1), now_s),
            goals_n[time_index, replanned][:, None],
            goal_v[time_index, replanned],
            stand_off,
            unprescribed,
            unprescribed,
        ),
        FleetLimits(**limits),
        WindProfile(np.array([altitude for altitude, _ in profile]), winds),
        _cylinders(scenario, event, data, names),
        scenario.separation.horizontal_m,
        scenario.separation.vertical_m,
        ArrivalRule(name, times, np.full((len(replanned), 2), np.nan), scenario.arrival.spacing_s or math.nan, order),
        scenario.fleet.airspeed_m_s,
        9.80665,
    )
    return second_search(case, _ITERATIONS, horizon=_LATEST_S).status


def _ned(up: Any) -> np.ndarray:
    return np.array([up[0], up[1], -up[2]])


def _cylinders(scenario: Scenario, event: Event, data: Any, names: list[str]) -> KeepOutCylinders:
    cylinders = []
    if event.kind == "keep-out-appears" and event.keep_out is not None:
        keep_out = event.keep_out
        cylinders.append(
            (keep_out.north_m, keep_out.east_m, 0.0, 0.0, keep_out.radius_m, keep_out.bottom_m, keep_out.top_m)
        )
    if event.kind == "aircraft-leaves":
        k = names.index(str(event.aircraft))
        time_index = int(np.searchsorted(data["time"].values, min(event.time_s + 40.0, float(data["time"].values[-1]))))
        t = float(data["time"].values[time_index])
        velocity = [float(data[f"velocity_{axis}_m_s"].values[time_index, k]) for axis in ("north", "east")]
        origin = [
            float(data[f"{axis}_m"].values[time_index, k]) - t * v
            for axis, v in zip(("north", "east"), velocity, strict=True)
        ]
        level = float(data["altitude_m"].values[time_index, k])
        separation = scenario.separation
        cylinders.append(
            (*origin, *velocity, separation.horizontal_m, level - separation.vertical_m, level + separation.vertical_m)
        )
    table = np.reshape(cylinders, (-1, 7))
    return KeepOutCylinders(table[:, :2], table[:, 2:4], table[:, 4], table[:, 5], table[:, 6])


def run_seed(seed: int) -> dict[str, Any]:
    """Draw a fleet with a plan, fly it with its event, and assess the result."""
    rng = np.random.default_rng([23, seed])
    start_time, redrawn = time.perf_counter(), 0
    while True:
        text = random_text(size_of(seed), rng)
        try:
            planned = plan(loads(text))
        except ScenarioError as error:
            planned, reason = None, str(error)
        else:
            reason = "no plan"
        if planned is not None and not planned.problems():
            break
        redrawn += 1
        if redrawn > _REDRAWN:
            raise RuntimeError(f"seed {seed}: no fleet of {_REDRAWN} has a plan, the last: {reason}")
    assert isinstance(planned, CertifiedFirstPlan)
    drawn_s = time.perf_counter() - start_time
    for _ in range(_REDRAWN):
        text_of_event = random_event(rng, planned)
        if text_of_event is None:
            reason = "somebody is too close to a keep-out that appears"
            continue
        try:
            scenario = loads(text + text_of_event)
            break
        except ScenarioError as error:
            reason = str(error)
    else:
        raise RuntimeError(f"seed {seed}: no event is accepted, the last: {reason}")
    event = scenario.event[0]
    result: dict[str, Any] = {"seed": seed, "size": len(scenario.aircraft), "rule": scenario.arrival.rule}
    result |= {
        "kind": event.kind,
        "time_s": event.time_s,
        "first_s": float(np.asarray(planned.plan.arrival_times).min()),
    }
    start_time = time.perf_counter()
    try:
        flight = run(scenario)
    except NoPlanError as error:
        return result | {"status": f"no plan with the event's tables: {error}"}
    events, fleet = flight.summary["events"], flight.summary["fleet"]
    result |= {
        "redrawn": redrawn,
        "drawn_s": drawn_s,
        "run_s": time.perf_counter() - start_time,
        "planned": all(entry["planned"] for entry in events if entry["kind"] == event.kind),
        "messages": [f"{entry['kind']}: {entry['message']}" for entry in events],
        "met": flight.met,
        "unmet": [entry["name"] for entry in flight.summary["requirements"] if not entry["met"]],
        "statuses": sorted({entry["status"] for entry in flight.summary["aircraft"]}),
        "separation_ratio": fleet["separation_ratio_min"],
        "spread_s": fleet["arrival_spread_s"],
        "miss_m": [entry["miss_m"] for entry in flight.summary["aircraft"]],
        "late_s": [
            None if entry["arrival_s"] is None else entry["arrival_s"] - entry["planned_arrival_s"]
            for entry in flight.summary["aircraft"]
        ],
        "position_error_m": max(entry["position_error_max_m"] for entry in flight.summary["aircraft"]),
    }
    if not (result["planned"] and result["met"]):
        start_time = time.perf_counter()
        result |= {"judge": judged(scenario, event, flight), "judge_s": time.perf_counter() - start_time}
    return result


def tally(results: list[dict[str, Any]]) -> list[str]:
    """Summary of the results, in lines."""
    lines = [f"{len(results)} fleets, {sum(result['size'] for result in results)} aircraft"]
    successes = [result for result in results if result.get("planned") and result.get("met")]
    lines.append(f"planned on and arrived by the rule: {len(successes)} ({100 * len(successes) / len(results):.1f} %)")
    for kind in _KINDS:
        of_kind = [result for result in results if result["kind"] == kind]
        kind_successes = [result for result in of_kind if result in successes]
        lines.append(f"  {kind}: {len(kind_successes)} of {len(of_kind)}")
    verdicts = dict(Counter(result["judge"] for result in results if "judge" in result))
    lines.append(f"verdicts of the independent checker on the others: {verdicts}")
    ratios = [result["separation_ratio"] for result in results if result.get("separation_ratio") is not None]
    lines.append(f"least separation ratio {min(ratios):.4f}, below 1: {sum(ratio < 1.0 for ratio in ratios)}")
    for result in results:
        if result not in successes:
            lines.append(f"  seed {result['seed']}: {json.dumps({k: v for k, v in result.items() if k != 'seed'})}")
    return lines


def main() -> None:
    """Command line; continues an existing file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0:500")
    parser.add_argument(
        "--sizes", default="3:9", help="only fleets of so many aircraft; seeds of others are passed over"
    )
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    start, stop = map(int, options.seeds.split(":"))
    enable_compilation_cache()
    results = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    completed = {result["seed"] for result in results}
    size_min, size_max = map(int, options.sizes.split(":"))
    for seed in range(start, stop):
        if seed not in completed and size_min <= size_of(seed) < size_max:
            results.append(run_seed(seed))
            with options.out.open("a") as file:
                file.write(json.dumps(results[-1]) + "\n")
            print(  # noqa: T201
                f"seed {seed}: {results[-1]['kind']}, {results[-1].get('messages')}, met {results[-1].get('met')}",
                flush=True,
            )
    for line in tally(results):
        print(line)  # noqa: T201


if __name__ == "__main__":
    main()
