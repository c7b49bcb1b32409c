"""One point of a trim map: steady flight, what stops it, and how much is left to its limits."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from anser.aircraft import AbstractAirframe, condition
from anser.environment import Environment
from anser.shapes import Flag, Scalar, Vector, Vector3
from anser.simulation.trim import EXCESS_NOISE, TrimPoint, TrimTarget, solve_trim

TRIM_STOPS = ("tables", "no_balance", "thrust_max", "thrust_idle", "surfaces", "alpha", "beta")
"""What can stop steady flight: altitude or Mach number beyond the data; forces and moments that do not balance; power
above 100 or below 0 percent; a surface beyond its stop; alpha or beta beyond the data."""


class MapPoint(eqx.Module):
    """A point of a trim map.

    Attributes
    ----------
    trim
        The solution, flyable or not.
    stopped_by
        Which of `TRIM_STOPS` stand in the way; none where the point can be flown.
    mach
        Mach number.
    load_factor
        Minus body z force over weight.
    power_left, power_spare
        Up to 100 and down to 0 percent of power, as fractions.
    surface_left
        Part of the way from its stop to the middle at which each surface stands.
    """

    trim: TrimPoint
    stopped_by: Bool[Array, "7"]
    mach: Scalar
    load_factor: Scalar
    power_left: Scalar
    power_spare: Scalar
    surface_left: Vector

    @property
    def trimmable(self) -> Bool[Array, "..."]:
        """Whether nothing stands in the way; for a batch, of each point."""
        return ~jnp.any(self.stopped_by, axis=-1)


def map_point(airframe: AbstractAirframe, environment: Environment, target: TrimTarget) -> MapPoint:
    """Trim an aircraft and say what is left to its limits; see `solve_trim`."""
    point = solve_trim(airframe, environment, target)
    now = condition(airframe, environment, 0.0, point.state)
    data = now.air_data
    # the flow angles have their own entries
    inside = eqx.tree_at(
        lambda d: (d.alpha, d.beta),
        data,
        (jnp.clip(data.alpha, *airframe.alpha_range), jnp.clip(data.beta, *airframe.beta_range)),
    )
    power, surfaces = point.power / 100, point.state.surfaces
    actuators = airframe.actuators

    def beyond(value: Scalar | Vector3, lower: Scalar | Vector3, upper: Scalar | Vector3) -> Flag:
        return jnp.any((value < lower - EXCESS_NOISE) | (value > upper + EXCESS_NOISE))

    stops = [
        power > 1 + EXCESS_NOISE,
        power < -EXCESS_NOISE,
        beyond(surfaces, actuators.lower, actuators.upper),
        beyond(point.alpha, *airframe.alpha_range),
        beyond(point.beta, *airframe.beta_range),
    ]
    # what is no solution says nothing of power, surfaces and angles
    stops = [airframe.outside_tables(inside), ~point.converged, *(stop & point.converged for stop in stops)]
    return MapPoint(
        trim=point,
        stopped_by=jnp.stack(stops),
        mach=data.mach,
        load_factor=-now.wrench.force_b[2] / (airframe.mass_properties.mass * environment.gravity),
        power_left=1 - power,
        power_spare=power,
        surface_left=1 - surface_share(airframe, surfaces),
    )


def surface_share(airframe: AbstractAirframe, surfaces: Vector) -> Vector:
    """Part of the way from the middle to the stop at which each surface (rad) stands."""
    lower, upper = airframe.actuators.lower, airframe.actuators.upper
    return jnp.abs(2 * surfaces - lower - upper) / (upper - lower)
