"""Geodetic coordinates against pymap3d, and round trips."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from anser.constants import WGS84_A_M
from anser.spatial import (
    WGS84,
    Ellipsoid,
    ecef_from_geodetic,
    flat_from_geodetic,
    geodetic_from_ecef,
    geodetic_from_flat,
)
from anser.spatial.wgs84 import flat_map_scale, radii_of_curvature

# Compiled once each, not operation by operation.
ecef_from_geodetic, flat_from_geodetic, flat_map_scale, geodetic_from_ecef, geodetic_from_flat, radii_of_curvature = (
    jax.jit(function)
    for function in (
        *(ecef_from_geodetic, flat_from_geodetic, flat_map_scale),
        *(geodetic_from_ecef, geodetic_from_flat, radii_of_curvature),
    )
)

WGS84_B_M = float(WGS84.b)

latitudes = st.floats(-math.pi / 2, math.pi / 2)
longitudes = st.floats(-3.14, 3.14)
heights = st.floats(-10e3, 150e3)
generic = settings(deadline=None, max_examples=30)

# Compiled once here; made inside a test, a derivative would be compiled anew for every example.
position_slopes = jax.jit(jax.jacfwd(ecef_from_geodetic, argnums=(0, 1, 2)))
geodetic_slopes = {
    "forward": jax.jit(jax.jacfwd(geodetic_from_ecef)),
    "reverse": jax.jit(jax.jacrev(geodetic_from_ecef)),
}

# One unit in the last place of 6.4e6 m is 9e-10 m; some ten of them.
POSITION_ROUNDING_M = 1e-8


@generic
@given(latitudes, longitudes, heights)
def test_ecef_positions_agree_with_pymap3d(lat, lon, h):
    expected = pymap3d.geodetic2ecef(lat, lon, h, deg=False)
    np.testing.assert_allclose(ecef_from_geodetic(lat, lon, h), expected, atol=POSITION_ROUNDING_M)


@generic
@given(latitudes, longitudes, heights)
def test_the_geodetic_round_trip_is_exact(lat, lon, h):
    back = np.asarray(geodetic_from_ecef(ecef_from_geodetic(lat, lon, h)))
    assert abs(back[0] - lat) * WGS84_A_M < POSITION_ROUNDING_M
    assert abs(back[1] - lon) * WGS84_A_M * math.cos(lat) < POSITION_ROUNDING_M
    assert abs(back[2] - h) < POSITION_ROUNDING_M


def test_the_inverse_is_accurate_at_every_latitude_and_height():
    """Latitudes from pole to pole, from 10 km below the ellipsoid to geostationary height: the docstring's claim."""
    lat, h = np.meshgrid(
        np.concatenate([np.linspace(-np.pi / 2, np.pi / 2, 181), [1e-9, np.pi / 2 - 1e-9, 0.78539]]),
        [-10e3, -1.0, 0.0, 1e4, 1e5, 4e5, 3.6e7],
    )
    lat, h = lat.ravel(), h.ravel()
    position_e = jax.jit(jax.vmap(ecef_from_geodetic, in_axes=(0, None, 0)))(lat, -1.2, h)
    lat_back, _, h_back = jax.jit(jax.vmap(geodetic_from_ecef))(position_e)
    # Rounding grows with the distance from the centre: 6.6 times the surface's at geostationary height.
    allowed = POSITION_ROUNDING_M * (1.0 + h / WGS84_A_M)
    assert np.all(np.abs(np.asarray(lat_back) - lat) * (WGS84_A_M + h) < allowed)
    assert np.all(np.abs(np.asarray(h_back) - h) < allowed)


