"""Environment of a flight: wind fields, and atmosphere, wind and Earth combined."""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.environment.atmosphere import AbstractAtmosphere, StandardAtmosphere
from anser.environment.earth import AbstractEarth, FlatEarth, somigliana
from anser.numerics.arrays import as_array
from anser.shapes import Scalar, ScalarLike, Vector3


class AbstractWind(eqx.Module):
    """Interface of a wind field: velocity of the air as a function of position and time."""

    @abc.abstractmethod
    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Return the velocity of the air (3,), NED, m/s, at a chart position (3,), NED, m, and a time (s)."""


class SteadyWind(AbstractWind):
    """A uniform, constant wind."""

    velocity_n: Vector3  #: Velocity of the air over the ground, NED, m/s.

    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Return the velocity of the air (3,), NED, m/s; position and time have no effect."""
        return self.velocity_n


class LayeredWind(AbstractWind):
    """Wind profile, linear over altitude, constant in time and horizontally uniform.

    The wind is constant below the first and above the last altitude.
    """

    altitudes: Float[Array, " layer"]  #: Rising geometric altitudes above sea level, m.
    velocities_n: Float[Array, "layer 3"]  #: Velocities of the air, NED, m/s.

    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Return the velocity of the air (3,), NED, m/s, at the altitude of a position; the time has no effect."""
        return jnp.sum(linear_weights(-position_n[2], self.altitudes)[:, None] * self.velocities_n, axis=0)


def linear_weights(at: ScalarLike, breakpoints: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the weight of each breakpoint, 0 to 1, in a linear interpolation at the value `at`.

    The breakpoints must rise. Beyond the breakpoints, the nearest breakpoint has weight 1. At a breakpoint the
    derivative is the derivative in the interval above.
    """
    lower, upper = breakpoints[:-1], breakpoints[1:]
    parts = jnp.where(at >= upper, 1.0, jnp.where(at < lower, 0.0, (at - lower) / (upper - lower)))
    # in each interval the weights of the lower and the upper breakpoint sum to 1
    return jnp.concatenate([jnp.ones_like(breakpoints[:1]), parts]) - jnp.concatenate(
        [parts, jnp.zeros_like(breakpoints[:1])]
    )


class Environment(eqx.Module):
    """Environment of a flight: air over altitude, wind, and the Earth with the chart in which positions are given."""

    atmosphere: AbstractAtmosphere
    wind: AbstractWind
    earth: AbstractEarth

    @property
    def gravity(self) -> Scalar:
        """Effective gravity at the chart's origin, m/s^2; planning uses this value at all positions."""
        return self.earth.gravity_at_origin


def standard_environment(
    latitude: ScalarLike | None = None, wind_n: Vector3 | None = None, earth: AbstractEarth | None = None
) -> Environment:
    """Build an environment of the standard atmosphere, a steady wind (NED, m/s; None: no wind) and an Earth.

    If `earth` is None, the Earth is flat. The gravity is then `somigliana` at the geodetic `latitude` (rad); `latitude`
    None: 9.80665 m/s^2. If an `earth` is given, `latitude` has no effect.
    """
    gravity = as_array(STANDARD_GRAVITY_M_S2) if latitude is None else somigliana(latitude)
    return Environment(
        atmosphere=StandardAtmosphere(),
        wind=SteadyWind(as_array(np.zeros(3)) if wind_n is None else wind_n),
        earth=FlatEarth(gravity) if earth is None else earth,
    )
