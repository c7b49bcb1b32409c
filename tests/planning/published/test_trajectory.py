"""Trajectories: boundary conditions, derivatives, invariances, gradients."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.planning.published.time_law import path_derivatives
from anser.planning.published.trajectory import arc_length, bend_trajectory, fit_trajectory, lateral_direction_n
from support.planning_cases import (
    acceleration,
    angles,
    fit,
    ground_velocity,
    position,
    published_path,
    trajectories,
    velocity,
)

rates = jax.jit(lambda path, t: (jax.jacfwd(path.position_n)(t), jax.jacfwd(path.velocity_n)(t)))
bend = jax.jit(bend_trajectory)
measure = jax.jit(arc_length)
derivatives = jax.jit(lambda path, s: path_derivatives(path.coefficients_n, s[None], range(4))[..., 0])


@settings(deadline=None, max_examples=30)
@given(path=trajectories(), lateral=st.floats(-3e4, 3e4), vertical=st.floats(-3e4, 3e4))
def test_bends_keep_the_ends(path, lateral, vertical):
    bent = bend(path, lateral, vertical)
    for time in (path.start_time, path.start_time + path.duration):
        # Coefficients up to 1e5 m cancel: 1e-9 m is ten roundings of that.
        np.testing.assert_allclose(position(bent, time), position(path, time), atol=1e-9)
        np.testing.assert_allclose(ground_velocity(bent, time), ground_velocity(path, time), atol=1e-9)
    middle = path.start_time + 0.5 * path.duration
    shift = position(bent, middle) - position(path, middle)
    # s^2 (1 - s)^2 is 1/16 in the middle.
    np.testing.assert_allclose(jnp.linalg.norm(shift), np.hypot(lateral, vertical) / 16.0, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(shift[2], -vertical / 16.0, atol=1e-9)


def test_boundary_conditions_hold_in_wind():
    wind = jnp.array([7.0, -12.0, 0.5])
    start, end = jnp.array([100.0, -200.0, -900.0]), jnp.array([4100.0, 2900.0, -1500.0])
    v_0, v_f = velocity(140.0, 0.4, 0.1), velocity(160.0, 1.9, -0.2)
    path = fit(50.0, 36.0, start, v_0, end, v_f, 9000.0, -2000.0, wind)
    # Rounding of coefficients of some 1e4 m.
    np.testing.assert_allclose(position(path, 50.0), start, atol=1e-9)
    np.testing.assert_allclose(jax.jit(lambda time: path.air_velocity_n(time))(50.0), v_0, atol=1e-9)
    np.testing.assert_allclose(position(path, 86.0), end + 36.0 * wind, atol=1e-9)
    np.testing.assert_allclose(ground_velocity(path, 86.0), v_f + wind, atol=1e-9)


def test_the_coefficients_match_the_published_form():
    # Theory section 6: (k_0..k_3) = B^-1 (Y - A k_4) in t itself, here for East with b_4 = 0.005.
    t_f, b_4 = 36.0, 0.005
    matrix = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, t_f, t_f**2, t_f**3], [0, 1, 2 * t_f, 3 * t_f**2]], dtype=float)
    k = np.linalg.solve(matrix, -np.array([0.0, 0.0, t_f**4, 4 * t_f**3]) * b_4)
    path = published_path(-30.0, b_4=b_4)
    for t in np.linspace(0.0, 36.0, 7):
        east = k @ t ** np.arange(4) + b_4 * t**4
        # The solve in unscaled time loses about 1e-8 m.
        np.testing.assert_allclose(position(path, t)[1], east, atol=1e-7)


@settings(deadline=None, max_examples=20)
@given(path=trajectories(), fraction=st.floats(-0.3, 1.3))
def test_derivatives_equal_automatic_differentiation(path, fraction):
    time = path.start_time + fraction * path.duration
    velocity_n, acceleration_n = rates(path, time)
    # Same polynomial differentiated by jax: rounding only.
    np.testing.assert_allclose(velocity_n, ground_velocity(path, time), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(acceleration_n, acceleration(path, time), rtol=1e-9, atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(path=trajectories(), s=st.floats(-0.3, 1.3), order=st.integers(0, 3))
def test_path_derivatives_equal_automatic_differentiation(path, s, order):
    derivative = np.asarray(path.coefficients_n)
    if order:
        derivative = np.polynomial.polynomial.polyder(derivative, order, axis=1)
    expected = np.polynomial.polynomial.polyval(s, derivative.T)
    # Horner's scheme in both: rounding of sums of up to 1e6 m.
    np.testing.assert_allclose(derivatives(path, s)[order], expected, rtol=1e-12, atol=1e-8)


def test_the_lateral_direction_is_to_the_right_of_the_line():
    north, east = jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0])
    np.testing.assert_array_equal(lateral_direction_n(5e3 * north, east), east)
    np.testing.assert_array_equal(lateral_direction_n(5e3 * east, east), -north)
    straight_down = jnp.array([0.0, 0.0, 700.0])
    np.testing.assert_array_equal(lateral_direction_n(straight_down, 150.0 * east), -north)
    np.testing.assert_array_equal(lateral_direction_n(straight_down, straight_down), east)


@settings(deadline=None, max_examples=20)
@given(turn=angles, kappa=st.floats(-4e4, 4e4))
def test_the_length_is_invariant_to_rotations(turn, kappa):
    # Theory section 6: the term as published, in the East axis only, cannot lengthen a path that runs due East.
    def length(course):
        c, s = np.cos(course), np.sin(course)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        line, v_0, v_f = np.array([5e3, 0.0, 500.0]), velocity(150.0, 0.3), velocity(150.0, -0.5, -0.2)
        return measure(fit(0.0, 36.0, jnp.zeros(3), rotation @ v_0, rotation @ line, rotation @ v_f, kappa))

    np.testing.assert_allclose(length(turn), length(0.0), rtol=1e-12)
    np.testing.assert_allclose(length(np.pi / 2), length(0.0), rtol=1e-12)


@jax.jit
@functools.partial(jax.grad, argnums=(0, 1, 2, 3))
def degenerate_slopes(line, v_0, kappa, duration):
    path = fit_trajectory(0.0, duration, jnp.zeros(3), v_0, line, v_0, kappa, 10.0)
    return jnp.sum(path.position_n(3.0) ** 2) + arc_length(path)


@pytest.mark.long
@pytest.mark.parametrize("line", [(3e3, 1e3, -200.0), (0.0, 0.0, -500.0), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("v_0", [(100.0, 50.0, 3.0), (0.0, 0.0, -150.0)])
def test_the_gradient_is_finite_for_degenerate_lines(line, v_0):
    gradients = degenerate_slopes(jnp.array(line), jnp.array(v_0), 500.0, 20.0)
    assert all(jnp.all(jnp.isfinite(g)) for g in gradients)


def test_a_batch_equals_single_positions():
    kappas = jnp.array([-8e3, 0.0, 2e4])
    batch = jax.jit(jax.vmap(lambda kappa: bend_trajectory(published_path(-30.0), kappa).position_n(11.0)))(kappas)
    for kappa, expected in zip(kappas, batch, strict=True):
        np.testing.assert_allclose(expected, position(bend(published_path(-30.0), kappa), 11.0), rtol=1e-13, atol=1e-9)
