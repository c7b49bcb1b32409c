"""Control allocation: surface deflections for a commanded moment.

And the control authority that is left to the loops.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.airframe import AbstractAirframe, MassProperties
from anser.aircraft.motion import FlightCondition
from anser.numerics.arrays import select_if_any
from anser.numerics.linear import inverse3, product3, solve3
from anser.shapes import Matrix33, Vector, Vector3

# Moments are piecewise linear in the elevator: exact within a piece and nearly always across one breakpoint; what is
# left of a jump over two is taken up at the next sample, long before the surface has moved that far.
_NEWTON_STEPS = 2
_SLACK_RAD = 0.2  # how far beyond the stops a Newton iterate may go
_AXES = 3
_PRIORITY = np.array([0.1, 0.01, 1.0])  # what is missing in roll, pitch, yaw costs 1 over this: pitch is kept first
_SHARE = 1e-6  # of the square of the greatest moment: moments that are this small beside it are not asked for


class SurfaceMoments(eqx.Module):
    """Aerodynamic moment about deflections of the surfaces.

    Attributes
    ----------
    surfaces
        Deflections (surfaces,), rad.
    moment_b
        With these deflections (3,), N m.
    slope
        Of the moment with respect to the deflections (3, surfaces), N m/rad: the control effectiveness; 0 for surfaces
        that no controller commands.
    """

    surfaces: Vector
    moment_b: Vector3
    slope: Float[Array, "3 n"]


class SurfaceDemand(eqx.Module):
    """Wanted surfaces (rad) and which of them were wanted beyond a stop."""

    surfaces: Vector
    saturated: Bool[Array, " n"]


def surface_moments(
    airframe: AbstractAirframe, now: FlightCondition, rates_b: Vector3, surfaces: Vector
) -> SurfaceMoments:
    """Differentiate the airframe's aerodynamic moments with respect to the surfaces."""

    def moment_of(deflection: Vector) -> Vector3:
        return airframe.aerodynamics(now.air_data, rates_b, deflection).moment_b

    moment_b, slope_of = jax.linearize(moment_of, surfaces)
    unit = np.eye(surfaces.shape[0])[_commanded(airframe.actuators)]
    slope = jax.vmap(slope_of, out_axes=1)(jnp.asarray(unit, dtype=surfaces.dtype))
    return SurfaceMoments(surfaces, moment_b, _among_all(airframe.actuators, slope.T).T)


def has_one_surface_per_axis(actuators: AbstractActuators) -> bool:
    """Whether three surfaces are commanded, which together turn the aircraft about any axis."""
    return sum(actuators.is_commanded) == _AXES and actuators.controls_yaw


def _commanded(actuators: AbstractActuators) -> np.ndarray:
    return np.flatnonzero(actuators.is_commanded)


def _among_all(actuators: AbstractActuators, rows: Float[Array, "commanded m"]) -> Float[Array, "n m"]:
    """Rows of the commanded surfaces at their places, 0 for the others."""
    if all(actuators.is_commanded):
        return rows
    return jnp.zeros((len(actuators.names), rows.shape[1]), rows.dtype).at[_commanded(actuators)].set(rows)


def deflection_for_moment(actuators: AbstractActuators, slope: Float[Array, "3 n"]) -> Float[Array, "n 3"]:
    """Change of the surfaces per moment, rad/(N m): the least change that gives it, by shares of each surface's range.

    With one surface for each axis the inverse of the slope. With more, the right inverse W S' (S W S')^-1 weighted by
    the squares of the half ranges W; with fewer, or where surfaces do the same, what cannot be had is left out, yaw
    first and pitch last (weighted least squares: O. Harkegard, "Efficient active set algorithms for solving constrained
    least squares problems in aircraft control allocation", 2002, with the weights in closed form).
    """
    if has_one_surface_per_axis(actuators):
        return _among_all(actuators, inverse3(slope[:, _commanded(actuators)]))
    return _least_change(actuators, slope, jnp.asarray(actuators.is_commanded, dtype=slope.dtype))


