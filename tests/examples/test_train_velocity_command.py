"""Training example: advantages, optimizer, learning of a toy task, a short training with the aircraft, and the goal."""

import dataclasses
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from anser.environments import make

SCRIPT = Path(__file__).parents[2] / "examples/train_velocity_command.py"
SPEC = importlib.util.spec_from_file_location("train_velocity_command", SCRIPT)
ppo = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(ppo)


class ToyState(eqx.Module):
    time: Array
    x: Array


class ToyEnvironment:
    """Point on a line, moved by up to 0.2 in a decision, with the reward 1 / (1 + (x / 0.2)^2)."""

    observed, num_actions, default_params = ("x",), 1, None
    task, level = SimpleNamespace(duration_s=20.0), SimpleNamespace(decision_s=1.0)

    def reset(self, key, params):
        x = jax.random.uniform(key, (), jnp.float32, -1.0, 1.0)
        return x[None], ToyState(jnp.zeros((), jnp.int32), x)

    def step(self, key, state, action, params):
        x = state.x + 0.2 * jnp.clip(action[0], -1.0, 1.0)
        time = state.time + 1
        truncated = time >= 20
        begin, begun = self.reset(key, params)
        following = jax.tree.map(lambda new, old: jnp.where(truncated, new, old), begun, ToyState(time, x))
        info = {"final_observation": x[None], "success": truncated & (jnp.abs(x) < 0.1)}
        observation = jnp.where(truncated, begin, x[None])
        return observation, following, 1.0 / (1.0 + (x / 0.2) ** 2), jnp.zeros((), bool), truncated, info


def rollout(reward, value, next_value, terminated, truncated):
    rows = (jnp.asarray(x) for x in (reward, value, next_value, terminated, truncated))
    reward, value, next_value, terminated, truncated = rows
    return ppo.Decision(None, None, None, value, next_value, reward, terminated, truncated, None)


def test_advantages_are_the_sums_of_their_definition():
    rng = np.random.default_rng(0)
    settings = ppo.Settings(gamma=0.9, lambda_=0.8)
    shape = 12, 3
    reward, value, next_value = rng.uniform(size=(3, *shape))
    ends = rng.uniform(size=shape)
    terminated, truncated = ends < 0.15, (ends > 0.15) & (ends < 0.3)
    assert terminated.any()
    assert truncated.any()
    advantage = ppo.advantages(rollout(reward, value, next_value, terminated, truncated), settings)
    for column in range(shape[1]):
        for first in range(shape[0]):
            expected, weight = 0.0, 1.0
            for k in range(first, shape[0]):
                after = 0.0 if terminated[k, column] else 0.9 * next_value[k, column]
                expected += weight * (0.1 * reward[k, column] + after - value[k, column])
                weight *= 0.9 * 0.8
                if terminated[k, column] or truncated[k, column]:
                    break
            np.testing.assert_allclose(advantage[first, column], expected, rtol=1e-12, atol=1e-14)


def test_a_truncated_episode_is_worth_its_last_observation_and_a_failed_one_nothing():
    ones, no = np.ones((5, 1)), np.zeros((5, 1), bool)
    end = no.copy()
    end[-1] = True
    settings = ppo.Settings(gamma=0.95)
    # The reward is 1 always, and its normalized discounted sum too: nothing surprises but a failure.
    np.testing.assert_allclose(ppo.advantages(rollout(ones, ones, ones, no, end), settings), 0.0, atol=1e-12)
    failed = ppo.advantages(rollout(ones, ones, ones, end, no), settings)
    np.testing.assert_allclose(failed[-1], -0.95, rtol=1e-12)


def test_adam_moves_by_the_rate_at_first_and_finds_the_minimum():
    target = jnp.asarray([3.0, -2.0])
    model = {"p": jnp.zeros(2)}
    zeros = jax.tree.map(jnp.zeros_like, model)
    training = ppo.Training(model, (zeros, zeros), jnp.zeros(()), None, None)
    training = ppo.adam(training, {"p": 2.0 * (training.model["p"] - target)}, 0.1, 0.5)
    np.testing.assert_allclose(training.model["p"], [0.1, -0.1], rtol=1e-4)
    for rate in np.linspace(0.1, 0.0, 300):
        training = ppo.adam(training, {"p": 2.0 * (training.model["p"] - target)}, rate, 0.5)
    np.testing.assert_allclose(training.model["p"], target, atol=1e-3)


@pytest.mark.long
def test_a_toy_task_is_learned_and_the_policy_survives_its_file(tmp_path):
    settings = ppo.Settings(environments=64, rollout=16, decisions=64 * 16 * 60, minibatches=4, gamma=0.9, width=16)
    model, rows = ppo.train(ToyEnvironment(), settings, seed=0)
    assert len(rows) == 60
    assert rows[-1]["decisions"] == settings.decisions
    # Straight to the middle: 5 decisions of 20 at most, 0.92 in the mean over starts; actions without effect: 0.29.
    assert np.mean([row["reward"] for row in rows[:2]]) < 0.5
    assert np.mean([row["reward"] for row in rows[-5:]]) > 0.85
    ppo.save_policy(model["policy"], tmp_path / "policy.npz")
    act = ppo.policy(ppo.load_policy(tmp_path / "policy.npz"))
    np.testing.assert_allclose(act(None, jnp.full(1, 0.9, jnp.float32), None, None)[0].clip(-1, 1), [-1.0], atol=0.1)
    again = ppo.train(ToyEnvironment(), dataclasses.replace(settings, decisions=64 * 16), seed=0)[1]
    assert again[0]["reward"] == rows[0]["reward"]


@pytest.mark.long
def test_a_few_updates_with_the_aircraft_have_finite_figures():
    settings = ppo.Settings(environments=8, rollout=8, decisions=8 * 8 * 3, minibatches=2, epochs=2)
    model, rows = ppo.train(make("VelocityCommand", "rates", precision="float32", cases=16), settings, seed=0)
    assert len(rows) == 3
    assert all(np.isfinite(list(row.values())).all() for row in rows)
    assert all(0.0 < row["reward"] < 1.0 for row in rows)
    assert all(leaf.dtype == jnp.float32 and bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(model))


@pytest.mark.long
def test_the_training_reaches_its_goal(tmp_path):
    # Optimized code, unlike that of the other tests; half of the default decisions suffice for the goal.
    environment = {name: text for name, text in os.environ.items() if name != "XLA_FLAGS"}
    command = [sys.executable, SCRIPT, "--seed", "3", "--decisions", "2e7", "--out", tmp_path]
    printed = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    share = float(re.search(r"\(expert - random\) = ([\d.]+)", printed)[1])
    assert share >= ppo.GOAL
    assert (tmp_path / "curve.png").stat().st_size > 10_000
    assert ppo.load_policy(tmp_path / "seed-3.npz")[-1][1].shape == (4,)
