"""The surroundings of a flight: wind fields, and the atmosphere, the wind and the Earth together."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.environment.atmosphere import AbstractAtmosphere, StandardAtmosphere
from anser.environment.earth import AbstractEarth, FlatEarth, somigliana
from anser.numerics.arrays import as_array
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.units import DEG_RAD


class AbstractWind(eqx.Module):
    """A wind field: the velocity of the air at a place and time."""

    @abc.abstractmethod
    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Velocity of the air (3,), NED, m/s, at a position (3,), NED, m, and time, s."""


class SteadyWind(AbstractWind):
    """The same wind everywhere and always.

    Attributes
    ----------
    velocity_n
        Velocity of the air (3,), NED, m/s: where the air moves to.
    """

    velocity_n: Vector3

    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Velocity of the air (3,), NED, m/s; position and time make no difference."""
        return self.velocity_n


class LayeredWind(AbstractWind):
    """Wind that changes with altitude, the same at all times and over the whole ground: a shear profile.

    Attributes
    ----------
    altitudes
        Geometric altitudes (layer,), m, rising.
    velocities_n
        Velocity of the air there (layer, 3), local NED, m/s; linear in between, and beyond the lowest and highest
        altitude that of the end.
    """

    altitudes: Float[Array, " layer"]
    velocities_n: Float[Array, "layer 3"]

    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Velocity of the air (3,), NED, m/s, at the altitude of a position; time makes no difference."""
        altitude = -position_n[2]
        return jnp.stack([jnp.interp(altitude, self.altitudes, self.velocities_n[:, k]) for k in range(3)])


class VaryingWind(AbstractWind):
    """Wind that changes with altitude and time, the same over the whole ground: soundings or forecasts in a row.

    Attributes
    ----------
    times
        (t,), s, rising.
    altitudes
        Geometric altitudes (layer,), m, rising.
    velocities_n
        Velocity of the air then and there (t, layer, 3), local NED, m/s; linear in between in both, and beyond the
        first and last time, the lowest and highest altitude that of the end.
    """

    times: Float[Array, " t"]
    altitudes: Float[Array, " layer"]
    velocities_n: Float[Array, "t layer 3"]

    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Velocity of the air (3,), NED, m/s, at a time, s, and at the altitude of a position."""
        layers_n = jnp.sum(linear_weights(jnp.asarray(time), self.times)[:, None, None] * self.velocities_n, axis=0)
        return jnp.sum(linear_weights(-position_n[2], self.altitudes)[:, None] * layers_n, axis=0)


def linear_weights(at: Scalar, breakpoints: Float[Array, " n"]) -> Float[Array, " n"]:
    """Weights of values at rising places: linear between two of them, that of the end beyond; one place has it all."""
    parts = jnp.clip((at - breakpoints[:-1]) / (breakpoints[1:] - breakpoints[:-1]), 0.0, 1.0)
    # each gap takes from the place below what it gives to the one above
    return jnp.concatenate([jnp.ones_like(breakpoints[:1]), parts]) - jnp.concatenate(
        [parts, jnp.zeros_like(breakpoints[:1])]
    )


def steady_wind_from_report(speed_m_s: ScalarLike, from_deg: ScalarLike, up_m_s: ScalarLike = 0.0) -> SteadyWind:
    """Steady wind in the terms of a weather report.

    Parameters
    ----------
    speed_m_s
        Horizontal speed, m/s.
    from_deg
        Direction that the wind comes from, degrees clockwise from true north: 270 is a west wind, which moves east.
    up_m_s
        Vertical speed, m/s, up positive.
    """
    bearing = jnp.asarray(from_deg) * DEG_RAD
    speed = jnp.asarray(speed_m_s)
    return SteadyWind(jnp.stack([-speed * jnp.cos(bearing), -speed * jnp.sin(bearing), -jnp.asarray(up_m_s)]))


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