@generic
@given(latitudes, longitudes, heights)
def test_geodetic_coordinates_agree_with_pymap3d(lat, lon, h):
    position_e = ecef_from_geodetic(lat, lon, h)
    expected = pymap3d.ecef2geodetic(*[float(x) for x in position_e], deg=False)
    lat_here, lon_here, h_here = geodetic_from_ecef(position_e)
    # pymap3d's closed form (You, 2000) is off by up to 1.0e-12 rad against exact forward positions (200,000 random
    # ones), ours by 5e-16; the height is second order in the latitude.
    np.testing.assert_allclose([lat_here, lon_here], expected[:2], atol=2e-12)
    assert h_here == pytest.approx(float(expected[2]), abs=POSITION_ROUNDING_M)


def test_coordinates_at_equator_and_poles_are_exact():
    np.testing.assert_allclose(ecef_from_geodetic(0.0, 0.0, 10.0), [WGS84_A_M + 10.0, 0.0, 0.0], rtol=1e-15)
    for sign in (1.0, -1.0):
        lat, lon, h = geodetic_from_ecef(jnp.array([0.0, 0.0, sign * (WGS84_B_M + 1000.0)]))
        assert (lat, lon) == (sign * math.pi / 2, 0.0)
        assert h == pytest.approx(1000.0, abs=POSITION_ROUNDING_M)
    lat, lon, h = geodetic_from_ecef(jnp.array([0.0, -WGS84_A_M - 1000.0, 0.0]))
    np.testing.assert_allclose([lat, lon, h], [0.0, -math.pi / 2, 1000.0], atol=POSITION_ROUNDING_M)


def test_radii_of_curvature_equal_published_values():
    """Against the polar radius in [WGS84] TR8350.2 table 3.3, 6399593.6258 m, printed to 0.1 mm."""
    R_M, R_N = radii_of_curvature(math.pi / 2)
    assert pytest.approx(6399593.6258, abs=5e-5) == R_M
    assert pytest.approx(6399593.6258, abs=5e-5) == R_N
    R_M, R_N = radii_of_curvature(0.0)
    assert R_N == WGS84_A_M
    assert pytest.approx(WGS84_B_M**2 / WGS84_A_M, rel=1e-15) == R_M


@generic
@given(st.floats(-1.4, 1.4), longitudes, heights)
def test_radii_are_the_slopes_of_the_position(lat, lon, h):
    """Moving by dphi goes (R_M + h) dphi, moving by dl goes (R_N + h) cos(phi) dl: checked by differentiation."""
    R_M, R_N = map(float, radii_of_curvature(lat))
    by_lat, by_lon, _ = position_slopes(lat, lon, h)
    # A dozen roundings of relative size 1e-16.
    np.testing.assert_allclose(np.linalg.norm(by_lat), R_M + h, rtol=3e-15)
    np.testing.assert_allclose(np.linalg.norm(by_lon), (R_N + h) * math.cos(lat), rtol=3e-15)


@pytest.mark.parametrize(
    "position_e",
    [[WGS84_A_M, 0.0, 0.0], [0.0, 0.0, WGS84_B_M], [0.0, 0.0, -WGS84_B_M], [-WGS84_A_M, 0.0, 0.0], [4e6, 1e6, 5e6]],
)
def test_the_gradient_of_the_inverse_is_finite(position_e):
    for slopes in geodetic_slopes.values():
        assert np.all(np.isfinite(slopes(jnp.array(position_e))))


@generic
@given(st.floats(-1.5, 1.5), longitudes, heights)
def test_the_gradient_of_the_inverse_inverts_the_gradient(lat, lon, h):
    forward = np.stack(position_slopes(lat, lon, h), axis=1)
    inverse = np.stack(geodetic_slopes["reverse"](ecef_from_geodetic(lat, lon, h)))
    scale = np.array([WGS84_A_M, WGS84_A_M, 1.0])  # angles as arcs, so that all entries are of order 1
    product = scale[:, None] * (inverse @ forward) / scale[None, :]
    # Second-order dependence of the inverse on its own rounded latitude and 1 / cos(1.5) = 14.
    np.testing.assert_allclose(product, np.eye(3), atol=1e-12)


