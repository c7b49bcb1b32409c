"""Many flights of one scenario with different random numbers: their miss distances, compared with a lower bound.

``python -m trials.noisy_flights scenarios/uncertain-world.toml --flights 1000 --out build/noisy-flights.npz``

Decentralised first plans have several sizes, and few flights share a search: use ``--batch 1``.
"""

import argparse
import dataclasses
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
from anser.missions.first_plan import aircraft_planner, arrival_request
from anser.missions.segments import BatchState, fly_segments, replan_flights
from anser.numerics import flight_randomness
from anser.numerics.arrays import Stacked, as_array, stack_rows
from anser.parts import Instant
from anser.planning.certified.certified_plan import choose_interval_count
from anser.planning.certified.planner import CertifiedPlanState
from anser.planning.certified.replanning import FIRST_PLAN
from anser.planning.certified.search import search
from anser.planning.certified.task import AircraftTask
from anser.planning.holds.assignment import assign_holds
from anser.planning.holds.hold_paths import choose_cell_count
from anser.scenario import Scenario, build_flight, load
from anser.simulation import AbstractRecorder, Flight, FlightState, SummaryRecorder, fly
from anser.simulation.flight import SEGMENT_STEPS
from anser.simulation.recorders import FleetSample
from anser.simulation.start import initialize_flight, trimmed_fleet
from anser.spatial.rotations import rotate_back

BATCH = 125


class AtFreeze(NamedTuple):
    """Estimate covariances of each aircraft at the freeze of its plan; leading axis aircraft."""

    goal_covariance: jax.Array
    position_covariance: jax.Array
    time: jax.Array


class Greatest(NamedTuple):
    """Greatest bank angle (rad) and rate of climb or descent (m/s) of each aircraft up to its arrival."""

    bank: jax.Array
    climb_rate: jax.Array


class Recorder(AbstractRecorder):
    """The running summary, and the covariances at the freeze."""

    stride: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> Any:
        """Initial state."""
        at_freeze = AtFreeze(jnp.zeros((aircraft, 6, 6)), jnp.zeros((aircraft, 3, 3)), jnp.full(aircraft, jnp.inf))
        return SummaryRecorder().init(aircraft), at_freeze, Greatest(jnp.zeros(aircraft), jnp.zeros(aircraft))

    def update(self, recorder_state: Any, sample: FleetSample, instant: Instant) -> Any:
        """State after one more sample."""
        summary, at_freeze, greatest = recorder_state
        values = sample.rows(_known)
        at_start_of_freeze = (values["phase"] >= 1) & jnp.isinf(at_freeze.time)
        next_at_freeze = AtFreeze(
            jnp.where(at_start_of_freeze[:, None, None], values["goal"], at_freeze.goal_covariance),
            jnp.where(at_start_of_freeze[:, None, None], values["own"], at_freeze.position_covariance),
            jnp.where(at_start_of_freeze, instant.time, at_freeze.time),
        )
        under_way = values["phase"] < 2
        next_greatest = Greatest(
            jnp.where(under_way, jnp.maximum(greatest.bank, values["bank"]), greatest.bank),
            jnp.where(under_way, jnp.maximum(greatest.climb_rate, values["climb_rate"]), greatest.climb_rate),
        )
        return SummaryRecorder().update(summary, sample, instant), next_at_freeze, next_greatest

    def output(self, sample: FleetSample, instant: Instant) -> None:
        """No output per sample."""


def _known(sample: Any) -> dict[str, jax.Array]:
    uncertainty = sample.belief.uncertainty
    phase = sample.approach.phase
    R_bn = sample.truth.condition.R_bn
    shared = {
        "phase": phase,
        "bank": jnp.abs(jnp.arctan2(R_bn[1, 2], R_bn[2, 2])),
        "climb_rate": jnp.abs(rotate_back(R_bn, sample.truth.state.velocity_b)[2]),
    }
    if uncertainty is None:
        return shared | {"goal": jnp.zeros((6, 6)), "own": jnp.zeros((3, 3))}
    return shared | {"goal": uncertainty.goal_covariance, "own": uncertainty.position_covariance}


@jax.jit
def _trimmed(flight: Flight, keys: Any) -> Any:
    def trim_flight(randomness: Any) -> Any:
        fleet = trimmed_fleet(dataclasses.replace(flight, randomness=randomness))
        planner = aircraft_planner(flight)
        return fleet, planner.aircraft_tasks(fleet.reports, planner.resolve_limits(fleet.performance))

    return jax.vmap(trim_flight)(keys)


@jax.jit
def _begun(flight: Flight, keys: Any, fleets: Any, plans: CertifiedPlanState) -> FlightState:
    def initialize(randomness: Any, fleet: Any, plan: CertifiedPlanState) -> FlightState:
        planner_state = flight.planner.initial_state(plan, randomness)
        return initialize_flight(dataclasses.replace(flight, randomness=randomness), fleet, planner_state)

    return jax.vmap(initialize)(keys, fleets, plans)


