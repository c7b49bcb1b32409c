"""Wind: steady wind and shear profiles."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.environment import AbstractWind, LayeredWind, SteadyWind

wind_at = jax.jit(lambda wind, position_n, time: wind.at(position_n, time))


def test_a_steady_wind_is_uniform_and_constant():
    wind = SteadyWind(jnp.array([3.0, -4.0, 0.5]))
    assert isinstance(wind, AbstractWind)
    positions = 1e4 * jax.random.normal(jax.random.key(0), (5, 3))
    batch = jax.jit(jax.vmap(wind.at))(positions, jnp.arange(5.0))
    np.testing.assert_array_equal(batch, np.tile([3.0, -4.0, 0.5], (5, 1)))


def test_layers_are_interpolated_linearly_and_constant_beyond():
    wind = LayeredWind(
        jnp.array([100.0, 200.0, 400.0]), jnp.array([[0.0, 10.0, 0.0], [5.0, 20.0, 1.0], [5.0, 0.0, 1.0]])
    )
    for altitude, expected in ((0.0, [0, 10, 0]), (150.0, [2.5, 15, 0.5]), (300.0, [5, 10, 1]), (900.0, [5, 0, 1])):
        np.testing.assert_allclose(wind_at(wind, jnp.array([1e4, -1e4, -altitude]), 7.0), expected, atol=1e-15)


def test_layers_are_differentiable_and_batched():
    wind = LayeredWind(jnp.array([0.0, 1000.0]), jnp.array([[0.0, -6.0, 0.0], [0.0, 24.0, 0.0]]))
    slope = jax.jit(jax.jacfwd(lambda p: wind.at(p, 0.0)))(jnp.array([0.0, 0.0, -500.0]))
    np.testing.assert_allclose(slope, [[0, 0, 0], [0, 0, -0.03], [0, 0, 0]], atol=1e-17)
    batch = jax.jit(jax.vmap(wind.at, in_axes=(0, None)))(jnp.array([[0.0, 0.0, -500.0], [0.0, 0.0, -1000.0]]), 0.0)
    np.testing.assert_allclose(batch[:, 1], [9.0, 24.0])


ALTITUDES = np.array([100.0, 200.0, 1000.0, 4000.0])
VELOCITIES = np.random.default_rng(2).normal(scale=10.0, size=(4, 3))


@settings(deadline=None, max_examples=60)
@given(st.floats(-500.0, 6000.0))
def test_layers_agree_with_numpy(altitude):
    """Weights round by 1e-16 of 50 m/s."""
    wind = LayeredWind(jnp.asarray(ALTITUDES), jnp.asarray(VELOCITIES))
    expected = [np.interp(altitude, ALTITUDES, VELOCITIES[:, k]) for k in range(3)]
    np.testing.assert_allclose(wind_at(wind, jnp.array([3e3, -2e3, -altitude]), 0.0), expected, atol=2e-13)
