"""Many flights of one scenario, of which only what is drawn differs: how far they miss, beside the least possible.

``python -m trials.noisy_flights scenarios/uncertain-world.toml --flights 1000 --out build/noisy-flights.npz``

Without a centre first plans are of several sizes, and few flights wait for the same search: ``--batch 1``.
"""

import argparse
import dataclasses
import functools
import time
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

from anser.compiling import enable_compilation_cache
from anser.missions.consensus import negotiate_plan
from anser.missions.first_plan import arrival_request
from anser.missions.runs import without_replanning
from anser.numerics import flight_randomness
from anser.numerics.arrays import as_array, stack_rows
from anser.parts import Instant
from anser.planning.certified.certified_plan import choose_interval_count
from anser.planning.certified.planner import CertifiedPlanner, CertifiedPlanState
from anser.planning.certified.replanning import FIRST_PLAN
from anser.planning.certified.search import search
from anser.planning.certified.task import AircraftTask
from anser.planning.decentralised.planner import DecentralisedPlanner
from anser.planning.holds.assignment import assign_holds
from anser.planning.holds.hold_paths import choose_cell_count
from anser.scenario import Scenario, build_flight, load
from anser.simulation import AbstractRecorder, Flight, FlightState, SummaryRecorder, fly
from anser.simulation.flight import SEGMENT_STEPS
from anser.simulation.recorders import FleetSample
from anser.simulation.start import initialize_flight, trimmed_fleet
from anser.spatial.rotations import rotate_back

BATCH = 125
_AGAIN = 8  # flights of a segment that are flown again at once, at most


class AtFreeze(NamedTuple):
    """What an aircraft knew when its plan came to stand still; leading axis aircraft."""

    goal_covariance: jax.Array
    position_covariance: jax.Array
    time: jax.Array


class Greatest(NamedTuple):
    """Bank angle (rad) and rate of climb or descent (m/s) of each aircraft up to its arrival."""

    bank: jax.Array
    climb_rate: jax.Array


class Recorder(AbstractRecorder):
    """The running summary, and what was known at the freeze."""

    stride: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> Any:
        """Nothing known yet."""
        known = AtFreeze(jnp.zeros((aircraft, 6, 6)), jnp.zeros((aircraft, 3, 3)), jnp.full(aircraft, jnp.inf))
        return SummaryRecorder().init(aircraft), known, Greatest(jnp.zeros(aircraft), jnp.zeros(aircraft))

    def update(self, recorder_state: Any, sample: FleetSample, instant: Instant) -> Any:
        """With one more sample."""
        summary, known, greatest = recorder_state
        now = sample.rows(_known)
        first = (now["phase"] >= 1) & jnp.isinf(known.time)
        kept = AtFreeze(
            jnp.where(first[:, None, None], now["goal"], known.goal_covariance),
            jnp.where(first[:, None, None], now["own"], known.position_covariance),
            jnp.where(first, instant.time, known.time),
        )
        on_way = now["phase"] < 2
        more = Greatest(
            jnp.where(on_way, jnp.maximum(greatest.bank, now["bank"]), greatest.bank),
            jnp.where(on_way, jnp.maximum(greatest.climb_rate, now["climb_rate"]), greatest.climb_rate),
        )
        return SummaryRecorder().update(summary, sample, instant), kept, more

    def output(self, sample: FleetSample, instant: Instant) -> None:
        """None."""


def _known(sample: Any) -> dict[str, jax.Array]:
    known = sample.belief.uncertainty
    phase = sample.approach.phase
    R_bn = sample.truth.condition.R_bn
    shared = {
        "phase": phase,
        "bank": jnp.abs(jnp.arctan2(R_bn[1, 2], R_bn[2, 2])),
        "climb_rate": jnp.abs(rotate_back(R_bn, sample.truth.state.velocity_b)[2]),
    }
    if known is None:
        return shared | {"goal": jnp.zeros((6, 6)), "own": jnp.zeros((3, 3))}
    return shared | {"goal": known.goal_covariance, "own": known.position_covariance}


@jax.jit
def _trimmed(flight: Flight, keys: Any) -> Any:
    def one(randomness: Any) -> Any:
        fleet = trimmed_fleet(dataclasses.replace(flight, randomness=randomness))
        planner = _each(flight)
        return fleet, planner.aircraft_tasks(fleet.reports, planner.resolve_limits(fleet.performance))

    return jax.vmap(one)(keys)


@jax.jit
def _begun(flight: Flight, keys: Any, fleets: Any, plans: CertifiedPlanState) -> FlightState:
    def one(randomness: Any, fleet: Any, plan: CertifiedPlanState) -> FlightState:
        planner = flight.planner
        recorder_state = planner.initial_state(plan, randomness) if isinstance(planner, DecentralisedPlanner) else plan
        return initialize_flight(dataclasses.replace(flight, randomness=randomness), fleet, recorder_state)

    return jax.vmap(one)(keys, fleets, plans)


