"""What surrounds an aircraft: air, wind and the Earth together."""

import equinox as eqx
import jax.numpy as jnp

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.environment.atmosphere import AbstractAtmosphere, StandardAtmosphere
from anser.environment.earth import AbstractEarth, FlatEarth
from anser.environment.gravity import somigliana
from anser.environment.wind import AbstractWind, SteadyWind
from anser.numerics import as_array
from anser.shapes import Scalar, ScalarLike, Vector3


class Environment(eqx.Module):
    """Surroundings of a flight.

    Attributes
    ----------
    atmosphere
        The air by altitude.
    wind
        The motion of the air.
    earth
        The Earth, flat or round, with the chart on it that places refer to.
    """

    atmosphere: AbstractAtmosphere
    wind: AbstractWind
    earth: AbstractEarth

    @property
    def gravity(self) -> Scalar:
        """Effective gravity at the chart's origin, m/s^2: the one value that planning and scaling reckon with."""
        return self.earth.gravity_at_origin


def standard_environment(
    latitude: ScalarLike | None = None, wind_n: Vector3 | None = None, earth: AbstractEarth | None = None
) -> Environment:
    """Put together the standard atmosphere, a steady wind and an Earth, flat unless another is given.

    Parameters
    ----------
    latitude
        Geodetic latitude, rad, whose normal gravity acts on the flat Earth (`somigliana`). Without one it is standard
        gravity, 9.80665 m/s^2, the value in the atmosphere's own hydrostatic law.
    wind_n
        Velocity of the air (3,), NED, m/s; still air without one.
    earth
        Another Earth; `latitude` then counts for nothing.
    """
    gravity = as_array(STANDARD_GRAVITY_M_S2) if latitude is None else somigliana(latitude)
    return Environment(
        atmosphere=StandardAtmosphere(),
        wind=SteadyWind(jnp.zeros(3) if wind_n is None else wind_n),
        earth=FlatEarth(gravity) if earth is None else earth,
    )
