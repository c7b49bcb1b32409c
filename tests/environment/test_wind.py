"""Wind: the meteorological sense, steady wind and shear profiles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.environment import AbstractWind, LayeredWind, SteadyWind, steady_wind_from


@pytest.mark.parametrize(
    ("from_deg", "velocity_n"),
    [(0.0, [-10.0, 0.0, 0.0]), (90.0, [0.0, -10.0, 0.0]), (180.0, [10.0, 0.0, 0.0]), (270.0, [0.0, 10.0, 0.0])],
)
def test_named_directions(from_deg, velocity_n):
    """A north wind moves the air south, a west wind east."""
    wind = steady_wind_from(10.0, from_deg)
    np.testing.assert_allclose(wind.velocity_n, velocity_n, atol=3e-15)  # the sine of pi rounded


def test_updraught_is_up():
    np.testing.assert_array_equal(steady_wind_from(0.0, 0.0, 3.0).velocity_n[2], -3.0)


@settings(deadline=None, max_examples=30)
@given(st.floats(0.1, 80.0), st.floats(-360.0, 360.0), st.floats(-10.0, 10.0))
def test_speed_and_direction_come_back(speed, from_deg, up):
    v_N, v_E, v_D = np.asarray(steady_wind_from(speed, from_deg, up).velocity_n)
    assert np.hypot(v_N, v_E) == pytest.approx(speed, rel=1e-15)
    assert -v_D == up
    turned = np.degrees(np.arctan2(-v_E, -v_N)) - from_deg
    assert np.cos(np.radians(turned)) == pytest.approx(1.0, abs=1e-15)
    assert np.sin(np.radians(turned)) == pytest.approx(0.0, abs=4e-15)  # angles of up to 2 pi and 360 round by 1e-15


def test_same_everywhere_and_always():
    wind = SteadyWind(jnp.array([3.0, -4.0, 0.5]))
    assert isinstance(wind, AbstractWind)
    positions = 1e4 * jax.random.normal(jax.random.key(0), (5, 3))
    batch = jax.jit(jax.vmap(wind.at))(positions, jnp.arange(5.0))
    np.testing.assert_array_equal(batch, np.tile([3.0, -4.0, 0.5], (5, 1)))


def test_gradient_and_batch_of_winds():
    slopes = jax.jacrev(lambda speed, from_deg: steady_wind_from(speed, from_deg).velocity_n, argnums=(0, 1))(
        10.0, 270.0
    )
    np.testing.assert_allclose(slopes[0], [0.0, 1.0, 0.0], atol=1e-15)
    # Veering from west by one degree turns the flow to the right: southwards.
    np.testing.assert_allclose(slopes[1], [-10.0 * np.pi / 180.0, 0.0, 0.0], atol=1e-15)
    winds = jax.vmap(steady_wind_from)(jnp.array([5.0, 7.0]), jnp.array([0.0, 180.0]))
    np.testing.assert_allclose(winds.velocity_n, [[-5.0, 0.0, 0.0], [7.0, 0.0, 0.0]], atol=1e-15)


def test_layers_are_joined_by_lines_and_end_level():
    wind = LayeredWind(
        jnp.array([100.0, 200.0, 400.0]), jnp.array([[0.0, 10.0, 0.0], [5.0, 20.0, 1.0], [5.0, 0.0, 1.0]])
    )
    for altitude, expected in ((0.0, [0, 10, 0]), (150.0, [2.5, 15, 0.5]), (300.0, [5, 10, 1]), (900.0, [5, 0, 1])):
        np.testing.assert_allclose(wind.at(jnp.array([1e4, -1e4, -altitude]), 7.0), expected, atol=1e-15)


def test_layers_are_differentiable_and_batched():
    wind = LayeredWind(jnp.array([0.0, 1000.0]), jnp.array([[0.0, -6.0, 0.0], [0.0, 24.0, 0.0]]))
    slope = jax.jacfwd(lambda p: wind.at(p, 0.0))(jnp.array([0.0, 0.0, -500.0]))
    np.testing.assert_allclose(slope, [[0, 0, 0], [0, 0, -0.03], [0, 0, 0]], atol=1e-17)
    many = jax.vmap(wind.at, in_axes=(0, None))(jnp.array([[0.0, 0.0, -500.0], [0.0, 0.0, -1000.0]]), 0.0)
    np.testing.assert_allclose(many[:, 1], [9.0, 24.0])
