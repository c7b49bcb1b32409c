"""Random tasks of one and three aircraft: whether a plan arrives as early as the arrival rule promises.

``python -m trials.arrival_times --seeds 0:200 --out build/arrival-times.jsonl``

Reference: the time of the straight line at the fleet's airspeed, or the first later time with a plan under the rule
"at" (for a sequence or a window, "times"): a forward scan in steps of half a second, refined at its end.
"""

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from anser.compiling import enable_compilation_cache
from anser.missions import plan
from anser.missions.first_plan import CertifiedFirstPlan, arrival_request
from anser.numerics.arrays import as_array
from anser.planning.certified.task import AircraftTask, ArrivalRequest
from anser.scenario import Scenario, loads

TOLERANCE = 0.01
"""Accepted deviation of an arrival from the reference, as a fraction."""
EXCEPTIONS_MOST = 0.02
"""Accepted fraction of late or early tasks."""
RULES = ("together", "sequence", "at", "times", "windows", "earliest")
_UNPLANNED = {("refused", rule) for rule in ("together", "sequence", "windows", "earliest")}
_STEP_S, _REFINED_S = 0.5, 0.02
_DURATION_S = 400.0
_CLIMBS_M = {"level": (-1.0, 1.0), "climb": (5.0, 1500.0), "descent": (-1000.0, -5.0)}


@dataclass(frozen=True)
class ArrivalTrial:
    """A task, its planned arrivals and the reference; plain values, for JSON.

    Attributes
    ----------
    verdict
        "on time", "late", "early" or "refused".
    straight_s, reference_s, planned_s
        Per aircraft: time of the straight line at the fleet's airspeed, promised time, planned time; s.
    ratio
        Greatest ratio of planned to reference time.
    climb_use
        Greatest mean rate of climb or descent, as a fraction of its limit.
    plan_s, attempts
        Planning time with compilation, s, and number of attempts.
    """

    seed: int
    size: int
    rule: str
    kind: str
    verdict: str
    straight_s: tuple[float, ...]
    reference_s: tuple[float, ...]
    planned_s: tuple[float, ...]
    ratio: float | None
    climb_use: float
    plan_s: float
    attempts: int
    refusals: tuple[str, ...] = ()


def random_scenario(seed: int) -> tuple[Scenario, str]:
    """Draw a scenario and its kind of flight: "level" (half of them exactly), "climb" or "descent"."""
    rng = np.random.default_rng([17, seed])
    size, kind = int(rng.choice([1, 3])), str(rng.choice(list(_CLIMBS_M)))
    rule = RULES[seed % len(RULES)]
    speed = rng.uniform(140.0, 185.0)
    goal_speed = rng.uniform(3.0, 20.0) if rng.random() < 0.5 else 0.0
    goal_course = rng.uniform(-180.0, 180.0)
    lines = [
        'format = 2\nfleet.planner = "certified"',
        f'name = "arrival-{seed}"\ntiming.duration_s = {_DURATION_S}\nfleet.speed_m_s = {speed:.3f}',
    ]
    if rng.random() < 0.7:
        lines.append(f"wind = {{ speed_m_s = {rng.uniform(0.0, 20.0):.3f}, from_deg = {rng.uniform(0.0, 360.0):.3f} }}")
    if rng.random() < 0.5:
        lines.append(f"limits.climb_rate_max_m_s = {rng.uniform(8.0, 30.0):.3f}")
    if size > 1:
        lines.append("separation = { horizontal_m = 300.0, vertical_m = 150.0 }")
    line, delay_factor = rng.uniform(0.0, 360.0), rng.uniform(1.05, 1.5)
    distance = rng.uniform(6e3, 13e3, size)
    arrival_times_s = delay_factor * distance / (speed - 25.0)
    rule_options = f", time_s = {np.max(arrival_times_s):.2f}" if rule == "at" else ""
    rule_options += f", spacing_s = {rng.uniform(3.0, 30.0):.2f}" if rule == "sequence" else ""
    lines.append(f'arrival = {{ rule = "{rule}"{rule_options} }}')
    for k in range(size):
        line += rng.uniform(40.0, 110.0)
        goal_n, goal_e = 1200.0 * np.array([np.cos(2.0 * k), np.sin(2.0 * k)])
        north = goal_n + distance[k] * np.cos(np.radians(line))
        east = goal_e + distance[k] * np.sin(np.radians(line))
        altitude, rise = rng.uniform(1200.0, 3500.0), rng.uniform(*_CLIMBS_M[kind])
        rise = 0.0 if kind == "level" and rng.random() < 0.5 else rise
        course = np.remainder(line + rng.uniform(-30.0, 30.0) + 360.0, 360.0) - 180.0
        start_speed = speed + rng.uniform(-8.0, 8.0)
        aircraft_options = ""
        if rule == "times":
            aircraft_options = f"arrive_s = {arrival_times_s[k]:.2f}"
        if rule == "windows":
            from_s = distance[k] / speed * rng.uniform(0.7, 1.3)
            aircraft_options = f"arrive_from_s = {from_s:.2f}\narrive_to_s = {from_s + rng.uniform(20.0, 80.0):.2f}"
        lines.append(
            f'[[aircraft]]\nname = "a{k}"\ngoal = "g{k}"\n{aircraft_options}\n'
            f"start = {{ north_m = {north:.3f}, east_m = {east:.3f}, altitude_m = {altitude:.6f}, "
            f"speed_m_s = {start_speed:.3f}, course_deg = {course:.3f} }}\n"
            f"rendezvous = {{ stand_off_up_m = {altitude + rise:.6f} }}\n"
            f'[[goal]]\nname = "g{k}"\nkind = "surface"\nnorth_m = {goal_n:.3f}\neast_m = {goal_e:.3f}\n'
            f"speed_m_s = {goal_speed:.3f}\ncourse_deg = {goal_course:.3f}"
        )
    return loads("\n".join(lines)), kind


