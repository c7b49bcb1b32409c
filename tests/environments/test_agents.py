"""Fleets for PettingZoo and JaxMARL, on a small fleet of points whose steps are known."""

import dataclasses
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from anser.environments.episodes import record_flight
from anser.environments.fleet import AgentDictionaries
from anser.environments.pettingzoo_environments import FleetParallelEnvironment
from anser.environments.spaces import Box

LENGTH = 7


class PointState(eqx.Module):
    time: jax.Array
    positions: jax.Array


@dataclasses.dataclass(frozen=True)
class PointFleet:
    """Points on a line, with the contract of the package's fleets: the action is a step, and too far is a failure."""

    name = "PointFleet"
    agents = ("alpha", "bravo", "charlie")
    default_params = None

    def observation_space(self, params=None):
        return Box(-np.inf, np.inf, (2,))

    def action_space(self, params=None):
        return Box(-1.0, 1.0, (1,))

    def reset(self, key, params=None):
        state = PointState(jnp.zeros((), jnp.int32), jax.random.uniform(key, (3,)))
        return self.observations(state), state

    def observations(self, state):
        return jnp.stack([state.positions, jnp.full(3, state.time)], axis=-1).astype(jnp.float32)

    def step_env(self, key, state, action, params=None):
        flown = PointState(state.time + 1, state.positions + action[:, 0])
        terminated = jnp.max(jnp.abs(flown.positions)) > 5.0
        truncated = ~terminated & (flown.time >= LENGTH)
        observations = self.observations(flown)
        info = {"final_observation": observations, "success": truncated, "truncated": truncated}
        return observations, flown, -jnp.abs(flown.positions), terminated, info

    def step(self, key, state, action, params=None):
        observations, flown, rewards, terminated, info = self.step_env(key, state, action, params)
        is_over = terminated | info["truncated"]
        start, fresh = self.reset(key, params)
        state = jax.tree.map(lambda new, old: jnp.where(is_over, new, old), fresh, flown)
        return jnp.where(is_over, start, observations), state, rewards, terminated, info["truncated"], info


@dataclasses.dataclass(frozen=True)
class Point:
    """One of the points alone: an environment without agents."""

    name = "Point"
    default_params = None
    reset, step_env, step = PointFleet.reset, PointFleet.step_env, PointFleet.step
    observations = PointFleet.observations


def test_the_fleet_passes_pettingzoos_test_without_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(FleetParallelEnvironment(PointFleet()), num_cycles=100)


def test_an_environment_of_one_aircraft_is_no_fleet():
    with pytest.raises(ValueError, match="task: arrived Point, a task of one aircraft; expected a task of a fleet"):
        FleetParallelEnvironment(Point())


def test_a_fleet_in_pettingzoo_ends_for_every_agent_at_once():
    fleet = FleetParallelEnvironment(PointFleet())
    starts, infos = fleet.reset(seed=4)
    expected = PointFleet().reset(jax.random.fold_in(jax.random.key(4), 0))[0]
    assert set(infos) == set(fleet.agents) == set(PointFleet.agents)
    for _ in range(LENGTH - 1):
        assert fleet.step({agent: [0.5] for agent in fleet.agents})[3] == dict.fromkeys(fleet.agents, False)
    results = fleet.step({"charlie": [-1.0], "alpha": [0.0], "bravo": [1.0]})
    for k, agent in enumerate(PointFleet.agents):
        np.testing.assert_array_equal(starts[agent], expected[k])
        position = expected[k, 0] + 0.5 * (LENGTH - 1) + (0.0, 1.0, -1.0)[k]
        np.testing.assert_allclose(results[0][agent], [position, LENGTH], rtol=1e-6)
        assert results[1][agent] == pytest.approx(-abs(float(position)))
        assert (results[2][agent], results[3][agent], results[4][agent]) == (False, True, {"is_success": True})
    assert fleet.agents == []
    with pytest.raises(ValueError, match="after the end of the episode"):
        fleet.step({})
    assert fleet.reset()[0]["alpha"][0] != starts["alpha"][0]
    with pytest.raises(ValueError, match="actions: arrived none of bravo, charlie"):
        fleet.step({"alpha": [0.0]})
    np.testing.assert_array_equal(fleet.reset(seed=4)[0]["alpha"], starts["alpha"])


def test_dictionaries_of_agents_are_the_rows_of_the_fleet():
    fleet, dictionaries = PointFleet(), AgentDictionaries(PointFleet(), final_observations=True)
    keys = jax.random.split(jax.random.key(0), 4)
    observations, state = jax.vmap(dictionaries.reset)(keys)
    assert set(observations) == set(dictionaries.agents)
    assert dictionaries.observation_space("alpha").shape == (2,)
    assert dictionaries.action_space("bravo").shape == (1,)
    actions = {agent: jnp.full((4, 1), step) for agent, step in zip(fleet.agents, (0.5, -0.5, 0.1), strict=True)}
    for number in range(LENGTH):
        observations, state, rewards, ends, info = jax.vmap(dictionaries.step)(keys, state, actions)
        assert bool(ends["__all__"].all()) == bool(ends["alpha"].all()) == (number == LENGTH - 1)
    assert rewards["charlie"].shape == (4,)
    assert info["success"].shape == (4, 3)
    assert bool(info["success"].all())
    np.testing.assert_array_equal(info["final_observation"][..., 1], LENGTH)
    # the next episode begins within the step
    np.testing.assert_array_equal(observations["bravo"][:, 1], 0.0)
    still = {agent: jnp.zeros(1) for agent in fleet.agents}
    assert "final_observation" not in AgentDictionaries(fleet).step(keys[0], fleet.reset(keys[0])[1], still)[4]


@pytest.mark.long
def test_the_packages_fleet_flies_in_pettingzoo_and_in_dictionaries():
    parallel = FleetParallelEnvironment("FleetArrival")
    environment = parallel.environment
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(parallel, num_cycles=40)
    key = jax.random.key(3)
    observations, state = AgentDictionaries(environment).reset(key)
    rows = np.asarray(environment.reset(key)[0])
    np.testing.assert_array_equal([observations[agent] for agent in environment.agents], rows)
    actions = np.zeros((30, len(environment.agents), environment.num_actions), np.float32)
    flown, step = state, jax.jit(environment.step_env)
    for number in range(len(actions)):
        flown = step(key, flown, actions[number], environment.default_params)[1]
    positions_n = np.asarray(environment.situation(flown).truth.state.position_n)
    for position_n, agent in zip(positions_n, environment.agents, strict=True):
        last = record_flight(environment, state, actions, agent).dataset.isel(time=-1)
        recorded_n = [float(last.north_m), float(last.east_m), -float(last.altitude_m)]
        # seconds of flight in programs that round differently
        np.testing.assert_allclose(recorded_n, position_n, rtol=1e-9, atol=1e-6)
    with pytest.raises(ValueError, match="agent: arrived None; expected one of"):
        record_flight(environment, state, actions)
