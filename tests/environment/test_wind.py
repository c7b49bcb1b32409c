"""Wind: steady wind, shear profiles, and profiles that vary in time."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.environment import AbstractWind, LayeredWind, SteadyWind, VaryingWind

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


TIMES, ALTITUDES = np.array([0.0, 600.0, 1500.0]), np.array([100.0, 200.0, 1000.0, 4000.0])
VELOCITIES = np.random.default_rng(2).normal(scale=10.0, size=(3, 4, 3))


def varying():
    return VaryingWind(jnp.asarray(TIMES), jnp.asarray(ALTITUDES), jnp.asarray(VELOCITIES))


@settings(deadline=None, max_examples=60)
@given(st.floats(-500.0, 3000.0), st.floats(-500.0, 6000.0))
def test_a_varying_wind_is_bilinear(time, altitude):
    """Against `numpy.interp`, in altitude at each time, then in time: weights round by 1e-16 of 50 m/s."""
    expected = [
        np.interp(time, TIMES, [np.interp(altitude, ALTITUDES, profile[:, k]) for profile in VELOCITIES])
        for k in range(3)
    ]
    velocity = wind_at(varying(), jnp.array([3e3, -2e3, -altitude]), time)
    np.testing.assert_allclose(velocity, expected, atol=2e-13)


def test_a_varying_wind_is_exact_at_breakpoints_and_constant_beyond():
    wind = varying()
    assert isinstance(wind, AbstractWind)
    for k, time in enumerate(TIMES):
        for j, altitude in enumerate(ALTITUDES):
            at_breakpoint = wind_at(wind, jnp.array([0.0, 0.0, -altitude]), time)
            np.testing.assert_allclose(at_breakpoint, VELOCITIES[k, j], atol=1e-14)
    np.testing.assert_allclose(wind_at(wind, jnp.array([0.0, 0.0, 50.0]), -1.0), VELOCITIES[0, 0], atol=1e-14)
    np.testing.assert_allclose(wind_at(wind, jnp.array([0.0, 0.0, -9e3]), 1e6), VELOCITIES[-1, -1], atol=1e-14)


def test_a_varying_wind_with_one_time_is_layered_and_with_one_point_steady():
    position_n = jnp.array([0.0, 0.0, -700.0])
    layered = LayeredWind(jnp.asarray(ALTITUDES), jnp.asarray(VELOCITIES[1]))
    one_time = VaryingWind(jnp.array([5.0]), jnp.asarray(ALTITUDES), jnp.asarray(VELOCITIES[1:2]))
    np.testing.assert_allclose(wind_at(one_time, position_n, 99.0), wind_at(layered, position_n, 99.0), atol=1e-14)
    one_place = VaryingWind(jnp.array([5.0]), jnp.array([0.0]), jnp.asarray(VELOCITIES[1:2, :1]))
    np.testing.assert_array_equal(wind_at(one_place, position_n, 99.0), VELOCITIES[1, 0])


def test_a_varying_wind_supports_gradients_and_batches():
    """Slopes in time and altitude are those of the cell's corners inside the table, and zero outside."""
    wind, position_n = varying(), jnp.array([0.0, 0.0, -600.0])
    slope_in_time = jax.jit(jax.grad(lambda t: wind.at(position_n, t)[0]))
    below, above = (VELOCITIES[1, j, 0] - VELOCITIES[0, j, 0] for j in (1, 2))
    np.testing.assert_allclose(slope_in_time(300.0), (0.5 * below + 0.5 * above) / 600.0, rtol=1e-12)
    shear = jax.jit(jax.jacrev(lambda p: wind.at(p, 0.0)))(position_n)[:, 2]
    np.testing.assert_allclose(shear, -(VELOCITIES[0, 2] - VELOCITIES[0, 1]) / 800.0, rtol=1e-12)
    np.testing.assert_array_equal(slope_in_time(1e5), 0.0)
    positions_n, times = jnp.tile(position_n, (3, 1)), jnp.array([0.0, 600.0, 1500.0])
    batch = jax.jit(jax.vmap(wind.at))(positions_n, times)
    np.testing.assert_allclose(batch, 0.5 * (VELOCITIES[:, 1] + VELOCITIES[:, 2]), atol=1e-14)
    winds = jax.vmap(lambda scale: VaryingWind(wind.times, wind.altitudes, scale * wind.velocities_n))(jnp.arange(3.0))
    of_winds = jax.jit(jax.vmap(lambda wind_of_batch: wind_of_batch.at(position_n, 600.0)))(winds)
    np.testing.assert_allclose(of_winds[2], 2.0 * of_winds[1], atol=1e-14)