def _each(flight: Flight) -> CertifiedPlanner:
    """The certified planner of a flight, or that of each aircraft without a centre."""
    planner = flight.planner.aircraft_planner if isinstance(flight.planner, DecentralisedPlanner) else flight.planner
    assert isinstance(planner, CertifiedPlanner)
    return planner


def _planned(scenario: Scenario, flight: Flight, tasks: AircraftTask) -> tuple[Any, Any]:
    """A first plan and its holds; None where there is none."""
    if isinstance(flight.planner, DecentralisedPlanner):
        return negotiate_plan(scenario, flight, tasks)[:2]
    planner, duration_s, tried = _each(flight), scenario.timing.duration_s, []

    def after(plan: Any) -> np.ndarray:
        cells = choose_cell_count(duration_s)
        holds = _holds(
            plan.paths, tasks, planner.airspace, planner.guidance, as_array(0.0), as_array(duration_s), cells
        )
        tried.append(holds)
        return ~np.asarray(holds.clear)

    outcome = search(
        0.0,
        tasks,
        planner.airspace,
        arrival_request(scenario),
        failed_after_arrival=after,
        intervals=choose_interval_count(duration_s),
    )
    return (None, None) if outcome.plan is None else (outcome.plan, tried[-1])


_holds = jax.jit(assign_holds, static_argnames=("cells",))


@functools.partial(jax.jit, static_argnames=("count",))
def _segment(flight: Flight, keys: Any, states: FlightState, since: Any, recorder_state: Any, count: int) -> Any:
    def one(randomness: Any, state: FlightState, kept: Any) -> Any:
        own = dataclasses.replace(flight, randomness=randomness)
        after, kept, _ = fly(own, state, since, count, Recorder(), kept)
        return after, kept

    return jax.vmap(one)(keys, states, recorder_state)


def fly_many(path: str, flights: int, first: int = 0, batch: int = BATCH) -> dict[str, np.ndarray]:
    """Fly many flights of a scenario; rows of numbers for each."""
    scenario = load(path)
    flight = build_flight(scenario)
    timing = scenario.timing
    steps = round(timing.duration_s / timing.step_s)
    at_once = min(_AGAIN, batch)
    found: list[dict[str, np.ndarray]] = []
    for begin_at in range(first, first + flights, batch):
        began = time.perf_counter()
        numbers = list(range(begin_at, begin_at + batch))
        keys = stack_rows([flight_randomness(scenario.seed, number) for number in numbers])
        fleets, tasks = _trimmed(flight, keys)
        plans, planned = [], []
        jax.block_until_ready(tasks)
        for k in range(batch):
            own, key = jax.tree.map(lambda leaf, k=k: leaf[k], (tasks, keys))
            plan, holds = _planned(scenario, dataclasses.replace(flight, randomness=key), own)
            planned.append(plan is not None)
            made = CertifiedPlanState(plan, as_array(FIRST_PLAN, np.int64), holds, own.limits)
            plans.append(plans[-1] if plan is None else made)
        planned_at = time.perf_counter()
        states = _begun(flight, keys, fleets, stack_rows(plans))
        recorder_state = jax.tree.map(
            lambda leaf: jnp.broadcast_to(leaf, (batch, *leaf.shape)), Recorder().init(flight.count)
        )
        flown_again = 0
        for since in range(0, steps, SEGMENT_STEPS):
            number = as_array(since, np.int32)
            after, kept = _segment(without_replanning(flight), keys, states, number, recorder_state, SEGMENT_STEPS)
            asked = np.flatnonzero(np.asarray(after.planner.replan_needed))
            flown_again += asked.size
            for some in (asked[k : k + at_once] for k in range(0, asked.size, at_once)):
                # filled up to one shape with the last of them
                rows = np.concatenate([some, np.repeat(some[-1:], at_once - some.size)])
                before = jax.tree.map(lambda leaf, rows=rows: leaf[rows], (keys, states, recorder_state))
                full = _segment(flight, before[0], before[1], number, before[2], SEGMENT_STEPS)
                after, kept = jax.tree.map(lambda held, new, rows=rows: held.at[rows].set(new), (after, kept), full)
            states, recorder_state = after, kept
        (summary, _), known, greatest = jax.tree.map(np.asarray, recorder_state)
        arrivals = np.asarray(states.planner.plan.arrival_times)
        found.append(
            {
                "flight": np.array(numbers),
                "planned": np.array(planned),
                "planned_arrival_s": arrivals,
                "arrival_s": summary.arrival_time,
                "miss_m": summary.miss,
                "speed_min_m_s": summary.speeds_until_arrival.least,
                "speed_max_m_s": summary.speeds_until_arrival.greatest,
                "bank_max_rad": greatest.bank,
                "climb_rate_max_m_s": greatest.climb_rate,
                "separation_m": summary.separation_min,
                "clearance_m": summary.clearance_min,
                "status": summary.first_status,
                "goal_covariance": known.goal_covariance,
                "own_covariance": known.position_covariance,
                "frozen_s": known.time,
            }
        )
        told_s = f"{planned_at - began:.0f} s planning, {time.perf_counter() - planned_at:.0f} s flying"
        told_s += f", {flown_again} segments of {batch * (steps // SEGMENT_STEPS)} flown again with a plan made anew"
        print(f"flights to {begin_at + batch}: {told_s}", flush=True)  # noqa: T201
    return {key: np.concatenate([one[key] for one in found])[:flights] for key in found[0]}


