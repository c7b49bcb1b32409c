"""Idle deceleration of an aircraft by airspeed and load factor."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.parts.planners import IdleDeceleration

SPEEDS = np.array([90.0, 110.0, 130.0, 150.0, 190.0])
LEVEL = np.array([1.10, 0.90, 0.85, 1.00, 1.60])
BY_LIFT = np.array([1.00, 0.70, 0.50, 0.30, 0.00])
IDLE = IdleDeceleration(jnp.asarray(SPEEDS), jnp.asarray(LEVEL), jnp.asarray(BY_LIFT))
share = jax.jit(lambda *at: IDLE.share(*at))
least_share = jax.jit(lambda *at: IDLE.least_share(*at))
rise = jax.jit(lambda *at: IDLE.rise(*at))
greatest_rise = jax.jit(lambda *at: IDLE.greatest_rise(*at))
speed = st.floats(50.0, 250.0)
load = st.floats(-1.0, 4.0)


def interpolated(airspeed, load_factor):
    """Interpolation by NumPy: constant beyond the ends, drag due to lift by the square of the load factor."""
    loaded = min(max(load_factor, 0.0), 1.0)
    return np.interp(airspeed, SPEEDS, np.maximum(LEVEL - BY_LIFT * (1.0 - loaded**2), 0.05))


@settings(deadline=None)
@given(speed, load)
def test_the_share_is_linear_between_entries_and_constant_beyond(at, load_factor):
    assert float(share(at, load_factor)) == pytest.approx(interpolated(at, load_factor), rel=1e-13)


@settings(deadline=None)
@given(speed, speed, load)
def test_the_least_share_is_the_minimum_between_two_airspeeds(speed_a, speed_b, load_factor):
    slow, fast = sorted((speed_a, speed_b))
    between = np.concatenate([np.linspace(slow, fast, 200), np.clip(SPEEDS, slow, fast)])
    minimum = float(least_share(slow, fast, load_factor))
    assert minimum == pytest.approx(interpolated(between, load_factor).min(), rel=1e-13)
    # More lift makes no less drag.
    assert minimum <= interpolated(between, load_factor + 0.3).min() + 1e-12


@settings(deadline=None)
@given(speed, speed, load)
def test_above_load_factor_1_the_drag_due_to_lift_rises_with_its_square(speed_a, speed_b, load_factor):
    slow, fast = sorted((speed_a, speed_b))
    between = np.concatenate([np.linspace(slow, fast, 50), np.clip(SPEEDS, slow, fast)])
    # differences of numbers up to 15: where they are 0, rounding is left
    rises = np.interp(between, SPEEDS, BY_LIFT) * (max(load_factor, 1.0) ** 2 - 1.0)
    assert float(rise(slow, load_factor)) == pytest.approx(rises[0], rel=1e-12, abs=1e-14)
    assert float(greatest_rise(slow, fast, load_factor)) == pytest.approx(rises.max(), rel=1e-12, abs=1e-14)


def test_numpy_values_compile_nothing():
    idle = jax.tree.map(np.asarray, IDLE)
    speeds, loads = np.array([95.0, 120.0, 200.0]), np.array([0.5, 1.0, 2.0])
    for method in (idle.share, idle.rise):
        values = method(speeds, loads)
        assert isinstance(values, np.ndarray)
        np.testing.assert_allclose(values, [method(v, n) for v, n in zip(speeds, loads, strict=True)])


def test_the_unloaded_share_is_smaller_and_has_a_minimum():
    assert float(share(120.0, 0.75)) == pytest.approx(0.875 - 0.6 * (1.0 - 0.75**2))
    assert float(share(120.0, 1.4)) == float(share(120.0, 1.0))
    assert float(share(90.0, 0.0)) == pytest.approx(0.1)
    assert float(IdleDeceleration(IDLE.speeds, IDLE.level, IDLE.level * 1.2).share(100.0, 0.0)) == 0.05


@pytest.mark.long
def test_the_share_has_slopes_and_a_batch_axis():
    by_speed, by_load = jax.grad(IDLE.share, argnums=(0, 1))(120.0, 0.8)
    assert float(by_speed) == pytest.approx((0.85 - 0.90 + 0.36 * 0.2) / 20.0)
    assert float(by_load) == pytest.approx(0.6 * 2 * 0.8)
    fleet = jax.tree.map(lambda leaf: jnp.stack([leaf, 2.0 * leaf]), IDLE)
    shares = jax.jit(jax.vmap(IdleDeceleration.share))(fleet, jnp.array([100.0, 200.0]), jnp.ones(2))
    np.testing.assert_allclose(shares, [1.0, 2.0])
