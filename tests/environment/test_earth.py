"""Flat and round Earth: gravity against potentials and published values, the chart against pymap3d."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.constants import EARTH_GM_M3_S2, EARTH_J2, EARTH_ROTATION_RAD_S, WGS84_A_M
from anser.environment import FlatEarth, wgs84_earth
from anser.environment.earth import gravitation_j2, somigliana, spherical_earth
from anser.spatial import ecef_from_geodetic
from anser.spatial.frames import rotation_ned_from_ecef
from anser.units import DEG_RAD, FOOT_M, RAD_DEG

generic = settings(deadline=None, max_examples=30)
LATITUDE, LONGITUDE = 50.0 * DEG_RAD, 179.9 * DEG_RAD  # the date line runs through the chart
EARTH = wgs84_earth(LATITUDE, LONGITUDE)
FLAT = FlatEarth(jnp.asarray(9.81))
chart_positions = st.tuples(*(st.floats(-50e3, 50e3),) * 2, st.floats(-15e3, -10.0)).map(jnp.array)
velocities = st.tuples(*(st.floats(-300.0, 300.0),) * 3).map(jnp.array)

_sight, _local, _geodetic = (eqx.filter_jit(f) for f in (EARTH.sight, EARTH.local_earth, EARTH.geodetic))


@jax.jit
def _velocity_e(position, rate):
    return jax.jvp(EARTH.ecef_from_chart, (position,), (rate,))[1]


def _axes(position):
    lat, lon, _ = EARTH.geodetic(position)
    return rotation_ned_from_ecef(lat, lon)


_rotation_ne = jax.jit(_axes)
_local_of = eqx.filter_jit(lambda earth, position, velocity_n: earth.local_earth(position, velocity_n))
_turning_axes = jax.jit(lambda position, rate: jax.jvp(_axes, (position,), (rate,)))
_position_e = eqx.filter_jit(EARTH.ecef_from_chart)
_gravitation_e = eqx.filter_jit(lambda earth, position: earth.gravitation_e(earth.ecef_from_chart(position)))
_returned = eqx.filter_jit(
    lambda earth, position, *line: earth.motion_on_chart(position, *earth.sight(position, *line))
)


def _geodetic_deg(position):
    lat, lon, h = _geodetic(position)
    return float(lat) * RAD_DEG, float(lon) * RAD_DEG, float(h)


def test_gravitation_equals_that_of_the_nesc_check_cases():
    """[NESC]: 32.106535952 ft/s^2 at 30,000 ft over the equator with J2, 32.126312071 over the sphere; ten digits."""
    place_n = jnp.array([0.0, 0.0, -30_000.0 * FOOT_M])
    for earth, expected in (
        (wgs84_earth(0.0, 0.0), 32.106535952),
        (spherical_earth(6371007.1809, 0.0, 0.0), 32.126312071),
    ):
        gravitation = np.linalg.norm(_gravitation_e(earth, place_n)) / FOOT_M
        assert float(gravitation) == pytest.approx(expected, abs=6e-10)


_gravitation = jax.jit(gravitation_j2)


@jax.jit
@jax.grad
def _potential_slope(p):
    r = jnp.sqrt(jnp.sum(p * p))
    legendre = 0.5 * (3.0 * (p[2] / r) ** 2 - 1.0)
    return EARTH_GM_M3_S2 / r * (1.0 - EARTH_J2 * (WGS84_A_M / r) ** 2 * legendre)


@generic
@given(st.tuples(*(st.floats(-1.0, 1.0),) * 3).filter(lambda d: np.linalg.norm(d) > 0.1), st.floats(6.3e6, 5e7))
def test_gravitation_is_the_gradient_of_its_potential(direction, radius):
    position_e = np.array(direction) / np.linalg.norm(direction) * radius
    expected = np.asarray(_potential_slope(position_e))
    gravitation = _gravitation(position_e, EARTH_GM_M3_S2, EARTH_J2, WGS84_A_M)
    np.testing.assert_allclose(gravitation, expected, atol=1e-13 * np.max(np.abs(expected)))


@pytest.mark.parametrize("latitude_deg", [0.0, 20.0, 45.0, 70.0, 89.0])
def test_gravity_on_the_ellipsoid_is_normal_gravity(latitude_deg):
    """The J2 field leaves out the ellipsoid's own J4 of 2.37e-6 and higher: up to 5 J4 g = 1.17e-4 m/s^2, at the pole."""
    earth = wgs84_earth(latitude_deg * DEG_RAD, 0.3)
    local = _local_of(earth, jnp.zeros(3), jnp.zeros(3))
    assert float(local.gravity) == pytest.approx(float(somigliana(latitude_deg * DEG_RAD)), abs=1.3e-4)
    assert abs(float(local.apparent_gravity_n[0])) < 1.3e-4
    assert float(local.apparent_gravity_n[1]) == pytest.approx(0.0, abs=1e-15)


