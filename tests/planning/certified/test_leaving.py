"""The way of an aircraft that leaves: no jump where it begins, a level turn onto its course, then straight on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.environment import LayeredWind, SteadyWind
from anser.planning import TimedPath
from anser.planning.certified.replanning import exit_path

GRAVITY = 9.81
SHEAR = LayeredWind(jnp.array([0.0, 2000.0]), jnp.array([[0.0, 0.0, 0.0], [12.0, -6.0, 0.0]]))


def climbing_turn(wind):
    times = jnp.linspace(0.0, 100.0, 60)

    def place(t):
        return jnp.stack([3000.0 * jnp.sin(0.05 * t), -3000.0 * jnp.cos(0.05 * t), -1000.0 - 5.0 * t])

    rows = [jax.vmap(f)(times) for f in (place, jax.jacfwd(place), jax.jacfwd(jax.jacfwd(place)))]
    still = [jnp.zeros_like(rows[0])] * 3
    return TimedPath(times, jnp.stack(rows, axis=1), jnp.stack(still, axis=1))


@pytest.mark.parametrize("turn", [0.0, 1.2, -2.2])
@pytest.mark.parametrize("wind", [SteadyWind(jnp.array([5.0, 3.0, 0.0])), SHEAR], ids=["steady", "shear"])
def test_it_goes_on_without_a_jump_and_ends_straight_and_level(turn, wind):
    path = climbing_turn(wind)
    out = jax.jit(exit_path)(path, 40.0, 200.0, turn, wind, GRAVITY)
    before, _ = path.states_n(40.0)
    air, drift = out.states_n(40.0)
    np.testing.assert_allclose(air[0] + drift[0], path.position_n(40.0), atol=1e-9)
    np.testing.assert_allclose(air[1], before[1], atol=1e-9)
    np.testing.assert_allclose(air[2], before[2], atol=1e-9)
    course = np.arctan2(float(before[1, 1]), float(before[1, 0]))
    for time in (150.0, 190.0):
        late, drifting = (np.asarray(x) for x in out.states_n(time))
        np.testing.assert_allclose(late[1, 2], 0.0, atol=1e-9)
        off = np.arctan2(late[1, 1], late[1, 0]) - course - turn
        np.testing.assert_allclose((off + np.pi) % (2 * np.pi) - np.pi, 0.0, atol=1e-9)
        np.testing.assert_allclose(np.hypot(*late[1, :2]), np.hypot(*np.asarray(before[1, :2])), rtol=1e-9)
        np.testing.assert_allclose(drifting[1], wind.at(jnp.asarray(late[0] + drifting[0]), 0.0), atol=2e-3)


def test_gradients_and_batches():
    wind = SteadyWind(jnp.array([5.0, 3.0, 0.0]))
    path = climbing_turn(wind)
    slope = jax.grad(lambda turn: exit_path(path, 40.0, 140.0, turn, wind, GRAVITY).position_n(90.0)[0])
    assert np.isfinite(jax.jit(slope)(0.7))
    many = jax.vmap(lambda turn: exit_path(path, 40.0, 140.0, turn, wind, GRAVITY))
    many = jax.jit(many)(jnp.array([0.0, 0.7]))
    one = jax.jit(exit_path)(path, 40.0, 140.0, 0.7, wind, GRAVITY)
    np.testing.assert_allclose(many.air_n[1], one.air_n, rtol=1e-12, atol=1e-9)
