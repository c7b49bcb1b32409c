"""Random fleets to which something happens on the way: whether the others plan on, arrive by their rule, keep apart.

``python -m trials.lost_aircraft --seeds 0:500 --out build/lost-aircraft.jsonl``

What is in the file already is not flown again.

Each fleet is flown whole. Where the others did not arrive by their rule, the judge of the planner looks for a plan from
where the aircraft were then, by a method of its own: it may find the refusal proved, find nothing either, or contradict
it.
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
from anser.scenario.schema_event import Event
from trials.data import ArrivalRule, FleetLimits, Goals, KeepOutCylinders, PlanCase, Starts, WindProfile
from trials.search import second_search

_BOX_M, _APART_M, _DURATION_S, _LATEST_S = 13_000.0, 300.0, 255.0, 254.0
_HOLD_S = 30.0  # with less to go than freeze or what is committed, nobody is planned anew
_WARNING_S = 20.0  # of flight, to what appears on the way: nothing is asked of who is already upon it
_KINDS = {
    "aircraft-leaves": 0.45,
    "thrust-lost": 0.15,
    "goal-sensor-lost": 0.1,
    "goal-stops": 0.06,
    "goal-turns": 0.08,
    "keep-out-appears": 0.08,
    "arrival-put-off": 0.08,
}
_ITERATIONS = 3000  # of the judge's solver
_REDRAWN = 40


def size_of(seed: int) -> int:
    """Number of aircraft of a seed, 3 to 8."""
    return int(np.random.default_rng([22, seed]).integers(3, 9))


def random_text(count: int, rng: np.random.Generator) -> str:
    """A random fleet, apart at the start and at the arrivals, without an event."""
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
    for k, (place, goal) in enumerate(zip(starts, goals, strict=True)):
        moving = rng.random() < 0.6
        speed, drift = (rng.uniform(3.0, 20.0), rng.uniform(0.0, 360.0)) if moving else (0.0, 0.0)
        level = 500.0 + 250.0 * k
        parts.append(
            f'[[aircraft]]\nname = "aircraft-{k + 1}"\ngoal = "goal-{k + 1}"\n'
            f"start = {{ north_m = {place[0]:.1f}, east_m = {place[1]:.1f}, altitude_m = {rng.uniform(900, 2800):.1f}, "
            f"speed_m_s = {rng.uniform(140, 165):.1f}, course_deg = {rng.uniform(0, 360):.1f} }}\n"
            f"rendezvous = {{ stand_off_up_m = {level:.1f} }}\n"
            f'[[goal]]\nname = "goal-{k + 1}"\nkind = "surface"\nnorth_m = {goal[0]:.1f}\neast_m = {goal[1]:.1f}\n'
            f"speed_m_s = {speed:.2f}\ncourse_deg = {drift:.1f}\n"
        )
    return "".join(parts)


def _places(rng: np.random.Generator, count: int, size_m: float, apart_m: float) -> np.ndarray:
    found: list[np.ndarray] = []
    while len(found) < count:
        spot = rng.uniform(-size_m, size_m, 2)
        if all(np.hypot(*(spot - other)) > apart_m for other in found):
            found.append(spot)
    return np.array(found)


def random_event(rng: np.random.Generator, planned: CertifiedFirstPlan) -> str | None:
    """An event at a random time while all are on their way; None where what was drawn cannot be planned around."""
    names = [one.name for one in planned.scenario.aircraft]
    arrivals = np.asarray(planned.plan.arrival_times)
    kind = str(rng.choice(list(_KINDS), p=list(_KINDS.values())))
    at_s = round(float(rng.uniform(5.0, max(arrivals.min() - _HOLD_S, 10.0))), 1)
    who = int(rng.integers(len(names)))
    text = f'[[event]]\ntime_s = {at_s}\nkind = "{kind}"\n'
    if kind in ("aircraft-leaves", "thrust-lost", "goal-sensor-lost"):
        text += f'aircraft = "{names[who]}"\n'
    if kind == "aircraft-leaves" and rng.random() < 0.3:
        text += 'goal_taken_over_by = "nearest"\n'
    if kind == "thrust-lost":
        text += f"thrust_left = {rng.uniform(0.3, 0.8):.2f}\n"
    if kind in ("goal-stops", "goal-turns"):
        text += f'goal = "goal-{who + 1}"\n'
    if kind == "goal-turns":
        text += f"course_deg = {rng.uniform(0, 360):.1f}\n"
    if kind == "arrival-put-off":
        text += f"later_s = {rng.uniform(5, 30):.1f}\n"
    if kind == "keep-out-appears":
        radius_m = float(rng.uniform(300, 900))
        spot = _ahead(planned, who, at_s, radius_m)
        if spot is None:
            return None
        text += (
            f'keep_out = {{ name = "storm", north_m = {spot[0]:.1f}, east_m = {spot[1]:.1f}, '
            f"radius_m = {radius_m:.0f} }}\n"
        )
    return text


def _ahead(planned: CertifiedFirstPlan, who: int, at_s: float, radius_m: float) -> np.ndarray | None:
    """Half way from a time to the arrival of one: a place on its way, unless somebody is already close to it."""
    paths, arrivals = planned.plan.paths, np.asarray(planned.plan.arrival_times)
    each = jax.vmap(TimedPath.position_n, in_axes=(0, None))
    spot = np.asarray(each(paths, at_s + max(_WARNING_S, 0.5 * (arrivals[who] - at_s))))[who, :2]
    apart = np.hypot(*(np.asarray(each(paths, at_s))[:, :2] - spot).T)
    near = apart < radius_m + _WARNING_S * np.asarray(planned.tasks.limits.speed_min)
    return None if near.any() else spot


def judged(scenario: Scenario, event: Event, flown: FlightResult) -> str:
    """What the judge's search says to a refusal: "proved", "not found" or "found".

    It plans those that could be planned anew, from where they were, with the limits that the planner had. Of all others
    it knows only the one that has left, as a cylinder that moves as it does at last: so it may find what is none.
    """
    planned, now_s = flown.planned, event.time_s
    assert isinstance(planned, CertifiedFirstPlan)
    data = flown.dataset
    names = [one.name for one in scenario.aircraft]
    arrivals = np.asarray(planned.plan.arrival_times)
    at = int(np.searchsorted(data["time"].values, now_s))

    def series(kind: str) -> np.ndarray:
        return np.stack([data[f"{kind}{axis}"].values for axis in ("north_m_s", "east_m_s", "down_m_s")], axis=-1)

    places = np.stack([data["north_m"].values, data["east_m"].values, -data["altitude_m"].values], axis=-1)
    velocities, goal_v = series("velocity_"), series("goal_velocity_")
    goals_n = np.stack(
        [data["goal_north_m"].values, data["goal_east_m"].values, -data["goal_altitude_m"].values], axis=-1
    )
    free = [
        k
        for k, name in enumerate(names)
        if arrivals[k] - now_s > 15.0 and not (event.kind == "aircraft-leaves" and name == event.aircraft)
    ]
    step = float(data["time"].values[1] - data["time"].values[0])
    accelerations = np.gradient(velocities[at - 2 : at + 3], step, axis=0)[2]
    limits = {
        name: np.asarray(getattr(planned.tasks.limits, name))[free].copy() for name in FleetLimits.__dataclass_fields__
    }
    if event.kind == "thrust-lost" and names.index(str(event.aircraft)) in free:
        row, left = free.index(names.index(str(event.aircraft))), event.thrust_left or 0.0
        both = limits["acceleration_max"][row] + limits["deceleration_max"][row]
        limits["acceleration_max"][row] = left * both - limits["deceleration_max"][row]
    stand_off = np.array([_ned(scenario.aircraft[k].rendezvous.stand_off_m) for k in free])
    none = np.full(len(free), np.nan)
    rule = scenario.arrival.rule
    times = arrivals[free] + (event.later_s or 0.0)
    order = np.argsort(times)
    even = np.allclose(np.diff(times[order]), scenario.arrival.spacing_s or 0.0)
    name = {"together": "together", "at": "at", "sequence": "sequence" if even else "times"}[rule]
    profile = scenario.wind.profile_m_s
    winds = np.array([_ned(velocity) for _, velocity in profile])
    case = PlanCase(
        Starts(now_s, places[at, free], velocities[at, free], accelerations[free]),
        Goals(
            np.full((len(free), 1), now_s),
            goals_n[at, free][:, None],
            goal_v[at, free],
            stand_off,
            none,
            none,
        ),
        FleetLimits(**limits),
        WindProfile(np.array([altitude for altitude, _ in profile]), winds),
        _cylinders(scenario, event, data, names),
        scenario.separation.horizontal_m,
        scenario.separation.vertical_m,
        ArrivalRule(name, times, np.full((len(free), 2), np.nan), scenario.arrival.spacing_s or math.nan, order),
        scenario.fleet.speed_m_s,
        9.80665,
    )
    return second_search(case, _ITERATIONS, horizon=_LATEST_S).status


def _ned(up: Any) -> np.ndarray:
    return np.array([up[0], up[1], -up[2]])


def _cylinders(scenario: Scenario, event: Event, data: Any, names: list[str]) -> KeepOutCylinders:
    rows = []
    if event.kind == "keep-out-appears" and event.keep_out is not None:
        out = event.keep_out
        rows.append((out.north_m, out.east_m, 0.0, 0.0, out.radius_m, out.bottom_m, out.top_m))
    if event.kind == "aircraft-leaves":
        k = names.index(str(event.aircraft))
        at = int(np.searchsorted(data["time"].values, min(event.time_s + 40.0, float(data["time"].values[-1]))))
        t = float(data["time"].values[at])
        velocity = [float(data[f"velocity_{axis}_m_s"].values[at, k]) for axis in ("north", "east")]
        place = [
            float(data[f"{axis}_m"].values[at, k]) - t * v for axis, v in zip(("north", "east"), velocity, strict=True)
        ]
        level = float(data["altitude_m"].values[at, k])
        apart = scenario.separation
        rows.append((*place, *velocity, apart.horizontal_m, level - apart.vertical_m, level + apart.vertical_m))
    table = np.reshape(rows, (-1, 7))
    return KeepOutCylinders(table[:, :2], table[:, 2:4], table[:, 4], table[:, 5], table[:, 6])


def run_seed(seed: int) -> dict[str, Any]:
    """Draw a fleet that has a plan, fly it with its event, and judge what came of it."""
    rng = np.random.default_rng([23, seed])
    began, redrawn = time.perf_counter(), 0
    while True:
        text = random_text(size_of(seed), rng)
        try:
            planned = plan(loads(text))
        except ScenarioError as error:
            planned, why = None, str(error)
        else:
            why = "no plan"
        if planned is not None and not planned.problems():
            break
        redrawn += 1
        if redrawn > _REDRAWN:
            raise RuntimeError(f"seed {seed}: no fleet of {_REDRAWN} has a plan, the last: {why}")
    assert isinstance(planned, CertifiedFirstPlan)
    drawn_s = time.perf_counter() - began
    for _ in range(_REDRAWN):
        text_of_event = random_event(rng, planned)
        if text_of_event is None:
            why = "somebody is too close to a keep-out that appears"
            continue
        try:
            scenario = loads(text + text_of_event)
            break
        except ScenarioError as error:
            why = str(error)
    else:
        raise RuntimeError(f"seed {seed}: no event is accepted, the last: {why}")
    event = scenario.event[0]
    row: dict[str, Any] = {"seed": seed, "size": len(scenario.aircraft), "rule": scenario.arrival.rule}
    row |= {"kind": event.kind, "time_s": event.time_s, "first_s": float(np.asarray(planned.plan.arrival_times).min())}
    began = time.perf_counter()
    try:
        flown = run(scenario)
    except NoPlanError as error:
        return row | {"status": f"no plan with the event's tables: {error}"}
    told, fleet = flown.summary["events"], flown.summary["fleet"]
    row |= {
        "redrawn": redrawn,
        "drawn_s": drawn_s,
        "run_s": time.perf_counter() - began,
        "planned": all(one["planned"] for one in told if one["kind"] == event.kind),
        "messages": [f"{one['kind']}: {one['message']}" for one in told],
        "met": flown.met,
        "unmet": [one["name"] for one in flown.summary["requirements"] if not one["met"]],
        "statuses": sorted({one["status"] for one in flown.summary["aircraft"]}),
        "separation_ratio": fleet["separation_ratio_min"],
        "spread_s": fleet["arrival_spread_s"],
        "miss_m": [one["miss_m"] for one in flown.summary["aircraft"]],
        "late_s": [
            None if one["arrival_s"] is None else one["arrival_s"] - one["planned_arrival_s"]
            for one in flown.summary["aircraft"]
        ],
        "position_error_m": max(one["position_error_max_m"] for one in flown.summary["aircraft"]),
    }
    if not (row["planned"] and row["met"]):
        began = time.perf_counter()
        row |= {"judge": judged(scenario, event, flown), "judge_s": time.perf_counter() - began}
    return row


def tally(rows: list[dict[str, Any]]) -> list[str]:
    """What came of it, in lines."""
    lines = [f"{len(rows)} fleets, {sum(row['size'] for row in rows)} aircraft"]
    good = [row for row in rows if row.get("planned") and row.get("met")]
    lines.append(f"planned on and arrived by the rule: {len(good)} ({100 * len(good) / len(rows):.1f} %)")
    for kind in _KINDS:
        own = [row for row in rows if row["kind"] == kind]
        fine = [row for row in own if row in good]
        lines.append(f"  {kind}: {len(fine)} of {len(own)}")
    lines.append(f"of the others the judge says {dict(Counter(row['judge'] for row in rows if 'judge' in row))}")
    ratios = [row["separation_ratio"] for row in rows if row.get("separation_ratio") is not None]
    lines.append(f"least separation ratio {min(ratios):.4f}, below 1: {sum(ratio < 1.0 for ratio in ratios)}")
    for row in rows:
        if row not in good:
            lines.append(f"  seed {row['seed']}: {json.dumps({k: v for k, v in row.items() if k != 'seed'})}")
    return lines


def main() -> None:
    """Command line; goes on with a file that is there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0:500")
    parser.add_argument(
        "--sizes", default="3:9", help="only fleets of so many aircraft; seeds of others are passed over"
    )
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    first, last = map(int, asked.seeds.split(":"))
    enable_compilation_cache()
    rows = [json.loads(line) for line in asked.out.read_text().splitlines()] if asked.out.exists() else []
    there = {row["seed"] for row in rows}
    least, most = map(int, asked.sizes.split(":"))
    for seed in range(first, last):
        if seed not in there and least <= size_of(seed) < most:
            rows.append(run_seed(seed))
            with asked.out.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
            print(f"seed {seed}: {rows[-1]['kind']}, {rows[-1].get('messages')}, met {rows[-1].get('met')}", flush=True)  # noqa: T201
    for line in tally(rows):
        print(line)  # noqa: T201


if __name__ == "__main__":
    main()
