"""Transformations between inertial (ECI), Earth-fixed (ECEF) and local (NED) frames. Source: theory section 1."""

import jax.numpy as jnp

from anser.constants import EARTH_ROTATION_RAD_S
from anser.shapes import Matrix33, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import rotate_back


def rotation_ecef_from_eci(
    time: ScalarLike, longitude_0: ScalarLike, rotation_rate: ScalarLike = EARTH_ROTATION_RAD_S
) -> Matrix33:
    """Return the rotation matrix ``R_ei`` (3, 3) from ECI to ECEF axes at a time (s).

    ``longitude_0`` (lambda_0), rad, is the angle from the inertial to the Earth-fixed first axis at time 0;
    ``rotation_rate``, rad/s, is the Earth's rotation rate.
    """
    eta = jnp.asarray(longitude_0) + rotation_rate * jnp.asarray(time)
    s, c = jnp.sin(eta), jnp.cos(eta)
    zero, unity = jnp.zeros_like(s), jnp.ones_like(s)
    return jnp.stack([jnp.stack([c, s, zero]), jnp.stack([-s, c, zero]), jnp.stack([zero, zero, unity])])


def eci_from_ecef(
    position_e: Vector3, time: ScalarLike, longitude_0: ScalarLike, rotation_rate: ScalarLike = EARTH_ROTATION_RAD_S
) -> Vector3:
    """Convert a position (3,), m, from Earth-fixed (ECEF) to inertial (ECI) axes at a time (s).

    For ``longitude_0`` (rad) and ``rotation_rate`` (rad/s) see `rotation_ecef_from_eci`.
    """
    return rotate_back(rotation_ecef_from_eci(time, longitude_0, rotation_rate), position_e)


def velocity_eci_from_ecef(
    position_e: Vector3,
    velocity_e: Vector3,
    time: ScalarLike,
    longitude_0: ScalarLike,
    rotation_rate: ScalarLike = EARTH_ROTATION_RAD_S,
) -> Vector3:
    """Return the inertial velocity (3,), ECI axes, m/s, of a moving point: ``R_ei.T (v_e + w_E x p_e)``.

    ``position_e`` (3,), m, and ``velocity_e`` (3,), m/s, are relative to the Earth, in ECEF axes; ``time`` is in s. For
    the other arguments see `rotation_ecef_from_eci`.
    """
    inertial_e = velocity_e + _earth_rotation_cross(position_e, rotation_rate)
    return rotate_back(rotation_ecef_from_eci(time, longitude_0, rotation_rate), inertial_e)


def _earth_rotation_cross(position: Vector3, rotation_rate: ScalarLike) -> Vector3:
    axis_cross_position: list[Scalar] = [-position[1], position[0], jnp.zeros_like(position[2])]
    return rotation_rate * jnp.stack(axis_cross_position)


def rotation_ned_from_ecef(lat: ScalarLike, lon: ScalarLike) -> Matrix33:
    """Return the rotation matrix ``R_ne`` (3, 3) from ECEF to NED axes at a geodetic latitude and longitude (rad)."""
    s_lat, c_lat = jnp.sin(lat), jnp.cos(lat)
    s_lon, c_lon = jnp.sin(lon), jnp.cos(lon)
    return jnp.stack(
        [
            jnp.stack([-s_lat * c_lon, -s_lat * s_lon, c_lat]),
            jnp.stack([-s_lon, c_lon, jnp.zeros_like(s_lon)]),
            jnp.stack([-c_lat * c_lon, -c_lat * s_lon, -s_lat]),
        ]
    )
