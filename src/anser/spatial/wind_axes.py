"""Flow angles, path angles and the bank angle about the velocity vector. Source: theory section 2."""

import jax.numpy as jnp

from anser.shapes import Matrix33, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import compose, rotate, rotation_from_euler, safe_atan2, safe_hypot, safe_norm


def rotation_wind_from_body(alpha: ScalarLike, beta: ScalarLike) -> Matrix33:
    """Return the rotation matrix ``R_wb`` (3, 3) from body to wind axes, from angle of attack and sideslip (rad)."""
    s_alpha, c_alpha = jnp.sin(alpha), jnp.cos(alpha)
    s_beta, c_beta = jnp.sin(beta), jnp.cos(beta)
    return jnp.stack(
        [
            jnp.stack([c_alpha * c_beta, s_beta, s_alpha * c_beta]),
            jnp.stack([-c_alpha * s_beta, c_beta, -s_alpha * s_beta]),
            jnp.stack([-s_alpha, jnp.zeros_like(s_alpha), c_alpha]),
        ]
    )


def flow_angles(velocity_air_b: Vector3) -> tuple[Scalar, Scalar, Scalar]:
    """Return airspeed V (m/s), alpha and beta (rad) of a velocity relative to the air (3,), body axes, m/s.

    Alpha is in [-pi, pi], beta in [-pi/2, pi/2]. At rest V, alpha and beta are 0 with zero gradients.
    """
    U, V_y, W = jnp.unstack(velocity_air_b)
    # beta = asin(V_y / V), as an arctangent with a finite gradient in a pure side flow
    return safe_norm(velocity_air_b), safe_atan2(W, U), safe_atan2(V_y, safe_hypot(U, W))


def air_direction_b(alpha: Scalar, beta: Scalar) -> Vector3:
    """Return the unit vector of the velocity relative to the air (3,), body axes, from alpha and beta (rad)."""
    return jnp.stack([jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)])


def path_angles(velocity_n: Vector3) -> tuple[Scalar, Scalar]:
    """Return flight-path angle gamma and course chi (rad) of a velocity (3,), NED, m/s.

    Gamma is in [-pi/2, pi/2], up positive; chi is in [-pi, pi], clockwise from north. In vertical flight chi is 0 with
    zero gradient; at rest gamma and chi are 0 with zero gradients.
    """
    v_N, v_E, v_D = jnp.unstack(velocity_n)
    return safe_atan2(-v_D, safe_hypot(v_N, v_E)), safe_atan2(v_E, v_N)


def bank_about_velocity(R_bn: Matrix33, alpha: ScalarLike, beta: ScalarLike) -> Scalar:
    """Return the bank angle mu about the velocity vector, rad, in [-pi, pi], positive with the right wing down.

    ``R_bn`` (3, 3) is the rotation from NED to body axes; ``alpha`` and ``beta`` are in rad. mu is ``atan2(R_wn[1, 2],
    R_wn[2, 2])`` with ``R_wn = R_wb @ R_bn``; 0 if the velocity is vertical.
    """
    _, side, under = jnp.unstack(rotate(rotation_wind_from_body(alpha, beta), R_bn[:, 2]))
    return safe_atan2(side, under)


def attitude_from_path(
    mu: ScalarLike, gamma: ScalarLike, chi: ScalarLike, alpha: ScalarLike, beta: ScalarLike
) -> Matrix33:
    """Return the attitude ``R_bn`` (3, 3), NED to body, of an aircraft from bank, path and flow angles (rad).

    ``mu`` is the bank about the velocity; ``gamma`` and ``chi`` are flight-path angle and course of the velocity
    relative to the air. The function is the inverse of `path_angles`, `bank_about_velocity` and `flow_angles` combined.
    """
    R_wb = rotation_wind_from_body(alpha, beta)
    return compose(R_wb.T, rotation_from_euler(mu, gamma, chi))
