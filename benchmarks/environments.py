"""Speed of the environments for learning, in integration steps of 0.01 s per second of wall time.

`python benchmarks/environments.py --levels surfaces velocity --precision float64` measures the whole step with reward
and reset under `jax.vmap` in a scan, each core with a part of the batch (`jax.shard_map`, XLA's older code generator),
Gymnasium's vector of 1,024 beside it, and what the reset adds to a step. Times are the least of several rounds in
turns, so that other work on the machine counts little.
"""

import argparse
import dataclasses
import os
import time
from collections.abc import Callable

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, NamedSharding, PartitionSpec

import anser.environments.gymnasium_environments  # noqa: F401 - registers the tasks
from anser.compiling.options import OLDER_GENERATOR
from anser.compiling.program import supported_options
from anser.environments import AircraftEnvironment, make
from anser.simulation.flight import PRECISIONS

DECISIONS = {"surfaces": 60, "rates": 12, "velocity": 6}
VECTOR = 1024


def random_actions(environment: AircraftEnvironment, count: int) -> np.ndarray:
    """Actions of moderate size, the same in every decision."""
    return 0.3 * np.random.default_rng(0).uniform(-1.0, 1.0, (count, environment.num_actions)).astype(np.float32)


def loop_of(environment: AircraftEnvironment, count: int, decisions: int, *, has_reset: bool) -> Callable[[], object]:
    """Function that flies decisions of many environments in a scan, by `step` or, without reset, by `step_env`."""
    keys, actions = jax.random.split(jax.random.key(0), (decisions, count)), random_actions(environment, count)
    start = jax.jit(jax.vmap(environment.reset, (0, None)))(keys[0], environment.default_params)[1]
    step = jax.vmap(environment.step if has_reset else environment.step_env, (0, 0, 0, None))

    def fly(keys, state, actions, params):
        def advance(carry, step_keys):
            # Without a reset the case is the same in all steps, and XLA would look its values up before the loop.
            state = dataclasses.replace(carry[1], row=jnp.where(carry[1].time < 0, 0, carry[1].row))
            # The whole observation is carried on, so that none of it is left out.
            observation, state, reward, *_ = step(step_keys, state, actions, params)
            return (observation, state), reward

        observation = jax.vmap(environment.observe)(keys[0], state)
        return jax.lax.scan(advance, (observation, state), keys)

    mesh = jax.make_mesh((jax.device_count(),), ("core",), axis_types=(AxisType.Auto,))
    rows, columns, whole = PartitionSpec("core"), PartitionSpec(None, "core"), PartitionSpec()
    keys, params = (
        jax.device_put(x, NamedSharding(mesh, s)) for x, s in ((keys, columns), (environment.default_params, whole))
    )
    start, actions = jax.device_put((start, actions), NamedSharding(mesh, rows))
    program = jax.shard_map(
        fly, mesh=mesh, in_specs=(columns, rows, rows, whole), out_specs=(rows, columns), check_vma=False
    )
    compiled = jax.jit(program, compiler_options=supported_options(OLDER_GENERATOR))
    return lambda: jax.block_until_ready(compiled(keys, start, actions, params))


def vector_of(environment: AircraftEnvironment, decisions: int) -> Callable[[], object]:
    """Function that flies decisions of Gymnasium's vector."""
    vector = gymnasium.make_vec("anser/VelocityCommand-v0", num_envs=VECTOR, task=environment)
    vector.reset(seed=0)
    actions = random_actions(environment, VECTOR)

    def fly() -> None:
        for _ in range(decisions):
            vector.step(actions)

    return fly


def least_times(functions: list[Callable[[], object]], rounds: int) -> np.ndarray:
    """Least wall time of each function over rounds in turns after a first one, s."""
    times = np.full((rounds + 1, len(functions)), np.inf)
    for row in times:
        for index, function in enumerate(functions):
            begin = time.perf_counter()
            function()
            row[index] = time.perf_counter() - begin
    return np.min(times[1:], axis=0)


def main() -> None:
    """Print a row for each level and precision."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", nargs="*", choices=tuple(DECISIONS), default=list(DECISIONS))
    parser.add_argument("--precision", nargs="*", choices=PRECISIONS, default=list(PRECISIONS))
    parser.add_argument("--many", type=int, default=16384, help="environments of the second size; 0: none")
    parser.add_argument("--rounds", type=int, default=20)
    arguments = parser.parse_args()
    jax.config.update("jax_num_cpu_devices", os.cpu_count())
    many = arguments.many
    print(f"| level | precision | {VECTOR:,} | Gymnasium's vector of {VECTOR:,} | added by the reset | {many:,} |")
    for level in arguments.levels:
        for precision in arguments.precision:
            environment, decisions = make("VelocityCommand", level, cases=256, precision=precision), DECISIONS[level]
            functions = [loop_of(environment, VECTOR, decisions, has_reset=flag) for flag in (True, False)]
            functions.append(vector_of(environment, decisions))
            whole_s, bare_s, vector_s = least_times(functions, arguments.rounds)
            steps = decisions * environment.decision_steps
            cells = [f"{VECTOR * steps / whole_s:.3g} /s", f"{100.0 * whole_s / vector_s:.0f} %"]
            cells.append(f"{100.0 * (whole_s / bare_s - 1.0):.1f} %")
            if many:
                loop = loop_of(environment, many, decisions, has_reset=True)
                cells.append(f"{many * steps / least_times([loop], 3)[0]:.3g} /s")
            print(f"| {level} | {precision} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