@generic
@given(chart_positions, velocities)
def test_the_chart_moves_with_the_velocity(place, velocity_n):
    """The rate of the chart times its Jacobian equals the velocity: an independent check of the scale."""
    rate = _local(place, velocity_n).chart_scale * velocity_n
    expected = np.asarray(_rotation_ne(place)).T @ np.asarray(velocity_n)
    # 6.4e6 m times the rounding of sines.
    np.testing.assert_allclose(_velocity_e(place, rate), expected, atol=1e-9)


anywhere = st.tuples(st.floats(-89.99, 89.99), st.floats(-180.0, 180.0))


@jax.jit
def _through_the_chart(earth, lat, lon, h):
    """Chart position, geodetic coordinates converted back, and deviation of the scaled Jacobian from the axes."""
    position = earth.chart_from_ecef(ecef_from_geodetic(lat, lon, h))
    jacobian = (
        jax.jacfwd(earth.ecef_from_chart)(position) * earth.local_earth(position, jnp.zeros(3)).chart_scale[None, :]
    )
    return position, earth.geodetic(position), jacobian - rotation_ned_from_ecef(lat, lon).T


@pytest.mark.long
@settings(deadline=None, max_examples=100)
@given(anywhere, anywhere, st.floats(0.0, 15e3))
def test_the_chart_is_one_to_one(origin_deg, there_deg, h):
    """From any origin but a pole; north and east have the signs of the differences of latitude and longitude."""
    (lat_0, lon_0), (lat, lon) = (np.radians(position) for position in (origin_deg, there_deg))
    position, (lat_back, lon_back, h_back), slope = _through_the_chart(wgs84_earth(lat_0, lon_0), lat, lon, h)
    longitude_difference = (lon - lon_0 + np.pi) % (2.0 * np.pi) - np.pi
    # Angles of up to pi round by 4e-16 on each of some ten ways; an arc is 6.4e6 m times that.
    assert float(lat_back) == pytest.approx(lat, abs=4e-15)
    across = np.cos(lat)
    assert across * abs((float(lon_back) - lon + np.pi) % (2.0 * np.pi) - np.pi) < 4e-15
    assert float(h_back) == pytest.approx(h, abs=1e-8)
    np.testing.assert_allclose(slope, 0.0, atol=1e-14 / across)
    for coordinate, expected in zip(position[:2], (lat - lat_0, longitude_difference), strict=True):
        assert abs(expected) < 1e-9 or abs(abs(expected) - np.pi) < 1e-9 or np.sign(coordinate) == np.sign(expected)


def test_gradients_at_special_points_of_the_chart_are_finite():
    """At the origin, at an eighth of a turn, on the opposite meridian, and at a pole."""
    earth = wgs84_earth(0.5, 1.0)
    inverse = jax.jit(jax.jacrev(earth.chart_from_ecef))
    forward = jax.jit(jax.jacrev(lambda position: (earth.geodetic(position), earth.local_earth(position, jnp.ones(3)))))
    edge = 0.25 * np.pi
    for lat, lon in (
        (0.5, 1.0),
        (0.5 + edge, 1.0 - edge),
        (-0.3, 1.0 - np.pi),
        (-0.3, 1.0 + np.pi),
        (0.5 * np.pi, 0.0),
    ):
        position_e = ecef_from_geodetic(lat, lon, 1e3)
        assert np.all(np.isfinite(inverse(position_e)))
        for leaf in jax.tree.leaves(forward(earth.chart_from_ecef(position_e))):
            assert np.all(np.isfinite(leaf))


