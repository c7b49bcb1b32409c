"""Quantities that the parts of an aircraft exchange: air data, force and moment, disturbances, and valid ranges."""

import math

import equinox as eqx
import jax.numpy as jnp

from anser.environment.atmosphere import Air
from anser.environment.gusts import Gust
from anser.numerics.arrays import as_array
from anser.shapes import Flag, Scalar, ScalarLike, Vector3
from anser.spatial.wind_axes import flow_angles


class Wrench(eqx.Module):
    """A force (N) and a moment about the centre of gravity (N m), both in body axes."""

    force_b: Vector3
    moment_b: Vector3

    def __add__(self, addend: "Wrench") -> "Wrench":
        return Wrench(self.force_b + addend.force_b, self.moment_b + addend.moment_b)


class AirData(eqx.Module):
    """Air data of one aircraft (theory section 2)."""

    V: Scalar  #: True airspeed, m/s.
    alpha: Scalar  #: Angle of attack, rad.
    beta: Scalar  #: Sideslip angle, rad.
    density: Scalar  #: Air density, kg/m^3.
    qbar: Scalar  #: Dynamic pressure, Pa.
    mach: Scalar  #: Mach number.
    altitude: Scalar  #: Geometric altitude, m.


def air_data(velocity_air_b: Vector3, altitude: ScalarLike, air: Air) -> AirData:
    """Compute the air data from the air-relative velocity in body axes (m/s), the altitude (m) and the local air."""
    V, alpha, beta = flow_angles(velocity_air_b)
    return AirData(
        V=V,
        alpha=alpha,
        beta=beta,
        density=air.density,
        qbar=0.5 * air.density * V * V,
        mach=V / air.speed_of_sound,
        altitude=altitude + 0.0 * V,
    )


class Validity(eqx.Module):
    """Ranges (minimum, maximum) in which an airframe's data are valid; an unlimited range has infinite ends."""

    airspeed: tuple[Scalar, Scalar]  #: True airspeed, m/s.
    altitude: tuple[Scalar, Scalar]  #: Geometric altitude, m.
    mach: tuple[Scalar, Scalar]  #: Mach number.

    def excludes(self, air_data: AirData) -> Flag:
        """Whether airspeed, altitude or Mach number of the air data is outside its valid range."""
        return (
            is_outside(air_data.V, self.airspeed)
            | is_outside(air_data.altitude, self.altitude)
            | is_outside(air_data.mach, self.mach)
        )


def unlimited_validity() -> Validity:
    """Return a `Validity` without limits: all ranges are from minus to plus infinity."""
    limits = as_array(-math.inf), as_array(math.inf)
    return Validity(limits, limits, limits)


def is_outside(value: ScalarLike, limits: tuple[ScalarLike, ScalarLike]) -> Flag:
    """Whether a value is below the lower or above the upper of two limits."""
    return jnp.logical_or(value < limits[0], value > limits[1])


class Disturbance(eqx.Module):
    """Gust at one aircraft and factor on its thrust (1: no loss, 0: no thrust), constant over a sampling period."""

    gust: Gust
    thrust: Scalar


def no_disturbance() -> Disturbance:
    """Return a disturbance without gust and with a factor of 1 on the thrust."""
    return Disturbance(Gust(as_array([0.0] * 3), as_array([0.0] * 3)), as_array(1.0))
