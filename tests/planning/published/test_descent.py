"""Least mean airspeed of a descending aircraft with the engine idle."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.planning.published.time_law import BRAKING_RESERVE_M_S2
from anser.planning.published.trajectory import slowest_mean_speed
from support.planning_cases import fit

solve = jax.jit(slowest_mean_speed)


def straight(drop, length=6000.0, speed=150.0):
    """A straight path with a length and a drop (m), with s linear along the path."""
    level = np.sqrt(length**2 - drop**2)
    direction = np.array([level, 0.0, drop]) / length
    start = np.array([0.0, 0.0, -2000.0])
    duration = length / speed
    return fit(0.0, duration, start, speed * direction, start + length * direction, speed * direction)


@settings(deadline=None, max_examples=30)
@given(drop=st.floats(300.0, 1500.0), speed_0=st.floats(120.0, 180.0), deceleration=st.floats(0.5, 1.3))
def test_a_straight_descent_is_uniformly_accelerated(drop, speed_0, deceleration):
    length = 6000.0
    braking = STANDARD_GRAVITY_M_S2 * drop / length - (deceleration - BRAKING_RESERVE_M_S2)
    final_speed = np.sqrt(speed_0**2 + 2 * braking * length)
    # Uniform acceleration: the mean over time is that of the ends. Exact in every cell, so to rounding.
    np.testing.assert_allclose(solve(straight(drop), speed_0, deceleration), (speed_0 + final_speed) / 2, rtol=1e-9)


def test_level_flight_can_be_slow_and_a_steep_descent_cannot():
    # 0.9 m/s^2 over 6 km leave 108 m/s at the end.
    np.testing.assert_allclose(
        solve(straight(0.0), 150.0, 1.1), (150 + np.sqrt(150**2 - 2 * 0.9 * 6000)) / 2, rtol=1e-9
    )
    assert float(solve(straight(900.0), 150.0, 1.1)) > 150.0


def test_more_braking_is_never_faster():
    means = jax.jit(jax.vmap(slowest_mean_speed, in_axes=(None, None, 0)))(
        straight(700.0), 150.0, jnp.linspace(0.3, 3.0, 20)
    )
    assert bool(jnp.all(jnp.diff(means) <= 0.0))


def test_the_gradient_is_finite_at_the_speed_floor():
    slope = jax.jit(jax.grad(slowest_mean_speed, argnums=2))
    for deceleration in (0.5, 1.1, 50.0):
        assert np.isfinite(slope(straight(700.0), 150.0, deceleration))
