"""Rotation matrices, quaternions and Euler angles, and lengths and angles with finite gradients at zero."""

import jax
import jax.numpy as jnp

from anser.shapes import Flag, Matrix33, Quaternion, Scalar, ScalarLike, Vector3

_TINY_SQUARED = 1e-290


def safe_norm(v: Vector3) -> Scalar:
    """Return the length of a vector (3,), in its unit; 0 with zero gradient at the zero vector."""
    return _safe_sqrt(jnp.sum(v * v))


def safe_hypot(x: ScalarLike, y: ScalarLike) -> Scalar:
    """Return the length of the vector (x, y), in its unit; 0 with zero gradient at the origin."""
    x, y = jnp.asarray(x), jnp.asarray(y)
    return _safe_sqrt(x * x + y * y)


def safe_atan2(y: ScalarLike, x: ScalarLike) -> Scalar:
    """Return the polar angle of the point (x, y), rad, in [-pi, pi]; 0 with zero gradient at the origin."""
    x, y = jnp.asarray(x), jnp.asarray(y)
    squared = x * x + y * y
    undefined, zero, one = _is_zero(squared), jnp.zeros_like(squared), jnp.ones_like(squared)
    return jnp.arctan2(_select(undefined, zero, y), _select(undefined, one, x))


def _safe_sqrt(squared: Scalar) -> Scalar:
    zero = _is_zero(squared)
    root = jnp.sqrt(_select(zero, jnp.ones_like(squared), squared))
    return _select(zero, jnp.zeros_like(squared), root)


def _select(condition: Flag, chosen: Scalar, fallback: Scalar) -> Scalar:
    """Return `jnp.where(condition, chosen, fallback)` of equal shapes, in the type of `chosen`, without nested jit."""
    return jax.lax.select(condition, chosen, fallback.astype(chosen.dtype))


def _is_zero(squared: Scalar) -> Flag:
    return squared < max(_TINY_SQUARED, float(jnp.finfo(squared.dtype).tiny))


# Below this cosine of the pitch angle, roll and yaw separately are rounding noise; only their difference or sum is
# defined. The noise is about 1e-16 / cosine, and the error of neglecting the cosine is the cosine: 1e-8 balances both.
_GIMBAL_COSINE = 1e-8


def rotation_from_quaternion(q: Quaternion) -> Matrix33:
    """Return the rotation matrix ``R_bn`` (3, 3), NED to body, of a unit quaternion (4,), scalar first.

    If the quaternion has another length, the matrix is scaled by the squared length. Source: theory section 1.
    """
    products = jnp.unstack(jnp.reshape(q[:, None] * q[None, :], 16))
    s0, q01, q02, q03, _, s1, q12, q13, _, _, s2, q23, _, _, _, s3 = products
    return jnp.stack(
        [
            jnp.stack([s0 + s1 - s2 - s3, 2.0 * (q12 + q03), 2.0 * (q13 - q02)]),
            jnp.stack([2.0 * (q12 - q03), s0 - s1 + s2 - s3, 2.0 * (q23 + q01)]),
            jnp.stack([2.0 * (q13 + q02), 2.0 * (q23 - q01), s0 - s1 - s2 + s3]),
        ]
    )


def quaternion_from_rotation(R_bn: Matrix33) -> Quaternion:
    """Return the unit quaternion (4,), scalar first with q0 >= 0, of a rotation matrix ``R_bn`` (3, 3), NED to body.

    Source: Shepperd, J. Guidance and Control 1(3), 1978.
    """
    # the products 4 q_i q_j; the row with the largest diagonal entry, at least 1, avoids a division by small numbers
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = jnp.unstack(jnp.reshape(R_bn, 9))
    q0q1, q0q2, q0q3 = r23 - r32, r31 - r13, r12 - r21
    q1q2, q1q3, q2q3 = r12 + r21, r13 + r31, r23 + r32
    q0q0 = 1.0 + r11 + r22 + r33
    q1q1 = 1.0 + r11 - r22 - r33
    q2q2 = 1.0 - r11 + r22 - r33
    q3q3 = 1.0 - r11 - r22 + r33
    products = jnp.stack(
        [
            jnp.stack([q0q0, q0q1, q0q2, q0q3]),
            jnp.stack([q0q1, q1q1, q1q2, q1q3]),
            jnp.stack([q0q2, q1q2, q2q2, q2q3]),
            jnp.stack([q0q3, q1q3, q2q3, q3q3]),
        ]
    )
    q = products[jnp.argmax(jnp.stack([q0q0, q1q1, q2q2, q3q3]))]
    return normalize(jnp.where(q[0] < 0.0, -q, q))


def rotation_from_euler(roll: ScalarLike, pitch: ScalarLike, yaw: ScalarLike) -> Matrix33:
    """Return the rotation matrix ``R_bn`` (3, 3), NED to body, of roll, pitch, yaw (rad). Source: theory section 1."""
    s_roll, c_roll = jnp.sin(roll), jnp.cos(roll)
    s_pitch, c_pitch = jnp.sin(pitch), jnp.cos(pitch)
    s_yaw, c_yaw = jnp.sin(yaw), jnp.cos(yaw)
    return jnp.stack(
        [
            jnp.stack([c_pitch * c_yaw, c_pitch * s_yaw, -s_pitch]),
            jnp.stack(
                [
                    s_roll * s_pitch * c_yaw - c_roll * s_yaw,
                    s_roll * s_pitch * s_yaw + c_roll * c_yaw,
                    s_roll * c_pitch,
                ]
            ),
            jnp.stack(
                [
                    c_roll * s_pitch * c_yaw + s_roll * s_yaw,
                    c_roll * s_pitch * s_yaw - s_roll * c_yaw,
                    c_roll * c_pitch,
                ]
            ),
        ]
    )


