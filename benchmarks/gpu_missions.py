"""A hundred thousand published three-aircraft missions on a GPU: `python benchmarks/gpu_missions.py`.

Needs JAX with CUDA: `pip install "jax[cuda12]"` in addition to anser. Starts are dispersed by 50 m; 100 Hz, 150 s,
replanning every second, summary only. Compilation time is printed separately. The first 256 fleets also fly on the CPU
in float64, for a comparison of the misses. A small `--fleets` runs without a GPU as a trial.

The two standard runs: `python benchmarks/gpu_missions.py`, whose misses must equal the CPU's to 1e-6 m in 99 % of the
missions, and `python benchmarks/gpu_missions.py --fleets 1000000 --batch 65536 --precision float32`.
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
from anser.simulation.flight import PRECISIONS, SEGMENT_STEPS, Precision, cast_flight, cast_state

SCENARIO = Path(__file__).parents[1] / "scenarios" / "three-aircraft.toml"
SPREAD_M = 50.0
COMPARED = 256
AGREE_M = 1e-6


class Batch(NamedTuple):
    """Misses (fleet, aircraft), m, and times of compilation and flight, s."""

    misses: np.ndarray
    compiling_s: float
    flying_s: float


def moved(flight: Flight, offset_n: Array) -> Flight:
    """The flight with offset starts; `offset_n` (aircraft, 3), m, for a single aircraft group."""
    (group,) = flight.groups
    group = dataclasses.replace(group, start_positions_n=group.start_positions_n + offset_n)
    assert isinstance(flight.planner, PublishedPlanner)
    starts_n = flight.planner.start_positions_n + offset_n
    return dataclasses.replace(
        flight, groups=(group,), planner=eqx.tree_at(lambda p: p.start_positions_n, flight.planner, starts_n)
    )


def fly_all(offsets_n: np.ndarray, batch: int, device: Any, duration_s: float, precision: Precision) -> Batch:
    """Fly fleets with given offsets (fleet, aircraft, 3) in batches, after a short first flight to compile."""
    flight = build_flight(anser.load(SCENARIO))
    steps = round(duration_s / float(flight.timing.step))
    recorder = SummaryRecorder(last_sample=jnp.asarray(steps, dtype=jnp.int32))

    @jax.jit
    def started(offset_n: Array) -> FlightState:
        return jax.vmap(lambda fleet_offset: cast_state(start_flight(moved(flight, fleet_offset))[0], precision))(
            offset_n
        )

    @eqx.filter_jit
    def segment(offset_n: Array, state: FlightState, memory: tuple, step: Array) -> tuple:
        def fly_one(offset_n: Array, state: FlightState, memory: tuple) -> tuple:
            moved_flight = cast_flight(moved(flight, offset_n), precision)
            return fly(moved_flight, state, step, SEGMENT_STEPS, recorder, memory)[:2]

        return jax.vmap(fly_one)(offset_n, state, memory)

    def flown(offset_n: np.ndarray, last_sample: int) -> np.ndarray:
        padded_offsets = np.concatenate([offset_n, np.repeat(offset_n[-1:], batch - len(offset_n), axis=0)])
        placed = jax.device_put(padded_offsets, device)
        state = started(placed)
        memory = jax.tree.map(
            lambda leaf: jnp.broadcast_to(jnp.asarray(leaf, dtype=leaf.dtype), (batch, *leaf.shape)),
            recorder.init(flight.count),
        )
        for step in range(0, last_sample + 1, SEGMENT_STEPS):
            state, memory = segment(placed, state, memory, jnp.asarray(step, dtype=jnp.int32))
        return np.asarray(memory[0].miss)[: len(offset_n)]

    with jax.default_device(device):
        began = time.perf_counter()
        flown(offsets_n[:1], SEGMENT_STEPS)  # two segments, because the second call may compile another program
        compiling_s, began = time.perf_counter() - began, time.perf_counter()
        parts = [flown(offsets_n[k : k + batch], steps) for k in range(0, len(offsets_n), batch)]
        return Batch(np.concatenate(parts), compiling_s, time.perf_counter() - began)


def main() -> None:
    """Fly, compare with the CPU, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=100_000)
    parser.add_argument("--batch", type=int, default=16_384, help="fleets of one call: as many as the memory takes")
    parser.add_argument("--duration-s", type=float, default=150.0)
    parser.add_argument("--precision", choices=PRECISIONS, default="float64", help="in which they fly")
    options = parser.parse_args()
    device = jax.devices()[0]
    offsets_n = SPREAD_M * np.random.default_rng(1).standard_normal((options.fleets, 3, 3)) * np.array([1.0, 1.0, 0.0])
    batch = min(options.batch, options.fleets)
    flown = fly_all(offsets_n, batch, device, options.duration_s, options.precision)
    steps = options.fleets * 3 * options.duration_s / 0.01
    print(
        f"{device.device_kind}, {options.precision}: {options.fleets} missions of {options.duration_s:g} s in "
        f"{flown.flying_s:.1f} s, after {flown.compiling_s:.1f} s of compiling; "
        f"{1e6 * flown.flying_s / steps:.4f} us per aircraft and step; greatest miss {np.max(flown.misses):.3f} m"
    )
    compared = min(COMPARED, options.fleets)
    cpu = fly_all(offsets_n[:compared], min(128, compared), jax.devices("cpu")[0], options.duration_s, "float64")
    difference = np.abs(cpu.misses - flown.misses[:compared]).max(axis=1)
    print(
        f"the same miss as on the CPU in float64 to {AGREE_M:g} m: {100 * np.mean(difference <= AGREE_M):.1f} % of "
        f"{compared} missions; difference of the median mission {np.median(difference):.2g} m, of 99 % at most "
        f"{np.quantile(difference, 0.99):.2g} m, of all {difference.max():.2g} m"
    )


if __name__ == "__main__":
    main()