def straight_times(scenario: Scenario, tasks: AircraftTask) -> Float[np.ndarray, " aircraft"]:
    """Time of the straight line to the moving rendezvous at the fleet's airspeed, s: a quadratic equation in time.

    The air moves steadily, so the rendezvous moves steadily relative to the air.
    """
    n = len(scenario.aircraft)
    north, east, up = scenario.wind.velocity_m_s(0.0)
    line = np.asarray(tasks.rendezvous_n)[:n] - np.asarray(tasks.position_n)[:n]
    moving = np.asarray(tasks.goal_velocity_n)[:n] - np.array([north, east, -up])
    square = np.sum(moving**2, axis=1) - np.asarray(tasks.speed)[:n] ** 2
    half = np.sum(line * moving, axis=1)
    return (-half - np.sqrt(half**2 - square * np.sum(line**2, axis=1))) / square


@dataclass(frozen=True)
class _Scan:
    """Scan over arrival times for a planned scenario."""

    planned: CertifiedFirstPlan

    def plans(self, tasks: AircraftTask, times_s: Float[np.ndarray, " aircraft"]) -> bool:
        """Whether a plan exists for given arrival times, s."""
        scenario, planner = self.planned.scenario, self.planned.flight.planner
        request = ArrivalRequest("times", scenario.timing.latest_arrival_s, times_s)
        outcome, _ = planner.search_plan(0.0, tasks, request, scenario.timing.duration_s)  # pyright: ignore
        return outcome.plan is not None

    def first(self, tasks: AircraftTask, begin_s: float, end_s: float, offsets_s: Float[np.ndarray, " fleet"]) -> float:
        """First feasible arrival time from `begin_s` to `end_s`, a feasible time, s."""
        low, high = begin_s, end_s
        for step in np.arange(begin_s, end_s, _STEP_S):
            if self.plans(tasks, step + offsets_s):
                high = float(step)
                break
            low = float(step)
        while high - low > _REFINED_S:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.plans(tasks, middle + offsets_s) else (middle, high)
        return high