def allocate(
    airframe: AbstractAirframe, now: FlightCondition, rates_b: Vector3, present: SurfaceMoments, moment_b: Vector3
) -> SurfaceDemand:
    """Surfaces within their stops whose moment is `moment_b` (N m), by Newton steps from the present deflections.

    The control effectiveness is the derivative of the airframe's aerodynamic moments with respect to the surfaces, at
    each iterate (theory section 5, item 1: Cm0 is not linear in the elevator, so no constant slope is assumed). Where a
    surface is wanted beyond its stop it is held there, and the others give what is missing as far as they can: pitch
    before roll before yaw. With one surface for each axis there is none to take over.
    """
    wanted_b = moment_b - now.propulsive.moment_b
    actuators = airframe.actuators
    lower, upper = actuators.lower, actuators.upper
    at, solution = present, present.surfaces
    for k in range(_NEWTON_STEPS):
        if k:
            at = surface_moments(airframe, now, rates_b, solution)
        missing_b = wanted_b - at.moment_b
        if has_one_surface_per_axis(actuators):
            change = solve3(at.slope[:, _commanded(actuators)], missing_b)
            solution = at.surfaces + _among_all(actuators, change[:, None])[:, 0]
        else:
            base = _neutral(actuators, at.surfaces)
            missing_b = missing_b + _product(at.slope, at.surfaces - base)
            solution = base + _product(deflection_for_moment(actuators, at.slope), missing_b)
        solution = jnp.clip(solution, lower - _SLACK_RAD, upper + _SLACK_RAD)
    saturated = (solution < lower) | (solution > upper)
    if has_one_surface_per_axis(actuators):
        # Solving for the others again made the rudder swing to its stop in hard rolls: docs/theory/autopilot.md.
        return SurfaceDemand(surfaces=actuators.limit_command(solution), saturated=saturated)
    within = select_if_any(jnp.any(saturated), lambda: _reallocated(actuators, at, wanted_b, solution), solution)
    return SurfaceDemand(surfaces=within, saturated=saturated)


def _product(matrix: Float[Array, "m k"], vector: Float[Array, " k"]) -> Float[Array, " m"]:
    return jnp.sum(matrix * vector[None, :], axis=1)


def _neutral(actuators: AbstractActuators, surfaces: Vector) -> Vector:
    """Where commanded surfaces stand when nothing is asked of them; the others stay."""
    rest = actuators.limit_command(jnp.zeros_like(surfaces))
    return jnp.where(jnp.asarray(actuators.is_commanded), rest, surfaces)


def _least_change(
    actuators: AbstractActuators, slope: Float[Array, "3 n"], free: Float[Array, " n"]
) -> Float[Array, "n 3"]:
    """Of the free surfaces (1; 0: held), W S' (S W S' + E)^-1; E weighs what cannot be had."""
    half = 0.5 * (actuators.upper - actuators.lower)
    weight = free * half**2
    weighted = slope * weight[None, :]
    gram = jnp.sum(weighted[:, None, :] * slope[None, :, :], axis=2)
    most = jnp.max(jnp.sum((slope * half[None, :]) ** 2, axis=1))
    inverse = inverse3(gram + jnp.diag(_SHARE * most * _PRIORITY.astype(most.dtype)))
    return jnp.sum(weighted[:, :, None] * inverse[:, None, :], axis=0)


def _reallocated(actuators: AbstractActuators, at: SurfaceMoments, wanted_b: Vector3, solution: Vector) -> Vector:
    """Surfaces beyond their stops held there, one round after another, the others by least squares; all within."""
    lower, upper = actuators.lower, actuators.upper
    commanded = jnp.asarray(actuators.is_commanded)
    held = ~commanded | (solution < lower) | (solution > upper)
    found = jnp.clip(solution, lower, upper)
    for _ in range(sum(actuators.is_commanded) - 1):
        base = jnp.where(held, found, _neutral(actuators, at.surfaces))
        missing_b = wanted_b - at.moment_b - _product(at.slope, base - at.surfaces)
        solution = base + _product(_least_change(actuators, at.slope, jnp.where(held, 0.0, 1.0)), missing_b)
        beyond = (solution < lower) | (solution > upper)
        found = jnp.clip(solution, lower, upper)
        held = held | beyond
    return found


_AUTHORITY_SHARE = 0.3
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
        return _AUTHORITY_SHARE * _each_alone(self.deflection, self.rate_limit)

    def attitude_acceleration(self, effectiveness: Matrix33) -> Vector3:
        """Acceleration of (mu, alpha, beta), each by itself, rad/s^2.

        `effectiveness` is G in (mu_dot, alpha_dot, beta_dot) = drift + G (P, Q, R).
        """
        return _AUTHORITY_SHARE * _each_alone(product3(self.deflection, inverse3(effectiveness)), self.margin)


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
