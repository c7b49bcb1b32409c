"""Geodetic coordinates on an ellipsoid of revolution, by default WGS-84; a sphere is the special case f = 0.

Source: theory section 1, [WGS84].
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.constants import WGS84_A_M, WGS84_F
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_atan2, safe_hypot


class Ellipsoid(eqx.Module):
    """An oblate ellipsoid of revolution, or a sphere."""

    a: ScalarLike  #: Semi-major axis (equatorial radius), m.
    f: ScalarLike  #: Flattening (a - b)/a; 0 for a sphere.

    @property
    def b(self) -> ScalarLike:
        """Semi-minor axis (polar radius), m."""
        return self.a * (1.0 - self.f)

    @property
    def e2(self) -> ScalarLike:
        """First eccentricity squared, (a^2 - b^2)/a^2."""
        return self.f * (2.0 - self.f)

    @property
    def ep2(self) -> ScalarLike:
        """Second eccentricity squared, (a^2 - b^2)/b^2."""
        return self.e2 / (1.0 - self.e2)


WGS84 = Ellipsoid(WGS84_A_M, WGS84_F)


def radii_of_curvature(lat: ScalarLike, ellipsoid: Ellipsoid = WGS84) -> tuple[Scalar, Scalar]:
    """Return the radii of curvature of meridian (R_M) and prime vertical (R_N), m, at a geodetic latitude (rad)."""
    w2 = 1.0 - ellipsoid.e2 * jnp.sin(lat) ** 2
    R_N = ellipsoid.a / jnp.sqrt(w2)
    return R_N * (1.0 - ellipsoid.e2) / w2, R_N


def ecef_from_geodetic(lat: ScalarLike, lon: ScalarLike, h: ScalarLike, ellipsoid: Ellipsoid = WGS84) -> Vector3:
    """Return the Earth-fixed position (3,), ECEF, m, of geodetic latitude and longitude (rad) and height `h` (m).

    The height is above the ellipsoid.
    """
    s_lat, c_lat = jnp.sin(lat), jnp.cos(lat)
    _, R_N = radii_of_curvature(lat, ellipsoid)
    across = (R_N + h) * c_lat
    return jnp.stack([across * jnp.cos(lon), across * jnp.sin(lon), (R_N * (1.0 - ellipsoid.e2) + h) * s_lat])


def geodetic_from_ecef(position_e: Vector3, ellipsoid: Ellipsoid = WGS84) -> tuple[Scalar, Scalar, Scalar]:
    """Return geodetic latitude and longitude (rad) and height above the ellipsoid (m) of a position (3,), ECEF, m.

    Latitude is in [-pi/2, pi/2], longitude in [-pi, pi]. On the polar axis the longitude is 0; the gradients across the
    axis, which do not exist, are set to 0. In double precision the error is about 4e-9 m from -10 km to geostationary
    height. Source: Bowring, Survey Review 23(181), 1976, applied twice; height: Survey Review 28(218), 1985.
    """
    x, y, z = position_e[0], position_e[1], position_e[2]
    a, b = ellipsoid.a, ellipsoid.b
    p = safe_hypot(x, y)
    # Each step takes the direction of the reduced latitude to the direction (north, out) of the geodetic latitude.
    north, out = _bowring_step(p, z, z * a, p * b, ellipsoid)
    north, out = _bowring_step(p, z, north * b, out * a, ellipsoid)
    length = safe_hypot(north, out)
    s_lat, c_lat = north / length, out / length
    h = p * c_lat + z * s_lat - a * jnp.sqrt(1.0 - ellipsoid.e2 * s_lat**2)
    return safe_atan2(north, out), safe_atan2(y, x), h


def _bowring_step(
    p: Scalar, z: Scalar, reduced_north: Scalar, reduced_out: Scalar, ellipsoid: Ellipsoid
) -> tuple[Scalar, Scalar]:
    length = safe_hypot(reduced_north, reduced_out)
    s_reduced, c_reduced = reduced_north / length, reduced_out / length
    return (
        z + ellipsoid.ep2 * ellipsoid.b * s_reduced**3,
        p - ellipsoid.e2 * ellipsoid.a * c_reduced**3,
    )


def geodetic_from_flat(
    position_n: Vector3,
    reference_latitude: ScalarLike,
    reference_longitude: ScalarLike,
    reference_height: ScalarLike,
    ellipsoid: Ellipsoid = WGS84,
) -> tuple[Scalar, Scalar, Scalar]:
    """Return geodetic latitude and longitude (rad) and height (m) of a position on the flat map of the Earth.

    The angles are continuous: longitude is not wrapped at +-pi, and latitude beyond a pole exceeds +-pi/2.

    Parameters
    ----------
    position_n
        Flat-Earth position (3,), NED from the reference, m.
    reference_latitude, reference_longitude, reference_height
        Geodetic coordinates of the flat Earth's origin: rad, rad, m above the ellipsoid; not a pole.
    ellipsoid
        Figure of the Earth.

    Notes
    -----
    In the map of theory section 1, an angle from the reference is the arctangent of length over radius, up to 45 deg.
    Farther away the angle grows linearly, with the slope at 45 deg, so that the map covers the whole Earth.
    """
    R_M, R_N = radii_of_curvature(reference_latitude, ellipsoid)
    north = angle_on_flat_map(position_n[0], R_M + reference_height)
    east = angle_on_flat_map(position_n[1], (R_N + reference_height) * jnp.cos(reference_latitude))
    return (
        jnp.asarray(reference_latitude) + north,
        jnp.asarray(reference_longitude) + east,
        jnp.asarray(reference_height) - position_n[2],
    )


recorded_geodetic_from_flat = jax.jit(jax.vmap(geodetic_from_flat, in_axes=(1, None, None, None)))
"""Compiled `geodetic_from_flat` for recorded flat-Earth positions, shape (3, samples)."""


def flat_from_geodetic(
    lat: ScalarLike,
    lon: ScalarLike,
    h: ScalarLike,
    reference_latitude: ScalarLike,
    reference_longitude: ScalarLike,
    reference_height: ScalarLike,
    ellipsoid: Ellipsoid = WGS84,
) -> Vector3:
    """Return the flat-Earth position (3,), NED from the reference, m: the exact inverse of `geodetic_from_flat`.

    Parameters
    ----------
    lat, lon, h
        Geodetic latitude and longitude, rad, and height above the ellipsoid, m. Multiples of 2 pi in the longitude have
        no effect. East is discontinuous only 180 deg from the reference's longitude.
    reference_latitude, reference_longitude, reference_height
        Geodetic coordinates of the flat Earth's origin: rad, rad, m above the ellipsoid; not a pole.
    ellipsoid
        Figure of the Earth.
    """
    R_M, R_N = radii_of_curvature(reference_latitude, ellipsoid)
    east_angle = jnp.asarray(lon) - reference_longitude
    east_angle = east_angle - 2.0 * jnp.pi * jnp.round(east_angle / (2.0 * jnp.pi))
    north = _length_of(jnp.asarray(lat) - reference_latitude, R_M + reference_height)
    east = _length_of(east_angle, (R_N + reference_height) * jnp.cos(reference_latitude))
    return jnp.stack([north, east, jnp.asarray(reference_height) - h])


def flat_map_scale(length: ScalarLike, radius: ScalarLike) -> Scalar:
    """Return the derivative of a length on the flat map by the arc length on the Earth, a number from 1 to 2.

    Arguments: `angle_on_flat_map`.
    """
    tangent = jnp.clip(length / radius, -1.0, 1.0)
    return 1.0 + tangent * tangent


def angle_on_flat_map(length: ScalarLike, radius: ScalarLike) -> Scalar:
    """Return the difference of latitude or longitude from the reference (rad) at a flat-map coordinate (m).

    `length` is the north or the east coordinate. With the radii of curvature at the reference and the reference height
    h, `radius` (m) is R_M + h for north, and (R_N + h) cos(latitude) for east.
    """
    arctangent_part = jnp.clip(length, -radius, radius)
    return jnp.arctan2(arctangent_part, radius) + 0.5 * (length - arctangent_part) / radius


def _length_of(angle: ScalarLike, radius: ScalarLike) -> Scalar:
    tangent_part = jnp.clip(angle, -0.25 * jnp.pi, 0.25 * jnp.pi)
    return radius * (jnp.tan(tangent_part) + 2.0 * (angle - tangent_part))
