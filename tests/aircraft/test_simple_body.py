"""Rigid bodies: drag against the motion, damping of the rates, no engine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import Wrench
from anser.aircraft.air_data import air_data
from anser.aircraft_files import load_body
from anser.aircraft_files.sources import BODIES
from anser.environment import standard_environment
from anser.units import FOOT_M, SLUG_KG
from support.states import air_at

AIR = jax.jit(standard_environment().atmosphere.at)(1000.0)
velocities = st.tuples(*(st.floats(-400.0, 400.0),) * 3).filter(lambda v: np.linalg.norm(v) > 1.0).map(np.array)


@jax.jit
def wrench_of(body, velocity_b, rates_b):
    return body.aerodynamics(air_data(velocity_b, 1000.0, AIR), rates_b, jnp.zeros(3))


slopes_of = jax.jit(jax.jacfwd(wrench_of, (1, 2)))


@settings(deadline=None, max_examples=30)
@given(velocities)
def test_drag_opposes_the_motion(velocity_b):
    sphere = load_body("sphere")
    force_b = wrench_of(sphere, velocity_b, np.zeros(3)).force_b
    # CD 0.1 on 0.1963495 ft^2 ([NESC] cannonball).
    size = 0.5 * float(AIR.density) * 0.1 * 0.1963495 * FOOT_M**2 * float(np.linalg.norm(velocity_b))
    np.testing.assert_allclose(force_b, -size * velocity_b, rtol=1e-12, atol=1e-12)


def test_the_brick_is_damped_about_each_axis():
    """M = qbar S l (-1) w l / 2V with the brick's span for roll and yaw and its chord for pitch."""
    brick = load_body("brick")
    velocity_b, rates_b = np.array([100.0, 0.0, 0.0]), np.array([1.0, 2.0, -3.0])
    lengths = np.array([0.33333, 0.66667, 0.33333]) * FOOT_M
    qbar = 0.5 * float(AIR.density) * 100.0**2
    expected = -qbar * 0.22222 * FOOT_M**2 * lengths**2 * rates_b / 200.0
    wrench = wrench_of(brick, velocity_b, rates_b)
    np.testing.assert_allclose(wrench.moment_b, expected, rtol=1e-12)
    np.testing.assert_array_equal(wrench.force_b, np.zeros(3))
    undamped = wrench_of(load_body("undamped-brick"), velocity_b, rates_b)
    np.testing.assert_array_equal(undamped.moment_b, np.zeros(3))


@pytest.mark.parametrize("name", BODIES)
def test_forces_at_rest_are_finite_and_zero(name):
    body = load_body(name)
    still = wrench_of(body, np.zeros(3), np.ones(3))
    np.testing.assert_array_equal(still.force_b, np.zeros(3))
    np.testing.assert_array_equal(still.moment_b, np.zeros(3))
    for slope in jax.tree.leaves(slopes_of(body, np.zeros(3), np.ones(3))):
        assert np.all(np.isfinite(slope))


def test_the_body_has_no_engine_and_no_surfaces():
    body = load_body("sphere")
    assert float(body.mass_properties.mass) == pytest.approx(SLUG_KG, rel=1e-15)
    air = air_at(1000.0, 0.5)
    thrust = body.engine.propulsion(50.0, air)
    assert isinstance(thrust, Wrench)
    np.testing.assert_array_equal(thrust.force_b, np.zeros(3))
    still = body.actuators.rate(body.actuators.steady_state(jnp.zeros(3)), jnp.ones(3), air)
    np.testing.assert_array_equal(still.position, np.zeros(3))
    assert float(body.engine.rate(body.engine.steady_state(0.0), 1.0, air).power) == 0.0


def test_an_unknown_body_is_refused_with_the_known_names():
    with pytest.raises(ValueError, match="'cube': known are dragless-sphere, sphere, undamped-brick, brick"):
        load_body("cube")
