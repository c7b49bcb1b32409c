"""What surrounds an aircraft: air, wind and gravity together."""

import equinox as eqx
import jax.numpy as jnp

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.environment.atmosphere import AbstractAtmosphere, StandardAtmosphere
from anser.environment.gravity import somigliana
from anser.environment.wind import AbstractWind, SteadyWind
from anser.shapes import Scalar, ScalarLike, Vector3


class Environment(eqx.Module):
    """Surroundings of a flight over a flat Earth.

    Attributes
    ----------
    atmosphere
        The air by altitude.
    wind
        The motion of the air.
    gravity
        Acceleration of gravity, m/s^2, down; one value for the whole flight.
    """

    atmosphere: AbstractAtmosphere
    wind: AbstractWind
    gravity: Scalar


def standard_environment(latitude: ScalarLike | None = None, wind_n: Vector3 | None = None) -> Environment:
    """Put together the standard atmosphere, a steady wind and constant gravity.

    Parameters
    ----------
    latitude
        Geodetic latitude, rad, whose normal gravity acts (`somigliana`). Without one it is standard gravity, 9.80665
        m/s^2, the value in the atmosphere's own hydrostatic law.
    wind_n
        Velocity of the air (3,), NED, m/s; still air without one.
    """
    return Environment(
        atmosphere=StandardAtmosphere(),
        wind=SteadyWind(jnp.zeros(3) if wind_n is None else wind_n),
        gravity=jnp.asarray(STANDARD_GRAVITY_M_S2) if latitude is None else somigliana(latitude),
    )
