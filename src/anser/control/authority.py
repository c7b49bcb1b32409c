"""Authority: how fast what the loops control can be changed, by what the surfaces can still give."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import AbstractActuators, MassProperties
from anser.control.allocation import SurfaceMoments, deflection_for_moment
from anser.numerics import inverse3, product3
from anser.shapes import Matrix33, Vector, Vector3

_SHARE = 0.3
"""Part of the authority that an error or a command may ask for; the rest is left for the other axes and disturbance."""
_MARGIN_MIN = 0.1
"""Part of the half range of a surface; what is left to its stop is not counted less, so that the loops stay alive."""


class Authority(eqx.Module):
    """What the surfaces can give.

    Attributes
    ----------
    deflection
        Deflection per angular acceleration (surfaces, 3), rad/(rad/s^2): the inverted control effectiveness.
    margin
        Deflection left to the nearer stop (surfaces,), rad.
    rate_limit
        Of the surfaces (surfaces,), rad/s.
    """

    deflection: Float[Array, "n 3"]
    margin: Vector
    rate_limit: Vector

    @property
    def rates_jerk(self) -> Vector3:
        """Rate at which the accelerations of (P, Q, R) may change, each by itself, rad/s^3."""
        return _SHARE * _each_alone(self.deflection, self.rate_limit)

    def attitude_acceleration(self, effectiveness: Matrix33) -> Vector3:
        """Acceleration of (mu, alpha, beta), each by itself, rad/s^2.

        `effectiveness` is G in (mu_dot, alpha_dot, beta_dot) = drift + G (P, Q, R).
        """
        return _SHARE * _each_alone(product3(self.deflection, inverse3(effectiveness)), self.margin)


def surface_authority(
    actuators: AbstractActuators, mass_properties: MassProperties, moments: SurfaceMoments, surfaces_slow: Vector
) -> Authority:
    """Authority with the present control effectiveness about slow deflections (surfaces,), rad."""
    half = 0.5 * (actuators.upper - actuators.lower)
    left = jnp.minimum(surfaces_slow - actuators.lower, actuators.upper - surfaces_slow)
    return Authority(
        deflection=product3(deflection_for_moment(actuators, moments.slope), mass_properties.inertia_b),
        margin=jnp.maximum(left, _MARGIN_MIN * half),
        rate_limit=actuators.rate_limit,
    )


def _each_alone(deflection: Float[Array, "n 3"], limit: Vector) -> Vector3:
    """Greatest amount of each output whose surfaces, deflection @ output, stay within the limit."""
    return 1.0 / jnp.max(jnp.abs(deflection) / limit[:, None], axis=0)