offsets = st.floats(-200e3, 200e3)


@generic
@given(offsets, offsets, st.floats(-15e3, 1e3), st.floats(-1.3, 1.3), longitudes, st.floats(0.0, 2000.0))
def test_the_flat_earth_round_trip_is_exact(north, east, down, lat_0, lon_0, h_0):
    position_n = np.array([north, east, down])
    lat, lon, h = geodetic_from_flat(position_n, lat_0, lon_0, h_0)
    back = flat_from_geodetic(lat, lon, h, lat_0, lon_0, h_0)
    # Angles up to pi round by 4e-16, which is 3e-9 m on the ground.
    np.testing.assert_allclose(back, position_n, atol=2 * POSITION_ROUNDING_M)
    other_turn = flat_from_geodetic(lat, float(lon) - 2.0 * math.pi, h, lat_0, lon_0, h_0)
    np.testing.assert_allclose(other_turn, position_n, atol=4 * POSITION_ROUNDING_M)


def test_a_small_flat_earth_offset_is_the_arc():
    """Theory section 1, "small: p_N / (R_M + h_0)": the arctangent is less by a third of the cube, 1e-13 rad."""
    R_M, R_N = (float(R) for R in radii_of_curvature(0.6))
    lat, lon, h = geodetic_from_flat(jnp.array([300.0, -350.0, -120.0]), 0.6, 1.0, 50.0)
    assert lat - 0.6 == pytest.approx(300.0 / (R_M + 50.0), abs=2e-13)
    assert lon - 1.0 == pytest.approx(-350.0 / ((R_N + 50.0) * math.cos(0.6)), abs=2e-13)
    assert h == 170.0


def test_the_flat_earth_map_continues_along_its_tangent():
    """The arctangent up to 45 deg, a smooth continuation to every longitude, and the scale as the derivative."""
    R_M, R_N = (float(R) for R in radii_of_curvature(0.6))
    across = R_N * math.cos(0.6)
    east_slope = jax.jit(jax.grad(lambda lon: flat_from_geodetic(-0.4, lon, 0.0, 0.6, 3.0, 0.0)[1]))
    for longitude_difference in (0.3, 0.25 * math.pi - 1e-9, -0.25 * math.pi, 2.0, -3.0, 3.14):
        position = np.asarray(flat_from_geodetic(-0.4, 3.0 + longitude_difference, 0.0, 0.6, 3.0, 0.0))
        limited = max(-0.25 * math.pi, min(longitude_difference, 0.25 * math.pi))
        assert float(position[1]) == pytest.approx(
            across * (math.tan(limited) + 2.0 * (longitude_difference - limited)), rel=1e-15
        )
        assert float(position[0]) == pytest.approx(-R_M * (1.0 + 2.0 * (1.0 - 0.25 * math.pi)), rel=1e-15)
        slope = east_slope(3.0 + longitude_difference)
        assert abs(longitude_difference) == 0.25 * math.pi or slope / across == pytest.approx(
            float(flat_map_scale(position[1], across)), rel=1e-12
        )
        assert float(geodetic_from_flat(position, 0.6, 3.0, 0.0)[1]) == pytest.approx(
            3.0 + longitude_difference, abs=1e-15
        )


