"""Time per step of the closed loop with different airframes, relative to the built-in F-16, in pairs in one process.

Each airframe holds its trim with the velocity loop of its autopilot (default gains of the aircraft; the published gains
of the F-16), alone and in a batch. A pair is a run of the built-in F-16 and one of the other airframe; the ratio is the
median over the pairs.

    python benchmarks/bench_airframes.py [--batch 1024] [--pairs 7] [--seconds 2]
"""

import argparse
import statistics
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp

from anser.analysis.step_flights import StepCase, step_case
from anser.analysis.trim_points import resolve_airframe
from anser.environment import standard_environment
from anser.numerics.arrays import as_array
from anser.simulation.response import LoopCase, ResponseRecorder, loop_flight

CASES = (
    ("f16", "textbook", 150.0, 1000.0),
    ("aerosonde", "textbook", 25.0, 300.0),
    ("scenarios/own-aircraft/trainer.toml", "textbook", 50.0, 1000.0),
    ("nasa-f16", "textbook", 150.0, 1000.0),
    ("f16", "tp1538", 150.0, 1000.0),
)
STEP_S = 0.01
MOST = 1.3
"""Accepted cost of an aircraft from a file, relative to the built-in F-16."""


def flier(case: StepCase, count: int, batch: int | None) -> Callable[[], None]:
    """A compiled flight of `count` steps at trim, of one aircraft or of a batch with different initial airspeeds."""
    environment = standard_environment()
    loop = LoopCase(case.airframe, environment, case.gains, case.limits, case.trim, STEP_S)
    path = jnp.stack([jnp.linalg.norm(case.trim.state.velocity_b), as_array(0.0), as_array(0.0)])

    def fly_one(value: jax.Array) -> jax.Array:
        return loop_flight(loop, value, count, "velocity", ResponseRecorder(loop="velocity", stride=count)).measured

    fly = jax.jit(fly_one if batch is None else jax.vmap(fly_one))
    start = path if batch is None else path + jnp.zeros((batch, 3)).at[:, 0].set(jnp.linspace(0.0, 0.5, batch))
    fly(start).block_until_ready()
    return lambda: fly(start).block_until_ready()


def seconds(run: Callable[[], None]) -> float:
    """Wall-clock time of a run."""
    start_time = time.perf_counter()
    run()
    return time.perf_counter() - start_time


def main() -> None:
    """Time the pairs and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--batch", type=int, default=1024)
    parser.add_argument("--pairs", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=2.0, help="of flight in a run of one aircraft")
    parser.add_argument("--only", nargs="*", default=[], help="names of airframes or variants")
    options = parser.parse_args()
    chosen = [
        case_key
        for case_key in CASES[1:]
        if not options.only or case_key[0] in options.only or case_key[1] in options.only
    ]
    for batch in (None, options.batch):
        count = round(options.seconds / STEP_S) if batch is None else max(round(0.1 * options.seconds / STEP_S), 2)
        runs = {}
        for name, variant, speed, altitude in (CASES[0], *chosen):
            case = step_case(resolve_airframe(name, variant)[0], speed, altitude, "model")
            runs[name, variant] = flier(case, count, batch)
        built_in = runs[CASES[0][:2]]
        for key, run in runs.items():
            if key == CASES[0][:2]:
                continue
            pairs = [(seconds(built_in), seconds(run)) for _ in range(options.pairs)]
            ratio = statistics.median(run_s / reference_s for reference_s, run_s in pairs)
            microseconds = statistics.median(run_s for _, run_s in pairs) / count / (batch or 1) * 1e6
            label = f"{key[0]} {key[1]}" if key[0] == "f16" else key[0]
            size = "alone" if batch is None else f"batch of {batch}"
            verdict = "" if ratio <= MOST else f"  above {MOST:g}"
            print(
                f"{label:40s} {size:14s} {microseconds:8.2f} us per aircraft and step, "
                f"{ratio:5.2f} times the built-in{verdict}",
                flush=True,
            )


if __name__ == "__main__":
    main()
