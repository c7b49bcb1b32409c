"""Earth frames against pymap3d, and against logs of NASA's NESC check-cases."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from anser.constants import EARTH_ROTATION_RAD_S
from anser.spatial import ecef_from_geodetic, geodetic_from_ecef
from anser.spatial.frames import (
    eci_from_ecef,
    rotation_ecef_from_eci,
    rotation_ned_from_ecef,
    velocity_eci_from_ecef,
)
from anser.units import DEG_RAD, FOOT_M

# Compiled once each, not operation by operation.
ecef_from_geodetic, eci_from_ecef, geodetic_from_ecef, velocity_eci_from_ecef = map(
    jax.jit, (ecef_from_geodetic, eci_from_ecef, geodetic_from_ecef, velocity_eci_from_ecef)
)
rotation_ecef_from_eci, rotation_ned_from_ecef = map(jax.jit, (rotation_ecef_from_eci, rotation_ned_from_ecef))

latitudes = st.floats(-math.pi / 2, math.pi / 2)
longitudes = st.floats(-math.pi, math.pi)
generic = settings(deadline=None, max_examples=30)
position_slopes = jax.jit(jax.jacfwd(ecef_from_geodetic, argnums=(0, 1, 2)))  # once, not for every example
POSITION_ROUNDING_M = 1e-8  # one unit in the last place of 6.4e6 m is 9e-10 m; some ten of them

# [NESC] check-case 11 (F-16 trim, rotating WGS-84), participant sim_05 after 180 s, logged to ten figures. There the
# inertial frame coincides with the Earth-fixed one at time 0.
TIME_S = 180.0
GEODETIC = (36.21574214 * DEG_RAD, -75.42944493 * DEG_RAD, 10012.93457 * FOOT_M)
VELOCITY_NED_FT_S = [396.2789184, 403.6892787, 0.0008088155928]
POSITION_ECEF_FT = [4254235.919, -16366740.04, 12300968.96]
POSITION_ECI_FT = [4468689.952, -16309491.5, 12300968.96]
VELOCITY_ECI_FT_S = [1516.775784, 658.3487725, 319.7165655]
# Ten figures of an angle of 75 deg are 5e-9 deg or 0.6 mm, of a coordinate of 1.6e7 ft 0.005 ft or 1.5 mm,
# of a speed of 1500 ft/s 5e-7 ft/s or 1.5e-7 m/s.
LOGGED_POSITION_M = 3e-3
LOGGED_VELOCITY_M_S = 4e-7


def test_positions_equal_those_of_the_nesc_logs():
    position_e = ecef_from_geodetic(*GEODETIC)
    np.testing.assert_allclose(position_e, np.array(POSITION_ECEF_FT) * FOOT_M, atol=LOGGED_POSITION_M)
    position_i = eci_from_ecef(position_e, TIME_S, 0.0)
    np.testing.assert_allclose(position_i, np.array(POSITION_ECI_FT) * FOOT_M, atol=LOGGED_POSITION_M)
    lat, lon, h = geodetic_from_ecef(rotation_ecef_from_eci(TIME_S, 0.0) @ np.array(POSITION_ECI_FT) * FOOT_M)
    assert lat == pytest.approx(GEODETIC[0], abs=LOGGED_POSITION_M / 6.4e6)
    assert lon == pytest.approx(GEODETIC[1], abs=LOGGED_POSITION_M / 6.4e6)
    assert h == pytest.approx(GEODETIC[2], abs=LOGGED_POSITION_M)


def test_velocities_equal_those_of_the_nesc_logs():
    R_ne = rotation_ned_from_ecef(*GEODETIC[:2])
    velocity_e = np.asarray(R_ne).T @ np.array(VELOCITY_NED_FT_S) * FOOT_M
    velocity_i = velocity_eci_from_ecef(ecef_from_geodetic(*GEODETIC), velocity_e, TIME_S, 0.0)
    np.testing.assert_allclose(velocity_i, np.array(VELOCITY_ECI_FT_S) * FOOT_M, atol=LOGGED_VELOCITY_M_S)


def test_the_earth_rotates_eastwards():
    """A point on the inertial x axis moves towards inertial y: a quarter turn in a quarter of a sidereal day."""
    quarter_s = 0.5 * math.pi / EARTH_ROTATION_RAD_S
    assert quarter_s == pytest.approx(86164.1 / 4.0, abs=0.1)  # a sidereal day, in seconds
    position_i = eci_from_ecef(jnp.array([7e6, 0.0, 0.0]), quarter_s, 0.0)
    np.testing.assert_allclose(position_i, [0.0, 7e6, 0.0], atol=POSITION_ROUNDING_M)
    position_e = rotation_ecef_from_eci(0.0, 0.5 * math.pi) @ np.array([7e6, 0.0, 0.0])
    np.testing.assert_allclose(position_e, [0.0, -7e6, 0.0], atol=POSITION_ROUNDING_M)


vectors = st.tuples(*[st.floats(-8e6, 8e6)] * 3).map(np.array)
velocities = st.tuples(*[st.floats(-8e3, 8e3)] * 3).map(np.array)


@jax.jit
def differentiated_velocity(position_e, velocity_e, time, longitude_0):
    def of_time(position, t):
        return eci_from_ecef(position, t, longitude_0)

    return jax.jvp(of_time, (position_e, time), (velocity_e, 1.0))[1]


@generic
@given(vectors, st.floats(0.0, 1e5), longitudes)
def test_the_rotation_to_earth_axes_undoes_that_to_inertial_axes(position_e, time, longitude_0):
    position_i = eci_from_ecef(position_e, time, longitude_0)
    back = rotation_ecef_from_eci(time, longitude_0) @ position_i
    np.testing.assert_allclose(back, position_e, atol=POSITION_ROUNDING_M)


@generic
@given(vectors, velocities, st.floats(0.0, 1e4), longitudes)
def test_the_velocity_is_the_time_derivative_of_the_position(position_e, velocity_e, time, longitude_0):
    """Differentiation of the moving point's inertial position gives the transport term independently."""
    velocity_i = differentiated_velocity(position_e, velocity_e, time, longitude_0)
    expected = velocity_eci_from_ecef(position_e, velocity_e, time, longitude_0)
    np.testing.assert_allclose(velocity_i, expected, atol=1e-11)  # as above