def test_the_flat_earth_deviates_from_the_tangent_plane_to_second_order():
    """10 km away the flat Earth departs from the tangent plane by the second-order terms of a sphere, and by no more.

    The ground drops by d^2 / 2R; the parallel bends polewards by E^2 tan(phi) / 2R; parallels shorten by
    E N tan(phi) / R. Third order is d / R = 0.2 % of those, and taking one radius for both of the ellipsoid's is wrong
    by up to 0.4 %.
    """
    lat_0, lon_0 = 0.7, -0.4
    north, east = 6000.0, 8000.0
    flat = jnp.array([north, east, 0.0])
    position_e = ecef_from_geodetic(*geodetic_from_flat(flat, lat_0, lon_0, 0.0))
    east_m, north_m, up_m = pymap3d.ecef2enu(*position_e.tolist(), lat_0, lon_0, 0.0, deg=False)
    exact = np.array([north_m, east_m, -up_m])
    R = float(sum(radii_of_curvature(lat_0))) / 2.0
    bend, drop = math.tan(lat_0) / R, 1e8 / (2.0 * R)
    assert exact[0] - north == pytest.approx(0.5 * east**2 * bend, rel=0.01)
    assert exact[1] - east == pytest.approx(-east * north * bend, rel=0.01)
    assert exact[2] == pytest.approx(drop, rel=0.01)
    assert 7.0 < exact[2] < 8.5  # some eight metres


@pytest.mark.long
def test_gradients_agree_with_differences():
    # In units of 1 for check_grads' steps: kilometres and radians.
    check_grads(
        jax.jit(lambda p: geodetic_from_flat(1e3 * p, 0.7, -0.4, 100.0)), (jnp.array([1.0, -2.0, -3.0]),), order=1
    )
    check_grads(jax.jit(lambda lat, lon: ecef_from_geodetic(lat, lon, 1e3) / WGS84_A_M), (0.7, -0.4), order=1)
    assert np.all(np.isfinite(jax.jit(jax.jacrev(flat_from_geodetic))(0.7, -0.4, 10.0, 0.7, -0.4, 10.0)))


def test_batches_equal_single_evaluations():
    lat = jnp.linspace(-1.5, 1.5, 11)
    lon = jnp.linspace(-3.0, 3.0, 11)
    h = jnp.linspace(-1e3, 2e4, 11)
    position_e = jax.jit(jax.vmap(ecef_from_geodetic))(lat, lon, h)
    np.testing.assert_allclose(position_e[4], ecef_from_geodetic(lat[4], lon[4], h[4]), atol=POSITION_ROUNDING_M)
    position_n = jax.jit(jax.vmap(flat_from_geodetic, in_axes=(0, 0, 0, None, None, None)))(lat, lon, h, 0.1, 0.2, 0.0)
    lat_back, _, _ = jax.jit(jax.vmap(geodetic_from_flat, in_axes=(0, None, None, None)))(position_n, 0.1, 0.2, 0.0)
    np.testing.assert_allclose(lat_back, lat, atol=1e-15)


@settings(deadline=None, max_examples=30)
@given(st.floats(-1.57, 1.57), st.floats(-3.1, 3.1), st.floats(-5e3, 5e5))
def test_a_sphere_is_an_ellipsoid_without_flattening(lat, lon, h):
    """On a sphere geodetic coordinates are spherical ones, and both radii of curvature are its own."""
    sphere = Ellipsoid(6371007.1809, 0.0)
    position_e = ecef_from_geodetic(lat, lon, h, sphere)
    outward = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    np.testing.assert_allclose(position_e, (6371007.1809 + h) * outward, atol=1e-8)
    np.testing.assert_allclose(geodetic_from_ecef(position_e, sphere), (lat, lon, h), atol=4e-9, rtol=1e-12)
    np.testing.assert_allclose(radii_of_curvature(lat, sphere), 6371007.1809, rtol=1e-15)


def test_ellipsoid_parameters_follow_from_a_and_f():
    # [WGS84] TR8350.2 table 3.3: semi-minor axis to 0.1 mm, first and second eccentricity squared to 14 decimals.
    assert pytest.approx(6356752.3142, abs=5e-5) == WGS84.b
    assert pytest.approx(6.69437999014e-3, abs=5e-15) == WGS84.e2
    assert pytest.approx(6.73949674228e-3, abs=5e-15) == WGS84.ep2
    # Theory section 1 prints e itself to 13 decimals.
    assert math.sqrt(WGS84.e2) == pytest.approx(0.0818191908426, abs=5e-14)
