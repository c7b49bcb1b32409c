"""A hundred thousand published three-aircraft missions on a GPU: `python benchmarks/gpu_missions.py`.

Needs JAX with CUDA: `pip install "jax[cuda12]"` beside anser. Starts are dispersed by 50 m; 100 Hz, 150 s, a plan
renewed every second, the summary kept. Compilation is told apart. The first 256 fleets fly on the CPU too, in float64:
told is how their misses differ. With a small `--fleets` it runs without a GPU, to be tried.

The two runs to take: `python benchmarks/gpu_missions.py`, whose misses are to be those of the CPU to 1e-6 m in 99 % of
the missions, and `python benchmarks/gpu_missions.py --fleets 1000000 --batch 65536 --precision float32`.
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
from jaxtyping import Array

import anser
from anser.planning.published.planner import PublishedPlanner
from anser.scenario import build_flight
from anser.simulation import Flight, FlightState, SummaryRecorder, fly, start_flight
from anser.simulation.flight import SEGMENT_STEPS
from anser.simulation.precision import PRECISIONS, Precision, cast_flight, cast_state

SCENARIO = Path(__file__).parents[1] / "scenarios" / "three-aircraft.toml"
SPREAD_M = 50.0
COMPARED = 256
AGREE_M = 1e-6


class Batch(NamedTuple):
    """Misses (fleet, aircraft), m, and seconds: to compile, to fly."""

    misses: np.ndarray
    compiling_s: float
    flying_s: float


def moved(flight: Flight, offset_n: Array) -> Flight:
    """The flight with other starts; `offset_n` (aircraft, 3), m, for aircraft of one kind."""
    (kind,) = flight.groups
    kind = dataclasses.replace(kind, start_positions_n=kind.start_positions_n + offset_n)
    assert isinstance(flight.planner, PublishedPlanner)
    starts_n = flight.planner.start_positions_n + offset_n
    return dataclasses.replace(
        flight, groups=(kind,), planner=eqx.tree_at(lambda p: p.start_positions_n, flight.planner, starts_n)
    )


def fly_all(offsets_n: np.ndarray, batch: int, device: Any, duration_s: float, precision: Precision) -> Batch:
    """Fly fleets with these offsets (fleet, aircraft, 3) in batches; the first is flown twice, once to compile."""
    flight = build_flight(anser.load(SCENARIO))
    steps = round(duration_s / float(flight.timing.step))
    recorder = SummaryRecorder(last_sample=jnp.asarray(steps, dtype=jnp.int32))

    @jax.jit
    def started(offset_n: Array) -> FlightState:
        return jax.vmap(lambda one: cast_state(start_flight(moved(flight, one))[0], precision))(offset_n)

    @eqx.filter_jit
    def segment(offset_n: Array, state: FlightState, memory: tuple, since: Array) -> tuple:
        def one(offset_n: Array, state: FlightState, memory: tuple) -> tuple:
            own = cast_flight(moved(flight, offset_n), precision)
            return fly(own, state, since, SEGMENT_STEPS, recorder, memory)[:2]

        return jax.vmap(one)(offset_n, state, memory)

    def flown(offset_n: np.ndarray, last_sample: int) -> np.ndarray:
        rows = np.concatenate([offset_n, np.repeat(offset_n[-1:], batch - len(offset_n), axis=0)])
        placed = jax.device_put(rows, device)
        state = started(placed)
        memory = jax.tree.map(
            lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, dtype=leaf.dtype), (batch, *leaf.shape)),
            recorder.init(flight.count),
        )
        for since in range(0, last_sample + 1, SEGMENT_STEPS):
            state, memory = segment(placed, state, memory, jnp.asarray(since, dtype=jnp.int32))
        return np.asarray(memory[0].miss)[: len(offset_n)]

    with jax.default_device(device):
        began = time.perf_counter()
        flown(offsets_n[:1], SEGMENT_STEPS)  # twice: the second call may be another program
        compiling_s, began = time.perf_counter() - began, time.perf_counter()
        parts = [flown(offsets_n[k : k + batch], steps) for k in range(0, len(offsets_n), batch)]
        return Batch(np.concatenate(parts), compiling_s, time.perf_counter() - began)


def main() -> None:
    """Fly, compare with the CPU, print."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--fleets", type=int, default=100_000)
    asked.add_argument("--batch", type=int, default=16_384, help="fleets of one call: as many as the memory takes")
    asked.add_argument("--duration-s", type=float, default=150.0)
    asked.add_argument("--precision", choices=PRECISIONS, default="float64", help="in which they fly")
    given = asked.parse_args()
    device = jax.devices()[0]
    offsets_n = SPREAD_M * np.random.default_rng(1).standard_normal((given.fleets, 3, 3)) * np.array([1.0, 1.0, 0.0])
    batch = min(given.batch, given.fleets)
    flown = fly_all(offsets_n, batch, device, given.duration_s, given.precision)
    steps = given.fleets * 3 * given.duration_s / 0.01
    print(
        f"{device.device_kind}, {given.precision}: {given.fleets} missions of {given.duration_s:g} s in "
        f"{flown.flying_s:.1f} s, after {flown.compiling_s:.1f} s of compiling; "
        f"{1e6 * flown.flying_s / steps:.4f} us per aircraft and step; greatest miss {np.max(flown.misses):.3f} m"
    )
    compared = min(COMPARED, given.fleets)
    cpu = fly_all(offsets_n[:compared], min(128, compared), jax.devices("cpu")[0], given.duration_s, "float64")
    off = np.abs(cpu.misses - flown.misses[:compared]).max(axis=1)
    print(
        f"the same miss as on the CPU in float64 to {AGREE_M:g} m: {100 * np.mean(off <= AGREE_M):.1f} % of {compared} "
        f"missions; difference of the median mission {np.median(off):.2g} m, of 99 % at most "
        f"{np.quantile(off, 0.99):.2g} m, of all {off.max():.2g} m"
    )


if __name__ == "__main__":
    main()