@generic
@given(latitudes, longitudes, st.floats(-1e5, 1e5), st.floats(-1e5, 1e5), st.floats(-2e4, 2e3))
def test_tangent_plane_agrees_with_pymap3d(lat, lon, north, east, down):
    R_en = np.asarray(rotation_ned_from_ecef(lat, lon)).T
    position_e = ecef_from_geodetic(lat, lon, 300.0) + R_en @ np.array([north, east, down])
    expected = pymap3d.ned2ecef(north, east, down, lat, lon, 300.0, deg=False)
    np.testing.assert_allclose(position_e, expected, atol=POSITION_ROUNDING_M)


@generic
@given(latitudes, longitudes)
def test_rotations_are_proper(lat, lon):
    for R in (rotation_ned_from_ecef(lat, lon), rotation_ecef_from_eci(1e4 * lat, lon)):
        np.testing.assert_allclose(np.asarray(R) @ np.asarray(R).T, np.eye(3), atol=1e-15)
        assert np.linalg.det(R) == pytest.approx(1.0, abs=2e-15)


@generic
@given(st.floats(-1.5, 1.5), longitudes)
def test_local_axes_point_along_the_coordinates(lat, lon):
    """North, east and up are the directions of growing latitude, longitude and height, checked by differentiation."""
    axes_e = position_slopes(lat, lon, 500.0)
    R_ne = np.asarray(rotation_ned_from_ecef(lat, lon))
    for axis, sign, local_axis in zip(axes_e, (1.0, 1.0, -1.0), R_ne, strict=True):
        # The derivative of the position cancels terms of relative size e^2, and rounds.
        np.testing.assert_allclose(sign * np.asarray(axis) / np.linalg.norm(axis), local_axis, atol=5e-15)


@pytest.mark.long
def test_gradients_agree_with_differences():
    p = jnp.array([0.4, -0.7, 0.6])
    check_grads(jax.jit(lambda p, t: eci_from_ecef(p, 1e4 * t, 0.3)), (p, 0.5), order=1)
    check_grads(jax.jit(lambda p, v, t: velocity_eci_from_ecef(p, v, 1e4 * t, 0.3)), (p, p[::-1], 0.5), order=1)
    check_grads(jax.jit(rotation_ned_from_ecef), (0.7, -0.4), order=1)


def test_batches_equal_single_evaluations():
    time = np.linspace(0.0, 1e4, 7)
    position_e = 7e6 * np.random.default_rng(3).normal(size=(7, 3))
    batch = jax.jit(jax.vmap(eci_from_ecef, in_axes=(0, 0, None)))(position_e, time, 0.2)
    np.testing.assert_allclose(batch[5], eci_from_ecef(position_e[5], time[5], 0.2), atol=2 * POSITION_ROUNDING_M)
