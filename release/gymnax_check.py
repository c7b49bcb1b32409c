"""gymnax's own wrappers fly every task of one aircraft, with the results of the environment itself.

    python release/gymnax_check.py

gymnax 1.0.1 needs older libraries than anser may have: the check makes an environment of its own in a temporary folder,
with this clone, and runs there. `--here` runs it with the present interpreter.
"""

import argparse
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
# gymnax imports six, which it does not declare
LIBRARIES = ("gymnax==1.0.1", "jax==0.10.1", "gymnasium==1.3.0", "six")
DECISIONS = 20
ENVIRONMENTS = 3


def main() -> int:
    """Run the check; returns 1 if a task fails."""
    parser = argparse.ArgumentParser(description="Fly every task with gymnax's wrappers.")
    parser.add_argument("--here", action="store_true", help="with the present interpreter")
    if parser.parse_args().here:
        return _fly_tasks()
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python = Path(folder) / "bin" / "python"
        subprocess.run([python, "-m", "pip", "install", "--quiet", *LIBRARIES, "-e", str(ROOT)], check=True)
        return subprocess.run([python, __file__, "--here"], check=False).returncode


def _fly_tasks() -> int:
    sys.path.insert(0, str(ROOT / "examples"))
    from anser.environments import TASKS, AbstractPlannedTask, make

    failures = 0
    for task, factory in TASKS.items():
        if task == "FleetArrival":  # gymnax has no environments of several agents
            continue
        levels = factory().levels
        level = "rates" if "rates" in levels else levels[0]
        cases = {} if issubclass(factory, AbstractPlannedTask) else {"cases": 64}  # the study has those of a plan
        environment = make(task, level, **cases)
        for check in (_check_contract, _check_logged, _check_gymnasium, _check_vector):
            try:
                check(environment)
            except AssertionError as error:
                failures += 1
                sys.stdout.write(f"{task} {check.__name__.removeprefix('_check_')}: {error}\n")
        sys.stdout.write(f"{task}: flown by gymnax's wrappers at level {level}\n")
        sys.stdout.flush()
    return min(failures, 1)


def _actions(environment: Any) -> Any:
    import numpy as np

    shape = DECISIONS, ENVIRONMENTS, environment.num_actions
    return np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)


def _equal(result: Any, expected: Any) -> None:
    import numpy as np

    # observations are float32, and the wrappers' programs round otherwise
    np.testing.assert_allclose(np.asarray(result), np.asarray(expected), rtol=0.0, atol=2e-6)


def _check_contract(environment: Any) -> None:
    """Compare gymnax's class with the environment: spaces, observations, six values."""
    import jax
    from gymnax.environments.environment import Environment
    from gymnax_wrappers import GymnaxEnvironment

    adapted, params = GymnaxEnvironment(environment), environment.default_params
    assert isinstance(adapted, Environment)
    assert adapted.supports_transition_gradients
    assert adapted.with_transition_gradients().transition_gradients_enabled
    assert adapted.action_space(params).shape == (environment.num_actions,)
    key = jax.random.key(1)
    observation, state = adapted.reset(key, params)
    _equal(observation, environment.reset(key)[0])
    _equal(adapted.observe(key, state, None, params), observation)
    assert len(adapted.step(key, state, _actions(environment)[0, 0])) == 6


def _check_logged(environment: Any) -> None:
    """Compare LogWrapper around FlattenObservationWrapper with the environment, without an adapter."""
    import jax
    from gymnax.wrappers.purerl import FlattenObservationWrapper, LogWrapper

    wrapped = LogWrapper(FlattenObservationWrapper(environment))
    key = jax.random.key(2)
    observation, state = wrapped.reset(key, environment.default_params)
    expected, plain = environment.reset(key)
    _equal(observation, expected)
    step, total = jax.jit(environment.step), 0.0
    for number, actions in enumerate(_actions(environment)):
        step_key = jax.random.fold_in(key, number)
        observation, state, reward, *_ = wrapped.step(step_key, state, actions[0], environment.default_params)
        expected, plain, plain_reward, *_ = step(step_key, plain, actions[0])
        _equal(observation, expected)
        total += float(plain_reward)
        _equal(reward, plain_reward)
    assert abs(float(state.episode_returns) - total) < 1e-4


def _check_gymnasium(environment: Any) -> None:
    """Compare GymnaxToGymWrapper with the environment."""
    import jax
    from gymnax.wrappers.gym import GymnaxToGymWrapper
    from gymnax_wrappers import GymnaxEnvironment

    wrapped = GymnaxToGymWrapper(GymnaxEnvironment(environment), seed=3)
    key, reset_key = jax.random.split(jax.random.key(3))
    expected, state = environment.reset(reset_key)
    _equal(wrapped.reset(seed=3)[0], expected)
    step = jax.jit(environment.step)
    for actions in _actions(environment):
        key, step_key = jax.random.split(key)
        expected, state, *_ = step(step_key, state, actions[0])
        _equal(wrapped.step(actions[0])[0], expected)


def _check_vector(environment: Any) -> None:
    """Compare GymnaxToVectorGymWrapper with the environment."""
    import jax
    from gymnax.wrappers.gym import GymnaxToVectorGymWrapper
    from gymnax_wrappers import GymnaxEnvironment

    wrapped = GymnaxToVectorGymWrapper(GymnaxEnvironment(environment), ENVIRONMENTS, seed=4)
    split = jax.vmap(jax.random.split, out_axes=1)
    keys, reset_keys = split(jax.random.split(jax.random.key(4), ENVIRONMENTS))
    expected, state = jax.vmap(environment.reset)(reset_keys)
    _equal(wrapped.reset(seed=4)[0], expected)
    step = jax.jit(jax.vmap(environment.step))
    for actions in _actions(environment):
        keys, step_keys = split(keys)
        expected, state, rewards, *_ = step(step_keys, state, actions)
        result, wrapped_rewards, *_ = wrapped.step(actions)
        _equal(result, expected)
        _equal(wrapped_rewards, rewards)


if __name__ == "__main__":
    sys.exit(main())
