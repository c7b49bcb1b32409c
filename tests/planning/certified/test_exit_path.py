"""The exit path of a departing aircraft: a smooth start, a level turn onto its course, then straight flight."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.environment import LayeredWind, SteadyWind
from anser.planning import TimedPath
from anser.planning.certified.replanning import exit_path, task_from_plan
from support.aircraft_tasks import aircraft_task

GRAVITY = 9.81
KNOTS = 60


def leave(path, start_time, end_time, turn, wind):
    start = task_from_plan(path, aircraft_task((0.0, 0.0, 0.0)), start_time)
    return exit_path(start, start_time, end_time, turn, wind, GRAVITY, KNOTS)


fly_exit = jax.jit(leave)
position_at = jax.jit(lambda path, time: path.position_n(time))
states_at = jax.jit(lambda path, time: path.states_n(time))
SHEAR = LayeredWind(jnp.array([0.0, 2000.0]), jnp.array([[0.0, 0.0, 0.0], [12.0, -6.0, 0.0]]))


@jax.jit
def climbing_turn():
    times = jnp.linspace(0.0, 100.0, 60)

    def place(t):
        return jnp.stack([3000.0 * jnp.sin(0.05 * t), -3000.0 * jnp.cos(0.05 * t), -1000.0 - 5.0 * t])

    derivatives = [jax.vmap(f)(times) for f in (place, jax.jacfwd(place), jax.jacfwd(jax.jacfwd(place)))]
    no_drift = [jnp.zeros_like(derivatives[0])] * 3
    return TimedPath(times, jnp.stack(derivatives, axis=1), jnp.stack(no_drift, axis=1))


@pytest.mark.parametrize("turn", [0.0, 1.2, -2.2])
@pytest.mark.parametrize("wind", [SteadyWind(jnp.array([5.0, 3.0, 0.0])), SHEAR], ids=["steady", "shear"])
def test_an_exit_path_starts_smoothly_and_ends_straight_and_level(turn, wind):
    path = climbing_turn()
    out = fly_exit(path, 40.0, 200.0, turn, wind)
    planned_air, _ = (np.asarray(x) for x in states_at(path, 40.0))
    air, drift = (np.asarray(x) for x in states_at(out, 40.0))
    np.testing.assert_allclose(air[0] + drift[0], position_at(path, 40.0), atol=1e-9)
    np.testing.assert_allclose(air[1], planned_air[1], atol=1e-9)
    np.testing.assert_allclose(air[2], planned_air[2], atol=1e-9)
    course = np.arctan2(float(planned_air[1, 1]), float(planned_air[1, 0]))
    for time in (150.0, 190.0):
        late, drifting = (np.asarray(x) for x in states_at(out, time))
        np.testing.assert_allclose(late[1, 2], 0.0, atol=1e-9)
        course_error = np.arctan2(late[1, 1], late[1, 0]) - course - turn
        np.testing.assert_allclose((course_error + np.pi) % (2 * np.pi) - np.pi, 0.0, atol=1e-9)
        np.testing.assert_allclose(np.hypot(*late[1, :2]), np.hypot(*planned_air[1, :2]), rtol=1e-9)
        np.testing.assert_allclose(drifting[1], wind.at(jnp.asarray(late[0] + drifting[0]), 0.0), atol=2e-3)


def test_a_turn_is_within_a_small_limit_of_the_bank_angle():
    start = task_from_plan(climbing_turn(), aircraft_task((0.0, 0.0, 0.0)), 40.0)
    level = dataclasses.replace(start, air_velocity_n=jnp.array([150.0, 0.0, 0.0]), air_acceleration_n=jnp.zeros(3))
    fly = jax.jit(lambda task: exit_path(task, 0.0, 100.0, 1.2, SteadyWind(jnp.zeros(3)), GRAVITY, 1001))
    for limit, expected in ((0.9, 0.7), (0.4, 0.36)):
        path = fly(eqx.tree_at(lambda t: t.limits.bank_max, level, jnp.asarray(limit)))
        lateral = np.linalg.norm(path.air_n[:, 2], axis=1)
        np.testing.assert_allclose(np.max(np.arctan2(lateral, GRAVITY)), expected, rtol=1e-4)


@pytest.mark.long
def test_gradients_and_batches():
    wind = SteadyWind(jnp.array([5.0, 3.0, 0.0]))
    path = climbing_turn()
    slope = jax.grad(lambda turn: leave(path, 40.0, 140.0, turn, wind).position_n(90.0)[0])
    assert np.isfinite(jax.jit(slope)(0.7))
    batch = jax.vmap(lambda turn: leave(path, 40.0, 140.0, turn, wind))
    batch = jax.jit(batch)(jnp.array([0.0, 0.7]))
    single = fly_exit(path, 40.0, 140.0, 0.7, wind)
    np.testing.assert_allclose(batch.air_n[1], single.air_n, rtol=1e-12, atol=1e-9)
