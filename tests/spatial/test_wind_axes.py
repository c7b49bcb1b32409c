"""Flow and path angles against their definitions, and the way back from path and flow angles to an attitude."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from anser.spatial import flow_angles, path_angles
from anser.spatial.rotations import rotation_from_euler
from anser.spatial.wind_axes import attitude_from_path, bank_about_velocity, rotation_wind_from_body

# Compiled once each, not operation by operation.
attitude_from_path, bank_about_velocity, flow_angles, path_angles, rotation_from_euler, rotation_wind_from_body = map(
    jax.jit,
    (attitude_from_path, bank_about_velocity, flow_angles, path_angles, rotation_from_euler, rotation_wind_from_body),
)

ROUNDING = 2e-15  # quantities of order 1, some ten roundings
angles = st.floats(-3.1, 3.1)
slopes = st.floats(-1.4, 1.4)
speeds = st.floats(1.0, 700.0)
generic = settings(deadline=None, max_examples=30)


@generic
@given(speeds, angles, slopes)
def test_the_round_trip_of_flow_angles_is_exact(V, alpha, beta):
    velocity_b = V * np.array(
        [math.cos(alpha) * math.cos(beta), math.sin(beta), math.sin(alpha) * math.cos(beta)]
    )  # the definition, [SL] section 2.3
    np.testing.assert_allclose(flow_angles(velocity_b), [V, alpha, beta], rtol=20 * ROUNDING, atol=ROUNDING)
    # The first wind axis lies along the velocity.
    along = np.asarray(rotation_wind_from_body(alpha, beta)) @ velocity_b
    np.testing.assert_allclose(along, [V, 0.0, 0.0], atol=V * ROUNDING)


@generic
@given(speeds, angles, slopes)
def test_the_round_trip_of_path_angles_is_exact(V, chi, gamma):
    velocity_n = V * np.array([math.cos(gamma) * math.cos(chi), math.cos(gamma) * math.sin(chi), -math.sin(gamma)])
    np.testing.assert_allclose(path_angles(velocity_n), [gamma, chi], rtol=20 * ROUNDING, atol=ROUNDING)


def test_angles_have_the_conventional_signs():
    """Signs in words: climbing is positive gamma, east is chi 90 deg, nose above the flow is positive alpha."""
    gamma, chi = path_angles(jnp.array([0.0, 10.0, -10.0]))
    assert gamma == pytest.approx(math.pi / 4, rel=1e-15)
    assert chi == pytest.approx(math.pi / 2, rel=1e-15)
    V, alpha, beta = flow_angles(jnp.array([3.0, 0.0, 4.0]))  # air comes from below
    assert (V, beta) == (5.0, 0.0)
    assert alpha == pytest.approx(math.atan2(4.0, 3.0), rel=1e-15)
    assert flow_angles(jnp.array([10.0, 10.0, 0.0]))[2] > 0.0  # air comes from the right
    # Level flight without flow angles: bank is roll, right wing down positive.
    assert bank_about_velocity(rotation_from_euler(0.3, 0.0, 1.0), 0.0, 0.0) == pytest.approx(0.3, rel=1e-15)


@generic
@given(angles, slopes, angles, angles, slopes)
def test_the_round_trip_of_attitude_from_path_is_exact(mu, gamma, chi, alpha, beta):
    R_bn = np.asarray(attitude_from_path(mu, gamma, chi, alpha, beta))
    np.testing.assert_allclose(R_bn @ R_bn.T, np.eye(3), atol=ROUNDING)
    # A velocity along the wind axis, seen in both frames, shows all five angles again.
    velocity_b = np.asarray(rotation_wind_from_body(alpha, beta)).T @ np.array([200.0, 0.0, 0.0])
    # Rounding of 2e-15 is divided by the cosine of a slope, 0.17 at least.
    np.testing.assert_allclose(flow_angles(velocity_b), [200.0, alpha, beta], rtol=1e-14, atol=2e-14)
    np.testing.assert_allclose(path_angles(R_bn.T @ velocity_b), [gamma, chi], atol=2e-14)
    assert bank_about_velocity(R_bn, alpha, beta) == pytest.approx(mu, abs=2e-14)


def test_the_bank_is_the_angle_of_the_full_matrix():
    """Theory section 2: mu = atan2(R_wn[1, 2], R_wn[2, 2])."""
    alpha, beta = 0.31, -0.12
    R_bn = rotation_from_euler(0.5, 0.4, -2.0)
    R_wn = np.asarray(rotation_wind_from_body(alpha, beta)) @ np.asarray(R_bn)
    mu = bank_about_velocity(R_bn, alpha, beta)
    assert mu == pytest.approx(math.atan2(R_wn[1, 2], R_wn[2, 2]), abs=ROUNDING)
    assert abs(mu - 0.5) > 0.05  # generic enough that the bank is not simply the roll


@pytest.mark.parametrize("function", [flow_angles, path_angles])
def test_values_and_gradients_are_finite_on_the_axes(function):
    velocities = jnp.concatenate([jnp.zeros((1, 3)), 50.0 * jnp.eye(3), -50.0 * jnp.eye(3)])
    assert np.all(np.isfinite(jax.jit(jax.vmap(function))(velocities)))
    for jacobian in (jax.jacfwd, jax.jacrev):
        assert np.all(np.isfinite(jax.jit(jax.vmap(jacobian(function)))(velocities)))


def test_angles_at_rest_are_zero():
    np.testing.assert_array_equal(flow_angles(jnp.zeros(3)), np.zeros(3))
    np.testing.assert_array_equal(path_angles(jnp.zeros(3)), np.zeros(2))


def test_the_bank_in_vertical_flight_is_finite():
    R_bn = jnp.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # nose straight up
    assert bank_about_velocity(R_bn, 0.0, 0.0) == 0.0
    gradients = jax.jit(jax.grad(bank_about_velocity, argnums=(0, 1, 2)))(R_bn, 0.0, 0.0)
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


@pytest.mark.long
def test_gradients_agree_with_differences():
    velocity = jnp.array([1.1, -0.3, 0.4])
    R_bn = rotation_from_euler(0.5, 0.4, -2.0)
    check_grads(jax.jit(flow_angles), (velocity,), order=1)
    check_grads(jax.jit(path_angles), (velocity,), order=1)
    check_grads(jax.jit(bank_about_velocity), (R_bn, 0.3, -0.1), order=1)
    check_grads(jax.jit(attitude_from_path), (0.3, -0.1, 1.0, 0.2, 0.05), order=1)


def test_batches_equal_single_evaluations():
    path = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 5))
    R_bn = jax.jit(jax.vmap(attitude_from_path))(*path.T)
    mu = jax.jit(jax.vmap(bank_about_velocity))(R_bn, path[:, 3], path[:, 4])
    np.testing.assert_allclose(mu, path[:, 0], atol=2e-14)  # as in the round trip above
    np.testing.assert_allclose(R_bn[7], attitude_from_path(*path[7]), atol=ROUNDING)
    V, alpha, beta = jax.jit(jax.vmap(flow_angles))(path[:, :3])
    np.testing.assert_allclose([V[3], alpha[3], beta[3]], flow_angles(path[3, :3]), rtol=20 * ROUNDING, atol=ROUNDING)