def _planned(scenario: Scenario, flight: Flight, tasks: AircraftTask) -> tuple[Any, Any]:
    """A first plan and its holds; None without a plan."""
    if not scenario.fleet.is_central:
        return negotiate_plan(scenario, flight, tasks)[:2]
    planner, duration_s, attempts = aircraft_planner(flight), scenario.timing.duration_s, []

    def failed_holds(plan: Any) -> np.ndarray:
        cells = choose_cell_count(duration_s)
        holds = _holds(
            plan.paths, tasks, planner.airspace, planner.guidance, as_array(0.0), as_array(duration_s), cells
        )
        attempts.append(holds)
        return ~np.asarray(holds.clear)

    outcome = search(
        0.0,
        tasks,
        planner.airspace,
        arrival_request(scenario),
        failed_after_arrival=failed_holds,
        intervals=choose_interval_count(duration_s),
    )
    return (None, None) if outcome.plan is None else (outcome.plan, attempts[-1])


_holds = jax.jit(assign_holds, static_argnames=("cells",))


def _seeded(flight: Flight, keys: Any) -> Stacked[Flight]:
    """Flights that differ in their random numbers only."""
    others = dataclasses.replace(eqx.filter(flight, lambda _: False), randomness=keys)
    return Stacked(others, dataclasses.replace(flight, randomness=eqx.filter(keys, lambda _: False)))


@jax.jit
def _segment(flights: Stacked[Flight], state: BatchState, first_step: Any, step_count: Any) -> BatchState:
    def fly_one(flight: Flight, state: FlightState, recorder_state: Any) -> BatchState:
        flown = fly(flight, state, first_step, SEGMENT_STEPS, Recorder(), recorder_state, active_steps=step_count)
        return BatchState(*flown[:2])

    return flights.map(fly_one, *state)


def fly_many(path: str, flights: int, first_flight: int = 0, batch: int = BATCH) -> dict[str, np.ndarray]:
    """Fly many flights of a scenario; return arrays with one row per flight."""
    scenario = load(path)
    flight = build_flight(scenario)
    timing = scenario.timing
    steps, replan_steps = (round(time_s / timing.step_s) for time_s in (timing.duration_s, timing.replan_period_s))
    results: list[dict[str, np.ndarray]] = []
    for begin_at in range(first_flight, first_flight + flights, batch):
        start_time = time.perf_counter()
        numbers = list(range(begin_at, begin_at + batch))
        keys = stack_rows([flight_randomness(scenario.seed, number) for number in numbers])
        fleets, tasks = _trimmed(flight, keys)
        plans, planned = [], []
        jax.block_until_ready(tasks)
        for k in range(batch):
            flight_tasks, key = jax.tree.map(lambda leaf, k=k: leaf[k], (tasks, keys))
            plan, holds = _planned(scenario, dataclasses.replace(flight, randomness=key), flight_tasks)
            planned.append(plan is not None)
            plan_state = CertifiedPlanState(plan, as_array(FIRST_PLAN, np.int64), holds, flight_tasks.limits)
            plans.append(plans[-1] if plan is None else plan_state)
        planned_at = time.perf_counter()
        states = _begun(flight, keys, fleets, stack_rows(plans))
        recorder_state = jax.tree.map(
            lambda leaf: jnp.broadcast_to(leaf, (batch, *leaf.shape)), Recorder().init(flight.count)
        )
        replanned_count = 0

        flights_of_batch = _seeded(flight, keys)

        def fly_on(
            state: BatchState, first_step: int, step_count: int, flown: Stacked[Flight] = flights_of_batch
        ) -> tuple[BatchState, None]:
            return _segment(flown, state, as_array(first_step, np.int32), as_array(step_count, np.int32)), None

        def replan(
            states: FlightState, indices: np.ndarray, sample: int, flown: Stacked[Flight] = flights_of_batch
        ) -> FlightState:
            nonlocal replanned_count
            replanned_count += indices.size
            return replan_flights(flown, states, indices, sample)

        start = BatchState(states, recorder_state)
        for segment in fly_segments(fly_on, replan, start, range(batch), steps, replan_steps, row_stride=1):
            states, recorder_state = segment.state
        (summary, _), at_freeze, greatest = jax.tree.map(np.asarray, recorder_state)
        arrivals = np.asarray(states.planner.plan.arrival_times)
        results.append(
            {
                "flight": np.array(numbers),
                "planned": np.array(planned),
                "planned_arrival_s": arrivals,
                "arrival_s": summary.pass_time,
                "miss_m": summary.pass_distance,
                "speed_min_m_s": summary.speeds_until_pass.minimum,
                "speed_max_m_s": summary.speeds_until_pass.maximum,
                "bank_max_rad": greatest.bank,
                "climb_rate_max_m_s": greatest.climb_rate,
                "separation_m": summary.separation_min,
                "clearance_m": summary.clearance_min,
                "status": summary.first_status,
                "goal_covariance": at_freeze.goal_covariance,
                "own_covariance": at_freeze.position_covariance,
                "frozen_s": at_freeze.time,
            }
        )
        timing_text = f"{planned_at - start_time:.0f} s planning, {time.perf_counter() - planned_at:.0f} s flying"
        timing_text += f", {replanned_count} plans made anew"
        print(f"flights to {begin_at + batch}: {timing_text}", flush=True)  # noqa: T201
    return {key: np.concatenate([result[key] for result in results])[:flights] for key in results[0]}


