"""Rotations against scipy, consistency of conversions, and singular attitudes."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads
from scipy.spatial.transform import Rotation

from anser.numerics.linear import cross
from anser.spatial import euler_from_quaternion, quaternion_from_euler, rotation_from_quaternion
from anser.spatial.rotations import (
    compose,
    euler_from_rotation,
    normalize,
    quaternion_derivative,
    quaternion_from_rotation,
    quaternion_multiply,
    rotate,
    rotate_back,
    rotation_from_euler,
)

# Compiled once each, not operation by operation.
compose, cross, euler_from_quaternion, euler_from_rotation, normalize, quaternion_derivative, quaternion_from_euler = (
    jax.jit(function)
    for function in (
        *(compose, cross, euler_from_quaternion, euler_from_rotation, normalize),
        *(quaternion_derivative, quaternion_from_euler),
    )
)
quaternion_from_rotation, quaternion_multiply, rotate, rotate_back, rotation_from_euler, rotation_from_quaternion = map(
    jax.jit,
    (quaternion_from_rotation, quaternion_multiply, rotate, rotate_back, rotation_from_euler, rotation_from_quaternion),
)


@jax.jit
def matrix_and_slope(q, rates):
    return jax.jvp(rotation_from_quaternion, (q,), (quaternion_derivative(q, rates),))


# All quantities here are of order 1 and take at most some ten roundings of 1.1e-16 each.
ROUNDING = 2e-15

angles = st.floats(-math.pi, math.pi)
pitches = st.floats(-1.5, 1.5)
components = st.floats(-10.0, 10.0)
vectors = st.tuples(components, components, components).map(np.array)
quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
generic = settings(deadline=None, max_examples=30)


def scipy_rotation_bn(roll, pitch, yaw):
    """The matrix of scipy maps body to NED vectors; its transpose maps NED to body."""
    return Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix().T


@generic
@given(angles, pitches, angles)
def test_euler_to_rotation_agrees_with_scipy(roll, pitch, yaw):
    expected = scipy_rotation_bn(roll, pitch, yaw)
    np.testing.assert_allclose(rotation_from_euler(roll, pitch, yaw), expected, atol=ROUNDING)
    q = quaternion_from_euler(roll, pitch, yaw)
    np.testing.assert_allclose(rotation_from_quaternion(q), expected, atol=ROUNDING)


@generic
@given(angles, pitches, angles)
def test_euler_to_quaternion_agrees_with_scipy(roll, pitch, yaw):
    q = np.asarray(quaternion_from_euler(roll, pitch, yaw))
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True)
    assert abs(q @ expected) == pytest.approx(1.0, abs=ROUNDING)  # equal up to the sign, which is free


@generic
@given(angles, pitches, angles)
def test_the_round_trip_of_euler_angles_is_exact(roll, pitch, yaw):
    back = euler_from_quaternion(quaternion_from_euler(roll, pitch, yaw))
    difference = np.asarray(back) - np.array([roll, pitch, yaw])
    # Rounding in the matrix reaches roll and yaw divided by cos(1.5) = 0.07; +-pi is one and the same angle.
    np.testing.assert_allclose(np.sin(difference), 0.0, atol=20 * ROUNDING)
    np.testing.assert_allclose(np.cos(difference), 1.0, atol=ROUNDING)


@generic
@given(quaternions)
def test_the_round_trip_of_quaternions_is_exact(q):
    back = np.asarray(quaternion_from_rotation(rotation_from_quaternion(q)))
    assert back[0] >= 0.0
    # Compared as vectors, not by their product, which would square the error away.
    np.testing.assert_allclose(back * np.sign(back @ q), q, atol=2 * ROUNDING)


shepperd_slopes = [jax.jit(jacobian(quaternion_from_rotation)) for jacobian in (jax.jacfwd, jax.jacrev)]


@pytest.mark.parametrize("row", range(4))
@pytest.mark.parametrize("small", [0.0, 1e-9])
def test_quaternions_of_half_turns_are_exact(row, small):
    """Shepperd's method with a single dominant component, in particular half turns (q0 = 0)."""
    q = np.full(4, small)
    q[row] = 1.0
    q /= np.linalg.norm(q)
    R_bn = rotation_from_quaternion(q)
    back = np.asarray(quaternion_from_rotation(R_bn))
    np.testing.assert_allclose(back, q, atol=ROUNDING)
    assert all(np.all(np.isfinite(slopes(R_bn))) for slopes in shepperd_slopes)


@generic
@given(quaternions, vectors)
def test_the_derivative_preserves_the_length(q, rates):
    q_dot = np.asarray(quaternion_derivative(q, rates))
    # Four products of order 10 cancel.
    assert q @ q_dot == pytest.approx(0.0, abs=10 * ROUNDING)
    assert np.linalg.norm(q_dot) == pytest.approx(0.5 * np.linalg.norm(rates), abs=10 * ROUNDING)


@generic
@given(quaternions, vectors)
def test_the_derivative_rotates_the_frame_at_the_body_rates(q, rates):
    """R_bn_dot = -[w x] R_bn (Poisson's equation), by differentiating the matrix along q_dot."""
    R_bn, R_dot = matrix_and_slope(q, rates)
    P, Q, R = rates
    spin = np.array([[0.0, -R, Q], [R, 0.0, -P], [-Q, P, 0.0]])
    np.testing.assert_allclose(R_dot, -spin @ np.asarray(R_bn), atol=20 * ROUNDING)  # rates up to 10