def _reference(planned: CertifiedFirstPlan, straight_s: np.ndarray, planned_s: np.ndarray) -> np.ndarray:
    """Promised arrival time of each aircraft, s; scans only if the plan is later than the straight line allows."""
    scenario, n, tasks = planned.scenario, straight_s.size, planned.padded_tasks
    count = np.asarray(tasks.active).size
    request, scan = arrival_request(scenario, count), _Scan(planned)
    if request.times_s is not None:
        return request.times_s[:n]
    if request.windows_s is not None:
        reference = np.maximum(straight_s, request.windows_s[:n, 0])
        for k in np.flatnonzero(planned_s > (1.0 + TOLERANCE) * reference):
            alone = eqx.tree_at(lambda t: t.active, tasks, as_array(np.where(np.arange(count) == k, 1.0, 0.0)))
            reference[k] = scan.first(alone, float(reference[k]), float(planned_s[k]), np.zeros(count))
        return reference
    offsets = request.offsets(count)
    begin = float(np.max(straight_s - offsets[:n]))
    if np.any(planned_s > (1.0 + TOLERANCE) * (begin + offsets[:n])):
        begin = scan.first(tasks, begin, float(planned_s[0] - offsets[0]), offsets)
    return begin + offsets[:n]


def arrival_trial(seed: int) -> ArrivalTrial:
    """Plan the task of a seed and compare its arrivals with the reference."""
    scenario, kind = random_scenario(seed)
    started = time.perf_counter()
    planned = plan(scenario)
    assert isinstance(planned, CertifiedFirstPlan)
    plan_s, n = time.perf_counter() - started, len(scenario.aircraft)
    tasks = planned.padded_tasks
    straight = straight_times(scenario, tasks)
    rise = np.abs((np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n))[:n, 2])
    rate = np.asarray(tasks.limits.climb_rate_max)[:n]
    rule, outcome = scenario.arrival.rule, planned.outcome
    assert outcome is not None
    if outcome.plan is None:
        reference, arrivals, ratio, verdict = straight[:0], straight[:0], None, "refused"
    else:
        arrivals = np.asarray(planned.plan.arrival_times)[:n]
        reference = _reference(planned, straight, arrivals)
        ratio = float(np.max(arrivals / reference))
        early = rule != "earliest" and float(np.min(arrivals / reference)) < 1.0 - TOLERANCE
        verdict = "late" if ratio > 1.0 + TOLERANCE else "early" if early else "on time"
    return ArrivalTrial(
        seed,
        n,
        rule,
        kind,
        verdict,
        tuple(straight.tolist()),
        tuple(reference.tolist()),
        tuple(arrivals.tolist()),
        ratio,
        float(np.max(rise / rate / (straight if ratio is None else arrivals))),
        plan_s,
        outcome.attempts,
        planned.refusals,
    )


def main() -> None:
    """Command line; exit code 1 if too many tasks are late, early or refused."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:200", help="FIRST:LAST of the seeds, the last left out")
    parser.add_argument("--rules", nargs="+", choices=RULES, default=RULES, help="rules of the tasks; the default: all")
    parser.add_argument("--out", type=Path, required=True, help="file of results, one JSON line per seed; continued")
    arguments = parser.parse_args()
    start, stop = (int(part) for part in arguments.seeds.split(":"))
    enable_compilation_cache()
    results: list[dict[str, Any]] = []
    if arguments.out.exists():
        results = [json.loads(line) for line in arguments.out.read_text(encoding="utf-8").splitlines()]
    present = {result["seed"] for result in results}
    seeds = {seed for seed in range(start, stop) if RULES[seed % len(RULES)] in arguments.rules}
    # Rule by rule, because each rule needs different compiled programs.
    for seed in sorted(seeds - present, key=lambda seed: (seed % len(RULES), seed)):
        result = asdict(arrival_trial(seed))
        results.append(result)
        with arguments.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(result) + "\n")
        print(f"seed {seed}: {result['rule']}, {result['verdict']}, {result['plan_s']:.1f} s", flush=True)  # noqa: T201
    results = [result for result in results if result["seed"] in seeds]
    for rule in arguments.rules:
        print(rule, dict(Counter(result["verdict"] for result in results if result["rule"] == rule)))  # noqa: T201
    # A refusal of prescribed times is legitimate; with free times there should be a plan.
    exceptions = [r for r in results if r["verdict"] in ("late", "early") or (r["verdict"], r["rule"]) in _UNPLANNED]
    for result in exceptions:
        print(json.dumps(result))  # noqa: T201
    sys.exit(len(exceptions) > EXCEPTIONS_MOST * len(results))


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