def quantile_with_interval(
    values: np.ndarray, probability: float = 0.95, confidence: float = 0.95
) -> tuple[float, ...]:
    """A quantile and its distribution-free confidence interval by order statistics (binomial)."""
    ordered, count = np.sort(values), values.size
    low, high = stats.binom.ppf([0.5 * (1 - confidence), 0.5 * (1 + confidence)], count, probability).astype(int)
    return (
        float(np.quantile(values, probability)),
        float(ordered[max(low - 1, 0)]),
        float(ordered[min(high, count - 1)]),
    )


def floor_of(
    results: dict[str, np.ndarray], freeze_s: float, density: float, draws: int = 50
) -> tuple[np.ndarray, ...]:
    """Lower bound of misses (m), sampled from the covariances at the freeze, and the sampled offsets (NED, m)."""
    rng = np.random.default_rng(0)
    transition = np.eye(6)
    transition[:3, 3:] = freeze_s * np.eye(3)
    noise = np.diag([density, density, 0.01 * density]) * freeze_s**3 / 3
    shape = results["goal_covariance"].shape[:2]
    spread = (transition @ results["goal_covariance"] @ transition.T)[..., :3, :3] + noise
    roots = np.linalg.cholesky(spread + 1e-12 * np.eye(3))
    samples = np.einsum("faij,dfaj->dfai", roots, rng.normal(size=(draws, *shape, 3)))
    return np.linalg.norm(samples, axis=-1), samples


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--batch", type=int, default=BATCH)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    enable_compilation_cache()
    results = fly_many(options.scenario, options.flights, options.first, options.batch)
    np.savez_compressed(options.out, allow_pickle=False, **results)
    scenario = load(options.scenario)
    for line in told(
        results, scenario.timing.freeze_s, scenario.estimator.acceleration_m_s2**2, scenario.fleet.airspeed_m_s
    ):
        print(line)  # noqa: T201


def told(results: dict[str, np.ndarray], freeze_s: float, density: float, speed_m_s: float) -> list[str]:
    """Summary of the results, in lines."""
    results = {key: values[results["planned"]] for key, values in results.items()} | {"all": results["planned"]}
    spread = results["arrival_s"].max(axis=1) - results["arrival_s"].min(axis=1)
    floor, samples = floor_of(results, freeze_s, density)
    late = samples[..., 0] / speed_m_s
    floor_spread = (late.max(axis=-1) - late.min(axis=-1)).ravel()
    lines = [f"{results['all'].size} flights, {int(results['all'].sum())} planned"]
    lines.append(f"status other than 0: {int((results['status'] != 0).any(axis=1).sum())}")
    for name, values, bound in (
        ("miss_m", results["miss_m"].ravel(), floor.ravel()),
        ("spread_s", spread, floor_spread),
    ):
        value, low, high = quantile_with_interval(values)
        lines.append(
            f"{name}: 95 % {value:.4g} ({low:.4g} to {high:.4g}), floor {np.quantile(bound, 0.95):.4g}, "
            f"ratio {value / np.quantile(bound, 0.95):.3f}, greatest {values.max():.4g}"
        )
    lines.append(
        f"airspeed without gusts {results['speed_min_m_s'].min():.2f} to {results['speed_max_m_s'].max():.2f} m/s"
    )
    lines.append(f"bank angle to {np.degrees(results['bank_max_rad'].max()):.1f} deg up to the arrival")
    lines.append(f"rate of climb or descent to {results['climb_rate_max_m_s'].max():.1f} m/s")
    times = results["planned_arrival_s"].max(axis=1)
    lines.append(f"last arrival {times.min():.1f} to {times.max():.1f} s, median {np.median(times):.1f} s")
    lines.append(f"least separation {results['separation_m'].min():.1f} m")
    lines.append(f"clearance at least {results['clearance_m'].min():.1f} m")
    return lines


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