def quantile_with_interval(values: np.ndarray, part: float = 0.95, confidence: float = 0.95) -> tuple[float, ...]:
    """A quantile and its interval by order statistics (binomial), distribution-free."""
    ordered, count = np.sort(values), values.size
    low, high = stats.binom.ppf([0.5 * (1 - confidence), 0.5 * (1 + confidence)], count, part).astype(int)
    return float(np.quantile(values, part)), float(ordered[max(low - 1, 0)]), float(ordered[min(high, count - 1)])


def floor_of(rows: dict[str, np.ndarray], freeze_s: float, density: float, draws: int = 50) -> tuple[np.ndarray, ...]:
    """Misses (m) and offsets along the flight that the knowledge at the freeze leaves, drawn from its covariance."""
    rng = np.random.default_rng(0)
    ahead = np.eye(6)
    ahead[:3, 3:] = freeze_s * np.eye(3)
    noise = np.diag([density, density, 0.01 * density]) * freeze_s**3 / 3
    shape = rows["goal_covariance"].shape[:2]
    spread = (ahead @ rows["goal_covariance"] @ ahead.T)[..., :3, :3] + noise
    roots = np.linalg.cholesky(spread + 1e-12 * np.eye(3))
    drawn = np.einsum("faij,dfaj->dfai", roots, rng.normal(size=(draws, *shape, 3)))
    return np.linalg.norm(drawn, axis=-1), drawn


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--batch", type=int, default=BATCH)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    enable_compilation_cache()
    rows = fly_many(asked.scenario, asked.flights, asked.first, asked.batch)
    np.savez_compressed(asked.out, allow_pickle=False, **rows)
    scenario = load(asked.scenario)
    for line in told(rows, scenario.timing.freeze_s, scenario.estimator.acceleration_m_s2**2, scenario.fleet.speed_m_s):
        print(line)  # noqa: T201


def told(rows: dict[str, np.ndarray], freeze_s: float, density: float, speed_m_s: float) -> list[str]:
    """What came of it, in lines."""
    rows = {key: values[rows["planned"]] for key, values in rows.items()} | {"all": rows["planned"]}
    spread = rows["arrival_s"].max(axis=1) - rows["arrival_s"].min(axis=1)
    floor, drawn = floor_of(rows, freeze_s, density)
    late = drawn[..., 0] / speed_m_s
    floor_spread = (late.max(axis=-1) - late.min(axis=-1)).ravel()
    lines = [f"{rows['all'].size} flights, {int(rows['all'].sum())} planned"]
    lines.append(f"status other than 0: {int((rows['status'] != 0).any(axis=1).sum())}")
    for name, values, least in (("miss_m", rows["miss_m"].ravel(), floor.ravel()), ("spread_s", spread, floor_spread)):
        value, low, high = quantile_with_interval(values)
        lines.append(
            f"{name}: 95 % {value:.4g} ({low:.4g} to {high:.4g}), floor {np.quantile(least, 0.95):.4g}, "
            f"ratio {value / np.quantile(least, 0.95):.3f}, greatest {values.max():.4g}"
        )
    lines.append(f"airspeed without gusts {rows['speed_min_m_s'].min():.2f} to {rows['speed_max_m_s'].max():.2f} m/s")
    lines.append(f"bank angle to {np.degrees(rows['bank_max_rad'].max()):.1f} deg up to the arrival")
    lines.append(f"rate of climb or descent to {rows['climb_rate_max_m_s'].max():.1f} m/s")
    times = rows["planned_arrival_s"].max(axis=1)
    lines.append(f"last arrival {times.min():.1f} to {times.max():.1f} s, median {np.median(times):.1f} s")
    lines.append(f"least separation {rows['separation_m'].min():.1f} m")
    lines.append(f"clearance at least {rows['clearance_m'].min():.1f} m")
    return lines


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
