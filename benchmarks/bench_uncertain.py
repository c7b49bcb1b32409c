"""Cost of uncertainty: a step of the closed loop with 1,024 fleets, relative to a scenario without uncertainty.

Compare ratios within one run: the variants alternate, so that the machine's load affects each of them. Steps are timed
without replanning, which happens every hundredth step and would hide a part of the cost.
"""

import dataclasses
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.numerics import flight_randomness
from anser.numerics.arrays import stack_rows
from anser.scenario import build_flight, loads
from anser.simulation import SummaryRecorder, fly
from anser.simulation.start import initialize_flight, trimmed_fleet

TEXT = (Path(__file__).parents[1] / "scenarios" / "uncertain-world.toml").read_text(encoding="utf-8")
AIR, REST = TEXT.index("[turbulence]"), TEXT.index("[[aircraft]]")
NOISY = TEXT[AIR:REST]
FILTER = '[estimator]\nfilter = "{}"\nmotion = "{}"\n\n'
VARIANTS = {
    "perfect": "",
    "Dryden, satellite navigation, EKF": NOISY + FILTER.format("ekf", "steady"),
    "Dryden alone": '[turbulence]\nintensity = "moderate"\n\n',
    "satellite navigation alone": '[navigation]\nsensors = "satellite-inertial"\n\n',
    "EKF alone": '[goal_sensor]\npreset = "camera"\n\n' + FILTER.format("ekf", "steady"),
    "von Karman instead": NOISY.replace('"moderate"', '"moderate"\nspectrum = "von-karman"')
    + FILTER.format("ekf", "steady"),
    "UKF instead": NOISY + FILTER.format("ukf", "steady"),
    "IMM (EKF) instead": NOISY + FILTER.format("ekf", "changing"),
    "IMM (UKF) instead": NOISY + FILTER.format("ukf", "changing"),
}
FLEETS, STEPS, ROUNDS = 1024, 200, 9


@eqx.filter_jit
def summed_up(flight, keys, states):
    def one(key, state):
        seeded_flight = dataclasses.replace(flight, randomness=key)
        final_state, memory, _ = fly(seeded_flight, state, jnp.asarray(0, dtype=jnp.int32), STEPS, SummaryRecorder())
        return memory, final_state.vehicles

    return jax.vmap(one)(keys, states)


def batch_of(text):
    scenario = loads(TEXT[:AIR] + text + TEXT[REST:])
    flight = build_flight(scenario)
    fleet = jax.jit(trimmed_fleet)(flight)
    first_plan = flight.planner.first_plan(0.0, fleet.reports, fleet.performance)
    flight = eqx.tree_at(lambda f: f.timing.replan_steps, flight, replace_fn=jnp.zeros_like)
    keys = stack_rows([flight_randomness(scenario.seed, number) for number in range(FLEETS)])

    def started(key):
        return initialize_flight(dataclasses.replace(flight, randomness=key), fleet, first_plan)

    return flight, keys, jax.jit(jax.vmap(started))(keys)


def test_what_an_uncertain_world_costs(benchmark):
    batches = {name: batch_of(text) for name, text in VARIANTS.items()}
    for batch in batches.values():
        jax.block_until_ready(summed_up(*batch))
    durations = {name: [] for name in batches}
    for _ in range(ROUNDS):
        for name, batch in batches.items():
            start_time = time.perf_counter()
            jax.block_until_ready(summed_up(*batch))
            durations[name].append(time.perf_counter() - start_time)
    benchmark.pedantic(lambda: None, rounds=1)
    aircraft = FLEETS * batches["perfect"][0].count * STEPS
    print(f"\nper aircraft and step in a batch of {FLEETS} fleets:")
    for name, seconds in durations.items():
        ratio = np.median(np.array(seconds) / np.array(durations["perfect"]))
        print(f"  {name}: {1e6 * min(seconds) / aircraft:.2f} us, {100 * (ratio - 1):+.0f} %")
        benchmark.extra_info[name] = float(ratio)