def quaternion_from_euler(roll: ScalarLike, pitch: ScalarLike, yaw: ScalarLike) -> Quaternion:
    """Return the unit quaternion (4,), scalar first, NED to body, of roll, pitch, yaw (rad). Source: [SL] chapter 1.

    The quaternion is continuous in the angles; q0 may be negative.
    """
    roll, pitch, yaw = jnp.asarray(roll), jnp.asarray(pitch), jnp.asarray(yaw)
    s_roll, c_roll = jnp.sin(0.5 * roll), jnp.cos(0.5 * roll)
    s_pitch, c_pitch = jnp.sin(0.5 * pitch), jnp.cos(0.5 * pitch)
    s_yaw, c_yaw = jnp.sin(0.5 * yaw), jnp.cos(0.5 * yaw)
    return jnp.stack(
        [
            c_roll * c_pitch * c_yaw + s_roll * s_pitch * s_yaw,
            s_roll * c_pitch * c_yaw - c_roll * s_pitch * s_yaw,
            c_roll * s_pitch * c_yaw + s_roll * c_pitch * s_yaw,
            c_roll * c_pitch * s_yaw - s_roll * s_pitch * c_yaw,
        ]
    )


def euler_from_rotation(R_bn: Matrix33) -> Vector3:
    """Return the Euler angles roll, pitch, yaw (3,), rad, of a rotation matrix ``R_bn`` (3, 3), NED to body.

    Roll and yaw are in [-pi, pi], pitch in [-pi/2, pi/2]. Within 1e-8 rad of straight up or down, roll is set to 0.
    Gradients are finite up to the vertical. Source: theory section 1.
    """
    c_pitch = safe_hypot(R_bn[0, 0], R_bn[0, 1])
    vertical = c_pitch < _GIMBAL_COSINE
    roll = safe_atan2(jnp.where(vertical, 0.0, R_bn[1, 2]), jnp.where(vertical, 1.0, R_bn[2, 2]))
    pitch = safe_atan2(-R_bn[0, 2], c_pitch)  # -asin(R13) of the theory, with a finite gradient up to the vertical
    yaw = safe_atan2(
        jnp.where(vertical, -R_bn[1, 0], R_bn[0, 1]),
        jnp.where(vertical, R_bn[1, 1], R_bn[0, 0]),
    )
    return jnp.stack([roll, pitch, yaw])


def euler_from_quaternion(q: Quaternion) -> Vector3:
    """Return roll, pitch, yaw (3,), rad, of a unit quaternion (4,), NED to body; ranges: see `euler_from_rotation`."""
    return euler_from_rotation(rotation_from_quaternion(q))


def quaternion_derivative(q: Quaternion, rates_b: Vector3) -> Quaternion:
    """Return the time derivative (4,), 1/s, of the attitude quaternion, NED to body. Source: theory section 2.

    ``rates_b`` is the angular velocity of the body relative to the NED axes (3,), in body axes, rad/s.
    """
    P, Q, R = jnp.unstack(rates_b)
    q0, q1, q2, q3 = jnp.unstack(q)
    return 0.5 * jnp.stack(
        [
            -P * q1 - Q * q2 - R * q3,
            P * q0 + R * q2 - Q * q3,
            Q * q0 - R * q1 + P * q3,
            R * q0 + Q * q1 - P * q2,
        ]
    )


def quaternion_multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the Hamilton product ``p q`` (4,).

    The first rotation is the left factor: the product of ``q_ba`` and ``q_cb`` is ``q_ca``, with matrix ``R_cb @
    R_ba``.
    """
    p0, p1, p2, p3 = jnp.unstack(p)
    q0, q1, q2, q3 = jnp.unstack(q)
    return jnp.stack(
        [
            p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
            p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
            p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
            p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
        ]
    )


def normalize(q: Quaternion) -> Quaternion:
    """Scale a quaternion (4,) to unit length; return quaternions shorter than 1e-145 (float32: 1e-19) unchanged."""
    squared = jnp.sum(q * q)
    return q / jnp.sqrt(jnp.where(_is_zero(squared), 1.0, squared))


def rotate(R_ba: Matrix33, v_a: Vector3) -> Vector3:
    """Transform a vector (3,) from the axes of frame a to frame b: ``R_ba @ v_a``, in the vector's unit."""
    first, second, third = jnp.unstack(R_ba * v_a[None, :], axis=1)
    return first + second + third


def rotate_back(R_ba: Matrix33, v_b: Vector3) -> Vector3:
    """Transform a vector (3,) from the axes of frame b to frame a: ``R_ba.T @ v_b``, in the vector's unit."""
    first, second, third = jnp.unstack(R_ba * v_b[:, None])
    return first + second + third


def compose(R_cb: Matrix33, R_ba: Matrix33) -> Matrix33:
    """Return the matrix of two successive rotations, from a to b and from b to c: ``R_ca = R_cb @ R_ba``."""
    first, second, third = jnp.unstack(R_cb[:, :, None] * R_ba[None, :, :], axis=1)
    return first + second + third