@generic
@given(quaternions, quaternions)
def test_the_product_chains_rotations(q_ba, q_cb):
    chained = rotation_from_quaternion(quaternion_multiply(q_ba, q_cb))
    R_cb, R_ba = rotation_from_quaternion(q_cb), rotation_from_quaternion(q_ba)
    np.testing.assert_allclose(chained, np.asarray(R_cb) @ np.asarray(R_ba), atol=2 * ROUNDING)
    np.testing.assert_allclose(compose(R_cb, R_ba), np.asarray(R_cb) @ np.asarray(R_ba), atol=ROUNDING)


@generic
@given(quaternions, vectors, vectors)
def test_products_agree_with_numpy(q, v, w):
    R = np.asarray(rotation_from_quaternion(q))
    # Vectors up to 10, their products up to 100.
    np.testing.assert_allclose(rotate(R, v), R @ v, atol=10 * ROUNDING)
    np.testing.assert_allclose(rotate_back(R, v), R.T @ v, atol=10 * ROUNDING)
    np.testing.assert_allclose(cross(v, w), np.cross(v, w), atol=100 * ROUNDING)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.0), (0.4, -1.1), (-2.0, 2.5)])
def test_a_vertical_attitude_keeps_its_matrix(pitch, roll, yaw):
    """Straight up or down the split into roll and yaw is free, but the angles must still give the same attitude."""
    for R_bn in (
        rotation_from_euler(roll, pitch, yaw),
        rotation_from_quaternion(quaternion_from_euler(roll, pitch, yaw)),
    ):
        euler = euler_from_rotation(R_bn)
        assert euler[0] == 0.0
        # The cosine of pitch, below 1e-8, is ignored there.
        np.testing.assert_allclose(rotation_from_euler(*np.asarray(euler)), R_bn, atol=1e-8)


@pytest.mark.parametrize("off_vertical", [3e-7, 1e-7, 3e-8, 1.1e-8, 0.9e-8, 1e-9])
def test_an_attitude_close_to_vertical_keeps_its_matrix(off_vertical):
    R_bn = rotation_from_quaternion(quaternion_from_euler(0.7, math.pi / 2 - off_vertical, -0.3))
    back = rotation_from_euler(*np.asarray(euler_from_rotation(R_bn)))
    # Rounding 2e-16 over a cosine of 1e-8 above the threshold, the cosine itself below: see _GIMBAL_COSINE.
    np.testing.assert_allclose(back, R_bn, atol=4e-8)


def test_gradients_are_finite_at_special_attitudes():
    q = jnp.stack([quaternion_from_euler(0.0, pitch, 0.0) for pitch in (0.0, math.pi / 2, -math.pi / 2)])
    exact_vertical = jnp.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    for jacobian in (jax.jacfwd, jax.jacrev):
        assert np.all(np.isfinite(jax.jit(jax.vmap(jacobian(euler_from_quaternion)))(q)))
        assert np.all(np.isfinite(jax.jit(jacobian(euler_from_rotation))(exact_vertical)))


@pytest.mark.long
def test_gradients_agree_with_differences():
    q = normalize(jnp.array([0.7, -0.3, 0.5, 0.2]))
    rates = jnp.array([0.3, -0.2, 0.1])
    R_bn = rotation_from_quaternion(q)
    # jax's default tolerance for float64, 1e-5, is wide for central differences of functions of order 1.
    check_grads(jax.jit(rotation_from_quaternion), (q,), order=1)
    check_grads(jax.jit(euler_from_quaternion), (q,), order=1)
    check_grads(jax.jit(quaternion_from_rotation), (R_bn,), order=1)
    check_grads(jax.jit(quaternion_from_euler), (0.3, -0.5, 2.0), order=1)
    check_grads(jax.jit(rotation_from_euler), (0.3, -0.5, 2.0), order=1)
    check_grads(jax.jit(quaternion_derivative), (q, rates), order=1)


def test_normalized_quaternions_have_unit_length():
    q = jnp.array([3.0, -1.0, 2.0, 0.5])
    unit = normalize(q)
    np.testing.assert_allclose(unit, np.asarray(q) / np.linalg.norm(q), atol=ROUNDING)
    nothing = jnp.zeros(4)
    np.testing.assert_array_equal(normalize(nothing), nothing)
    np.testing.assert_array_equal(normalize(jnp.zeros(4, jnp.float32)), np.zeros(4))
    assert np.all(np.isfinite(jax.jit(jax.jacrev(normalize))(nothing)))
    np.testing.assert_allclose(jax.jit(jax.jacfwd(normalize))(unit), np.eye(4) - np.outer(unit, unit), atol=ROUNDING)


def test_batches_equal_single_evaluations():
    random = np.random.default_rng(1)
    q, v = random.normal(size=(50, 4)), random.normal(size=(50, 3))
    q /= np.linalg.norm(q, axis=1, keepdims=True)

    def chain(q, v):
        R_bn = rotation_from_quaternion(q)
        crossed = cross(rotate(R_bn, v), rotate_back(R_bn, v))
        return euler_from_rotation(R_bn), quaternion_from_rotation(R_bn), quaternion_derivative(q, crossed)

    batch = jax.jit(jax.vmap(chain))(q, v)
    for i in (0, 17, 49):
        # Fused arithmetic may round differently; vectors of order 10.
        for whole, single in zip(batch, jax.jit(chain)(q[i], v[i]), strict=True):
            np.testing.assert_allclose(whole[i], single, atol=20 * ROUNDING)
