"""Demand of coordinated flight, against the rates of speed, path angle and course (theory section 6)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.parts.paths import polar
from anser.planning import PathLimits
from anser.planning.demand import coordinated_demand, demand, side_force_max, turn_radius

GRAVITY = 9.81


def array_of(demanded):
    return np.array([demanded.speed, demanded.side, demanded.lift, demanded.along])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 100_000))
def test_forces_match_the_polar_rates(seed):
    rng = np.random.default_rng(seed)
    velocity, acceleration = jnp.asarray(rng.normal(0.0, 100.0, 3)), jnp.asarray(rng.normal(0.0, 10.0, 3))
    p = polar(velocity, acceleration)
    expected = [
        p.V,
        p.V * jnp.cos(p.gamma) * p.chi_dot,
        p.V * p.gamma_dot + GRAVITY * jnp.cos(p.gamma),
        p.V_dot + GRAVITY * jnp.sin(p.gamma),
    ]
    required = demand(velocity, acceleration, GRAVITY)
    np.testing.assert_allclose(array_of(required), expected, rtol=1e-9, atol=1e-9)  # steep ones lose digits
    # Lift, side force and the force along are all of the specific force.
    specific = np.asarray(acceleration) - [0.0, 0.0, GRAVITY]
    np.testing.assert_allclose(required.normal**2 + required.along**2, np.sum(specific**2), rtol=1e-12)


def test_a_level_turn_has_the_textbook_bank():
    speed, radius = 150.0, float(turn_radius(150.0, 0.6, GRAVITY))
    turning = coordinated_demand(*(jnp.asarray(x) for x in (speed, 0.0, -(speed**2) / radius, 0.0, GRAVITY)))
    np.testing.assert_allclose(turning.bank, -0.6, rtol=1e-12)
    np.testing.assert_allclose(turning.normal, GRAVITY / np.cos(0.6), rtol=1e-12)
    over = turning.excess(np.tan(0.6), GRAVITY / np.cos(0.6), 0.5 * GRAVITY, 1.0, 1.0)
    np.testing.assert_allclose(over, [0.0, 0.0, -1.0], atol=1e-6)


def test_a_push_over_below_the_least_lift_exceeds_the_limit():
    level = coordinated_demand(*(jnp.asarray(x) for x in (150.0, 0.0, 0.0, 0.0, GRAVITY - 6.0)))
    over = level.excess(1.0, 2.0 * GRAVITY, 0.5 * GRAVITY, 1.0, 1.0)
    np.testing.assert_allclose(over[1], 6.0 - 0.5 * GRAVITY, atol=1e-6)


@pytest.mark.parametrize("load", [1.1, 2.0, np.inf])
def test_the_greatest_side_force_reaches_bank_or_load_factor(load):
    values = 50.0, 250.0, 1.0, 80.0, 0.0, 1e4, load, 2.0, 2.0
    limits = PathLimits(*(jnp.asarray(x) for x in values))
    side = side_force_max(jnp.asarray(9.0), jnp.asarray(10.0), limits, GRAVITY)
    by_bank, by_load = 9.0 * np.tan(1.0), np.sqrt(max((min(load, 1e3) * GRAVITY) ** 2 - 100.0, 0.01))
    np.testing.assert_allclose(side, min(by_bank, by_load), rtol=1e-12)


def test_the_demand_is_finite_at_rest_and_in_vertical_flight():
    def normal(velocity):
        required = demand(velocity, jnp.array([1.0, 2.0, 3.0]), GRAVITY)
        return required.normal + required.along

    velocities = jnp.array([[0.0, 0.0, 0.0], [0.0, 0.0, 90.0], [100.0, 20.0, 5.0]])
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(normal)))(velocities)
    assert np.all(np.isfinite(values))
    assert np.all(np.isfinite(slopes))
    np.testing.assert_allclose(values[2], normal(velocities[2]), rtol=1e-14)
