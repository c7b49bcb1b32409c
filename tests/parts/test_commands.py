"""Polar form of a velocity and its rates."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.parts.paths import polar, rescale_command
from support.planning_cases import angles, trajectories, velocity


@settings(deadline=None, max_examples=30)
@given(speed=st.floats(20.0, 400.0), course=angles, path_angle=st.floats(-1.5, 1.5))
def test_the_polar_form_recovers_the_angles(speed, course, path_angle):
    command = polar(velocity(speed, course, path_angle), jnp.zeros(3))
    # cos(1.5) = 0.07 costs one digit in the course.
    np.testing.assert_allclose([command.V, command.gamma, command.chi], [speed, path_angle, course], atol=1e-12)


command_at = jax.jit(lambda path, t: polar(path.velocity_n(t), path.acceleration_n(t)))
rates_of = jax.jit(jax.jacfwd(lambda path, t: polar(path.velocity_n(t), path.acceleration_n(t)), argnums=1))


@settings(deadline=None, max_examples=20)
@given(path=trajectories(), fraction=st.floats(0.02, 0.98))
def test_rates_are_the_derivatives(path, fraction):
    time = path.start_time + fraction * path.duration
    command = command_at(path, time)
    rates = rates_of(path, time)
    # Two formulations of one derivative; relative to each, plus rounding of zero.
    np.testing.assert_allclose(command.V_dot, rates.V, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(command.gamma_dot, rates.gamma, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(command.chi_dot, rates.chi, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("v", [(0.0, 0.0, 0.0), (0.0, 0.0, -90.0), (0.0, 0.0, 90.0), (-50.0, 0.0, 0.0)])
def test_gradients_are_finite_at_rest_and_in_the_vertical(v):
    jacobian = jax.jit(jax.jacrev(polar, argnums=(0, 1)))(jnp.array(v), jnp.array([1.0, -2.0, 3.0]))
    assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(jacobian))


def test_vertical_path_angle_and_vmap():
    command = jax.vmap(polar)(jnp.array([[0.0, 0.0, -90.0], [0.0, 0.0, 90.0]]), jnp.zeros((2, 3)))
    np.testing.assert_array_equal(command.gamma, [np.pi / 2, -np.pi / 2])


@settings(deadline=None, max_examples=30)
@given(
    speed=st.floats(20.0, 400.0),
    course=angles,
    path_angle=st.floats(-1.3, 1.3),
    acceleration=st.tuples(*(st.floats(-30.0, 30.0),) * 3).map(jnp.array),
    scale=st.tuples(*(st.floats(0.5, 2.0),) * 3).map(jnp.array),
)
def test_a_rescaled_command_is_the_polar_form_of_the_scaled_velocity(speed, course, path_angle, acceleration, scale):
    flown = velocity(speed, course, path_angle)
    rescaled = rescale_command(polar(flown, acceleration), scale)
    expected = polar(scale * flown, scale * acceleration)
    for name in ("V", "gamma", "chi", "V_dot", "gamma_dot", "chi_dot"):
        assert float(getattr(rescaled, name)) == pytest.approx(float(getattr(expected, name)), rel=1e-9, abs=1e-9), name
