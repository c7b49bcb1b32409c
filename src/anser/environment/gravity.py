"""Gravity on the ellipsoid, and gravitation around it."""

import jax.numpy as jnp

from anser.constants import SOMIGLIANA_EQUATOR_M_S2, SOMIGLIANA_K
from anser.numerics import as_array, namespace
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial import WGS84


def somigliana(latitude: ScalarLike) -> Scalar:
    """Gravity on the WGS-84 ellipsoid, m/s^2, at a geodetic latitude in rad.

    Normal gravity: gravitation and centrifugal acceleration together, down. Source: theory section 1, [WGS84].
    """
    xp = namespace(latitude)
    s2 = xp.sin(latitude) ** 2
    return as_array(SOMIGLIANA_EQUATOR_M_S2 * (1.0 + SOMIGLIANA_K * s2) / xp.sqrt(1.0 - WGS84.e2 * s2))


def gravitation_j2(
    position_e: Vector3, gravitational_parameter: ScalarLike, oblateness_j2: ScalarLike, equatorial_radius: ScalarLike
) -> Vector3:
    """Gravitation of an oblate Earth, without the centrifugal acceleration of its rotation.

    Parameters
    ----------
    position_e
        Position (3,), ECEF, m; not the centre.
    gravitational_parameter
        GM, m^3/s^2.
    oblateness_j2, equatorial_radius
        J2 and the radius in m that it refers to; with J2 = 0 the Earth attracts as a point does.

    Returns
    -------
    (3,), ECEF axes, m/s^2. Source: [SL] eq. 1.6-14; [NESC].
    """
    r2 = jnp.sum(position_e * position_e)
    strength = gravitational_parameter / (r2 * jnp.sqrt(r2))
    bulge = 1.5 * oblateness_j2 * equatorial_radius * equatorial_radius / r2
    z2 = position_e[2] * position_e[2] / r2
    across, along = 1.0 + bulge * (1.0 - 5.0 * z2), 1.0 + bulge * (3.0 - 5.0 * z2)
    return -strength * position_e * jnp.stack([across, across, along])
