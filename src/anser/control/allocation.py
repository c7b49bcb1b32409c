"""Allocation: surfaces that give a wanted moment, through the airframe's own differentiated moments."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, Condition
from anser.numerics import solve3
from anser.shapes import Matrix33, Vector3

# Moments are piecewise linear in the elevator: exact within a piece and nearly always across one breakpoint; what is
# left of a jump over two is taken up at the next sample, long before the surface has moved that far.
_NEWTON_STEPS = 2
_SLACK_RAD = 0.2  # how far beyond the stops a Newton iterate may go


class SurfaceMoments(eqx.Module):
    """Aerodynamic moment about deflections of the surfaces.

    Attributes
    ----------
    surfaces
        Elevator, aileron, rudder (3,), rad.
    moment_b
        With these deflections (3,), N m.
    slope
        Of the moment with respect to the deflections, 3x3, N m/rad: the control effectiveness.
    """

    surfaces: Vector3
    moment_b: Vector3
    slope: Matrix33


class SurfaceDemand(eqx.Module):
    """Wanted surfaces (elevator, aileron, rudder; rad, not yet limited) and which of them stand at a stop."""

    surfaces: Vector3
    saturated: Vector3


def surface_moments(airframe: AbstractAirframe, now: Condition, rates_b: Vector3, surfaces: Vector3) -> SurfaceMoments:
    """Differentiate the airframe's aerodynamic moments with respect to the surfaces."""

    def moment_of(deflection: Vector3) -> Vector3:
        return airframe.aerodynamics(now.air_data, rates_b, deflection).moment_b

    moment_b, slope_of = jax.linearize(moment_of, surfaces)
    return SurfaceMoments(surfaces, moment_b, jax.vmap(slope_of, out_axes=1)(jnp.eye(3)))


def allocate(
    airframe: AbstractAirframe, now: Condition, rates_b: Vector3, present: SurfaceMoments, moment_b: Vector3
) -> SurfaceDemand:
    """Surfaces whose moment is `moment_b` (N m), by Newton steps from the present deflections.

    The 3x3 control effectiveness is the derivative of the airframe's aerodynamic moments with respect to the surfaces,
    at each iterate (theory section 5, item 1: Cm0 is not linear in the elevator, so no constant slope is assumed).
    """
    wanted_b = moment_b - now.propulsive.moment_b
    lower, upper = airframe.actuators.lower, airframe.actuators.upper
    at = present
    for k in range(_NEWTON_STEPS):
        if k:
            at = surface_moments(airframe, now, rates_b, at.surfaces)
        solution = at.surfaces + solve3(at.slope, wanted_b - at.moment_b)
        solution = jnp.clip(solution, lower - _SLACK_RAD, upper + _SLACK_RAD)
        at = eqx.tree_at(lambda m: m.surfaces, at, solution)
    return SurfaceDemand(surfaces=at.surfaces, saturated=(at.surfaces < lower) | (at.surfaces > upper))