@generic
@given(chart_positions, velocities)
def test_the_axes_turn_with_the_transport_rate(position, velocity_n):
    local = _local(position, velocity_n)

    R_ne, R_ne_dot = _turning_axes(position, local.chart_scale * velocity_n)
    x, y, z = np.asarray(local.transport_rate_n)
    np.testing.assert_allclose(R_ne_dot, -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ R_ne, atol=1e-16)


@generic
@given(chart_positions, velocities)
def test_apparent_gravity_is_gravity_less_coriolis(position, velocity_n):
    """Against vector products in Earth-fixed axes; the part of the turning axes is the transport rate's, tested above."""
    local = _local(position, velocity_n)
    position_e = np.asarray(_position_e(position))
    R_ne = np.asarray(_rotation_ne(position))
    w_e = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
    attraction = np.asarray(_gravitation_e(EARTH, position)) - np.cross(w_e, np.cross(w_e, position_e))
    coriolis = 2 * np.cross(w_e, R_ne.T @ np.asarray(velocity_n))
    turning = np.cross(local.transport_rate_n, velocity_n)
    np.testing.assert_allclose(local.apparent_gravity_n, R_ne @ (attraction - coriolis) - turning, atol=1e-13)
    np.testing.assert_allclose(local.earth_rate_n, R_ne @ w_e, atol=1e-19)


@generic
@given(chart_positions, chart_positions)
def test_the_sight_line_agrees_with_pymap3d(position, target):
    line_n, _ = _sight(position, target, jnp.zeros(3))
    expected = pymap3d.geodetic2ned(*_geodetic_deg(target), *_geodetic_deg(position))
    np.testing.assert_allclose(line_n, expected, atol=1e-7)  # two positions of 6.4e6 m through degrees


@generic
@given(chart_positions, chart_positions, velocities)
@pytest.mark.parametrize("earth", [EARTH, FLAT], ids=["round", "flat"])
def test_the_motion_on_the_chart_inverts_the_sight(earth, position, target, rate):
    returned, returned_rate = _returned(earth, position, target, rate)
    np.testing.assert_allclose(returned, target, atol=1e-7)
    np.testing.assert_allclose(returned_rate, rate, atol=1e-10)


def test_the_flat_earth_has_gravity_only():
    local = FLAT.local_earth(jnp.array([1e4, -2e4, -3e3]), jnp.array([150.0, 20.0, 3.0]))
    np.testing.assert_array_equal(local.apparent_gravity_n, [0.0, 0.0, 9.81])
    for zero in (local.earth_rate_n, local.transport_rate_n):
        np.testing.assert_array_equal(zero, np.zeros(3))
    np.testing.assert_array_equal(local.chart_scale, np.ones(3))
    line, velocity = FLAT.sight(jnp.array([1.0, 2.0, -3.0]), jnp.array([4.0, 6.0, -8.0]), jnp.ones(3))
    np.testing.assert_array_equal(line, [3.0, 4.0, -5.0])
    np.testing.assert_array_equal(velocity, np.ones(3))


@pytest.mark.long
def test_results_support_gradients_and_batches():
    position, velocity_n = jnp.array([3e3, -4e3, -1e3]), jnp.array([100.0, -50.0, 5.0])

    def total(p, v):
        local = EARTH.local_earth(p, v)
        line, rate = EARTH.sight(p, 2.0 * p, v)
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves((local, line, rate)))

    for gradient in jax.jit(jax.grad(total, (0, 1)))(position, velocity_n):
        assert np.all(np.isfinite(gradient))
    batch = jax.jit(jax.vmap(EARTH.local_earth))(jnp.stack([position, position + 10.0]), jnp.stack([velocity_n] * 2))
    single = _local(position, velocity_n)
    np.testing.assert_allclose(batch.apparent_gravity_n[0], single.apparent_gravity_n, rtol=1e-14)
