"""Gravity on the ellipsoid."""

import jax.numpy as jnp

from anser.constants import SOMIGLIANA_EQUATOR_M_S2, SOMIGLIANA_K, WGS84_E2
from anser.shapes import Scalar, ScalarLike


def somigliana(latitude: ScalarLike) -> Scalar:
    """Gravity on the WGS-84 ellipsoid, m/s^2, at a geodetic latitude in rad.

    Normal gravity: gravitation and centrifugal acceleration together, down. Source: theory section 1, [WGS84].
    """
    s2 = jnp.sin(latitude) ** 2
    return SOMIGLIANA_EQUATOR_M_S2 * (1.0 + SOMIGLIANA_K * s2) / jnp.sqrt(1.0 - WGS84_E2 * s2)
