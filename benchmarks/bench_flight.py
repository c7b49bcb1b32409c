"""Speed of the three-aircraft flight relative to real time, of compilation, and of a second run; `make bench`.

Compare ratios within one run: absolute times depend on the machine and its load.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.numerics import make_axes, make_tables
from anser.scenario import build_flight
from anser.simulation import SummaryRecorder, fly, start_flight
from anser.simulation.flight import SEGMENT_STEPS

ZERO = jnp.asarray(0, dtype=jnp.int32)
THREE = Path(__file__).parents[1] / "scenarios" / "three-aircraft.toml"


@pytest.fixture(scope="module")
def compiled():
    """Flight, start state and compiled segment, with the time to trace and compile them (no cache), s."""
    jax.config.update("jax_compilation_cache_dir", None)
    flight = build_flight(anser.load(THREE))
    start_time = time.perf_counter()
    start = jax.jit(start_flight).lower(flight).compile()
    state, _ = start(flight)
    segment = eqx.filter_jit(fly).lower(flight, state, ZERO).compile()
    return flight, state, segment, time.perf_counter() - start_time


def test_compilation(compiled, benchmark):
    seconds = compiled[3]
    print(f"\ncompilation of planning and flight: {seconds:.1f} s (wanted: under 30 s)")
    benchmark.extra_info["compile_s"] = seconds
    benchmark.pedantic(lambda: None, rounds=1)


def test_three_aircraft_against_real_time(compiled, benchmark):
    flight, state, segment, _ = compiled
    simulated = 12 * SEGMENT_STEPS * float(flight.timing.step)

    def fly():
        carry = state
        for _ in range(12):
            carry, _, history = segment(flight, carry, ZERO)
        jax.block_until_ready(history)

    benchmark.pedantic(fly, rounds=5, warmup_rounds=1)
    ratio = simulated / benchmark.stats.stats.median
    print(f"\nthree aircraft, {simulated:g} s, every step recorded: {ratio:.0f} times real time (wanted: 100)")
    benchmark.extra_info["times_real_time"] = ratio


def test_a_batch_of_flights_against_one_alone(compiled, benchmark):
    """1,024 flights with different starts and the running summary: time per aircraft and step against one flight."""
    flight, state, _, _ = compiled
    count, aircraft = 1024, flight.count
    shifts = 50.0 * jnp.asarray(np.random.default_rng(0).normal(size=(count, aircraft, 3)))

    def moved(shift_n):
        positions = state.vehicles[0].aircraft.position_n + shift_n
        return eqx.tree_at(lambda s: s.vehicles[0].aircraft.position_n, state, positions)

    @eqx.filter_jit
    def summed_up(flight, states, step):
        def one(start):
            return fly(flight, start, step, SEGMENT_STEPS, SummaryRecorder())[1][0]

        return jax.vmap(one)(states)

    states, alone = jax.vmap(moved)(shifts), jax.tree.map(lambda leaf: leaf[None], state)
    times = {}
    for name, batch_states in (("alone", alone), ("batch", states)):
        jax.block_until_ready(summed_up(flight, batch_states, ZERO))
        durations = []
        for _ in range(5 if name == "alone" else 2):
            start_time = time.perf_counter()
            jax.block_until_ready(summed_up(flight, batch_states, ZERO))
            durations.append(time.perf_counter() - start_time)
        flights = 1 if name == "alone" else count
        times[name] = 1e6 * min(durations) / (flights * aircraft * SEGMENT_STEPS)
    benchmark.pedantic(lambda: None, rounds=1)
    ratio = times["batch"] / times["alone"]
    print(
        f"\nper aircraft and step: {times['alone']:.1f} us alone, {times['batch']:.2f} us in a batch of {count}; "
        f"ratio {ratio:.2f} (wanted: a third)"
    )
    benchmark.extra_info.update(times)


def test_second_run_of_the_command(benchmark, tmp_path):
    environment = {**os.environ, "ANSER_COMPILATION_CACHE": str(tmp_path / "cache")}
    program = Path(sys.executable).with_name("anser")

    def run(out):
        subprocess.run([program, "run", THREE, "--out", out], env=environment, check=True, capture_output=True)

    start_time = time.perf_counter()
    run(tmp_path / "first")
    first_s = time.perf_counter() - start_time
    count = iter(range(100))
    benchmark.pedantic(lambda: run(tmp_path / f"again-{next(count)}"), rounds=3)
    print(f"\nanser run: first {first_s:.1f} s, again {benchmark.stats.stats.median:.1f} s (wanted: under 10 s)")


def _surfaces_by_corners(x, y, values, at):
    """Bilinear lookup with four gathers per table: the reference for packed tables."""
    i = jnp.clip(jnp.searchsorted(x, at[0]) - 1, 0, x.shape[0] - 2)
    j = jnp.clip(jnp.searchsorted(y, at[1]) - 1, 0, y.shape[0] - 2)
    u, v = (at[0] - x[i]) / (x[i + 1] - x[i]), (at[1] - y[j]) / (y[j + 1] - y[j])
    low = values[:, i, j] * (1 - u) + values[:, i + 1, j] * u
    high = values[:, i, j + 1] * (1 - u) + values[:, i + 1, j + 1] * u
    return low * (1 - v) + high * v


def test_packed_tables_against_separate_gathers(benchmark):
    random = np.random.default_rng(0)
    x, y = np.arange(-10.0, 46.0, 5.0), np.arange(-30.0, 31.0, 5.0)
    values = random.normal(size=(6, x.size, y.size))
    packed = make_tables(make_axes([x, y], clamp=False), [((0, 1), list(values))])
    points = jnp.asarray(random.uniform([-10, -30], [45, 30], size=(4096, 2)))
    xs, ys, table = jnp.asarray(x), jnp.asarray(y), jnp.asarray(values)

    def repeated(look_up):
        def body(carry, _):
            result = jax.vmap(look_up)(points + carry)
            return 1e-9 * jnp.mean(result), None

        return eqx.filter_jit(lambda: jax.lax.scan(body, jnp.zeros(()), length=100)[0])

    packed_lookup = repeated(lambda at: packed(at[0], at[1])[0])
    separate_lookup = repeated(lambda at: _surfaces_by_corners(xs, ys, table, at))
    jax.block_until_ready((packed_lookup(), separate_lookup()))
    start_time = time.perf_counter()
    for _ in range(5):
        jax.block_until_ready(separate_lookup())
    separate = (time.perf_counter() - start_time) / 5
    benchmark.pedantic(lambda: jax.block_until_ready(packed_lookup()), rounds=5, warmup_rounds=1)
    print(f"\nseparate gathers take {separate / benchmark.stats.stats.median:.2f} times as long as packed cells")
