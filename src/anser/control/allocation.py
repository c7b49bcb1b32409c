"""Control allocation: surface deflections for a commanded moment, and the control authority available to the loops."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.airframe import AbstractAirframe, MassProperties
from anser.aircraft.motion import AirDataAndForces
from anser.numerics.arrays import select_if_any
from anser.numerics.linear import inverse3, product3, solve3
from anser.shapes import Matrix33, Vector, Vector3

# Moments are piecewise linear in the elevator: two steps are exact within a piece and nearly always across one
# breakpoint. The error after two breakpoints is corrected at the next sample, before the surface has moved that far.
_NEWTON_STEPS = 2
_SLACK_RAD = 0.2  # largest excess of a Newton iterate over the stops
_AXES = 3
_AXIS_PENALTY = np.array([0.1, 0.01, 1.0])  # roll, pitch, yaw: a missing moment costs 1 / penalty, pitch most
_REGULARIZATION = 1e-6  # relative to the square of the greatest moment


class SurfaceMoments(eqx.Module):
    """Aerodynamic moment, linearized about the surface deflections `surfaces` (n,), rad.

    `moment_b` is the moment about the centre of gravity at these deflections, body axes, N m. `effectiveness` (3, n) is
    the control effectiveness: derivatives of the moment by the deflections, N m/rad; 0 for surfaces that no controller
    commands.
    """

    surfaces: Vector  # deflections (surfaces,), rad
    moment_b: Vector3  # aerodynamic moment about the centre of gravity at `surfaces`, body axes (3,), N m
    # control effectiveness, the derivative of the moment by the deflections (3, surfaces), N m/rad; 0 for surfaces that
    # no controller commands
    effectiveness: Float[Array, "3 n"]


class SurfaceDemand(eqx.Module):
    """Surface deflections or actuator commands, `surfaces` (n,), rad, within the stops.

    `saturated` (n,) marks the surfaces for which the moment would need a deflection beyond a stop.
    """

    surfaces: Vector
    saturated: Bool[Array, " n"]


def surface_moments(
    airframe: AbstractAirframe, condition: AirDataAndForces, rates_b: Vector3, surfaces: Vector
) -> SurfaceMoments:
    """Compute the aerodynamic moment (N m) and the control effectiveness (N m/rad) at the deflections `surfaces` (rad).

    The effectiveness is the derivative of the moment with respect to the deflections of the commanded surfaces, and 0
    for surfaces that follow a schedule.
    """

    def moment_of(deflections: Vector) -> Vector3:
        return airframe.aerodynamics(condition.air_data, rates_b, deflections).moment_b

    moment_b, moment_change = jax.linearize(moment_of, surfaces)
    unit = np.eye(surfaces.shape[0])[_commanded_indices(airframe.actuators)]
    effectiveness = jax.vmap(moment_change, out_axes=1)(jnp.asarray(unit, dtype=surfaces.dtype))
    return SurfaceMoments(surfaces, moment_b, _scatter_to_surfaces(airframe.actuators, effectiveness.T).T)


def has_one_surface_per_axis(actuators: AbstractActuators) -> bool:
    """Whether exactly three surfaces are commanded, and together control roll, pitch and yaw."""
    return sum(actuators.is_commanded) == _AXES and actuators.controls_yaw


def _commanded_indices(actuators: AbstractActuators) -> np.ndarray:
    return np.flatnonzero(actuators.is_commanded)


def _scatter_to_surfaces(actuators: AbstractActuators, block: Float[Array, "commanded m"]) -> Float[Array, "n m"]:
    """Place the rows of the commanded surfaces in an array with a row for every surface; the other rows are 0."""
    if all(actuators.is_commanded):
        return block
    return jnp.zeros((len(actuators.names), block.shape[1]), block.dtype).at[_commanded_indices(actuators)].set(block)


def deflection_for_moment(actuators: AbstractActuators, effectiveness: Float[Array, "3 n"]) -> Float[Array, "n 3"]:
    """Return the deflections per unit moment about each body axis, rad/(N m), shape (surfaces, 3).

    With one surface per axis, the result is the inverse of the effectiveness S. With more surfaces, it is the right
    inverse W S' (S W S')^-1 with the diagonal W of the squared half ranges between the stops: the deflections are the
    smallest as fractions of the ranges. With fewer surfaces than axes, or a rank-deficient S, the unattainable part of
    the moment is dropped, yaw first and pitch last (weighted least squares: O. Harkegard, "Efficient active set
    algorithms for solving constrained least squares problems in aircraft control allocation", 2002, with the weights in
    closed form).
    """
    if has_one_surface_per_axis(actuators):
        return _scatter_to_surfaces(actuators, inverse3(effectiveness[:, _commanded_indices(actuators)]))
    return _weighted_inverse(actuators, effectiveness, jnp.asarray(actuators.is_commanded, dtype=effectiveness.dtype))


def allocate(
    airframe: AbstractAirframe,
    condition: AirDataAndForces,
    rates_b: Vector3,
    present: SurfaceMoments,
    moment_b: Vector3,
) -> SurfaceDemand:
    """Solve for the deflections within the stops at which aerodynamics and propulsion give the moment `moment_b` (N m).

    The moment is the total about the centre of gravity, body axes. Two Newton steps start from `present`, the
    aerodynamic moment and its derivatives at the present deflections; the second step evaluates moment and control
    effectiveness at the result of the first (theory section 5, item 1: Cm0 is not linear in the elevator). Surfaces
    that follow a schedule keep their present deflections.

    With more or fewer than one surface per axis, a surface whose solution is beyond a stop is fixed at the stop, and
    the remaining surfaces give as much of the missing moment as possible, pitch before roll before yaw. With one
    surface per axis, no surface can compensate. The flags of the result mark the surfaces whose solution was beyond a
    stop before the redistribution.
    """
    target_b = moment_b - condition.propulsive.moment_b
    actuators = airframe.actuators
    lower, upper = actuators.lower, actuators.upper
    moments, solution = present, present.surfaces
    for k in range(_NEWTON_STEPS):
        if k:
            moments = surface_moments(airframe, condition, rates_b, solution)
        missing_b = target_b - moments.moment_b
        if has_one_surface_per_axis(actuators):
            change = solve3(moments.effectiveness[:, _commanded_indices(actuators)], missing_b)
            solution = moments.surfaces + _scatter_to_surfaces(actuators, change[:, None])[:, 0]
        else:
            base = _neutral_surfaces(actuators, moments.surfaces)
            missing_b = missing_b + _multiply(moments.effectiveness, moments.surfaces - base)
            solution = base + _multiply(deflection_for_moment(actuators, moments.effectiveness), missing_b)
        solution = jnp.clip(solution, lower - _SLACK_RAD, upper + _SLACK_RAD)
    saturated = (solution < lower) | (solution > upper)
    if has_one_surface_per_axis(actuators):
        # Solving again for the free surfaces drove the rudder to its stop in hard rolls: docs/theory/autopilot.md.
        return SurfaceDemand(surfaces=actuators.limit_command(solution), saturated=saturated)
    surfaces = select_if_any(
        jnp.any(saturated), lambda: _redistribute(actuators, moments, target_b, solution), solution
    )
    return SurfaceDemand(surfaces=surfaces, saturated=saturated)


def _multiply(matrix: Float[Array, "m k"], vector: Float[Array, " k"]) -> Float[Array, " m"]:
    return jnp.sum(matrix * vector[None, :], axis=1)


def _neutral_surfaces(actuators: AbstractActuators, surfaces: Vector) -> Vector:
    """Return the deflections (rad) from which the allocation starts.

    A commanded surface is at 0, or at the stop nearest to 0 if 0 is beyond a stop; a surface that follows a schedule
    keeps its present deflection in `surfaces`.
    """
    neutral = actuators.limit_command(jnp.zeros_like(surfaces))
    return jnp.where(jnp.asarray(actuators.is_commanded), neutral, surfaces)


def _weighted_inverse(
    actuators: AbstractActuators, effectiveness: Float[Array, "3 n"], is_free: Float[Array, " n"]
) -> Float[Array, "n 3"]:
    """Return the weighted pseudo-inverse W S' (S W S' + E)^-1 of the effectiveness S, rad/(N m), shape (surfaces, 3).

    `is_free` is 1 for a free and 0 for a fixed surface. The diagonal W holds the squares of the half ranges of the free
    surfaces, and 0 for fixed surfaces. The small diagonal E sets the order in which unattainable axes are given up:
    yaw, roll, pitch.
    """
    half = 0.5 * (actuators.upper - actuators.lower)
    weight = is_free * half**2
    weighted = effectiveness * weight[None, :]
    gram = jnp.sum(weighted[:, None, :] * effectiveness[None, :, :], axis=2)
    square_max = jnp.max(jnp.sum((effectiveness * half[None, :]) ** 2, axis=1))
    inverse = inverse3(gram + jnp.diag(_REGULARIZATION * square_max * _AXIS_PENALTY.astype(square_max.dtype)))
    return jnp.sum(weighted[:, :, None] * inverse[:, None, :], axis=0)


def _redistribute(actuators: AbstractActuators, moments: SurfaceMoments, target_b: Vector3, solution: Vector) -> Vector:
    """Return deflections within the stops (rad) that give as much of the moment `target_b` (N m) as possible.

    From the unlimited deflections `solution` on, each round fixes the surfaces beyond a stop at the stop, and solves
    for the free surfaces by weighted least squares.
    """
    lower, upper = actuators.lower, actuators.upper
    commanded = jnp.asarray(actuators.is_commanded)
    fixed = ~commanded | (solution < lower) | (solution > upper)
    limited = jnp.clip(solution, lower, upper)
    for _ in range(sum(actuators.is_commanded) - 1):
        base = jnp.where(fixed, limited, _neutral_surfaces(actuators, moments.surfaces))
        missing_b = target_b - moments.moment_b - _multiply(moments.effectiveness, base - moments.surfaces)
        solution = base + _multiply(
            _weighted_inverse(actuators, moments.effectiveness, jnp.where(fixed, 0.0, 1.0)), missing_b
        )
        exceeds_stop = (solution < lower) | (solution > upper)
        limited = jnp.clip(solution, lower, upper)
        fixed = fixed | exceeds_stop
    return limited


_AUTHORITY_SHARE = 0.3
"""Fraction of the deflection margins and rate limits that one channel may use; the remainder is for other channels and
disturbances."""
_MARGIN_MIN = 0.1
"""Least margin to a stop, as a fraction of the surface's half range: keeps the loops active near a stop."""


class Authority(eqx.Module):
    """Control authority: deflections that the surfaces can still make, and their effect on the body rates.

    `deflection` (n, 3) is the deflection of each surface per angular acceleration about each body axis, rad/(rad/s^2):
    inverse of the control effectiveness times inertia. `margin` (n,) is the deflection available up to the nearer stop,
    rad, at least a tenth of half the range; `rate_limit` (n,) the greatest deflection rate, rad/s.
    """

    # deflection per angular acceleration about the body axes (surfaces, 3), rad/(rad/s^2): inverted control
    # effectiveness times inertia
    deflection: Float[Array, "n 3"]
    margin: Vector  # deflection available up to the nearer stop, at least a tenth of half the range (surfaces,), rad
    rate_limit: Vector  # greatest deflection rate (surfaces,), rad/s

    @property
    def rates_jerk(self) -> Vector3:
        """Greatest rates of change of the angular accelerations about the body axes (P, Q, R), rad/s^3.

        Each value holds while the other two accelerations are constant, and the surfaces use 30 percent of their rate
        limits.
        """
        return _AUTHORITY_SHARE * _largest_outputs(self.deflection, self.rate_limit)

    def attitude_acceleration(self, rate_matrix: Matrix33) -> Vector3:
        """Return the greatest angular accelerations of (mu, alpha, beta), rad/s^2.

        Each value holds while the other two accelerations are 0, and the surfaces use 30 percent of their margins.
        `rate_matrix` is the matrix G of `PathMotion`: the rates of (mu, alpha, beta) per unit (P, Q, R).
        """
        return _AUTHORITY_SHARE * _largest_outputs(product3(self.deflection, inverse3(rate_matrix)), self.margin)


def surface_authority(
    actuators: AbstractActuators, mass_properties: MassProperties, moments: SurfaceMoments, surfaces_slow: Vector
) -> Authority:
    """Compute the control authority at the linearization `moments`.

    The margins are the distances of the low-pass filtered deflections `surfaces_slow` (rad) from the nearer stop, and
    at least a tenth of half the range.
    """
    half = 0.5 * (actuators.upper - actuators.lower)
    margin = jnp.minimum(surfaces_slow - actuators.lower, actuators.upper - surfaces_slow)
    return Authority(
        deflection=product3(deflection_for_moment(actuators, moments.effectiveness), mass_properties.inertia_b),
        margin=jnp.maximum(margin, _MARGIN_MIN * half),
        rate_limit=actuators.rate_limit,
    )


def _largest_outputs(deflection: Float[Array, "n 3"], limit: Vector) -> Vector3:
    """Return the greatest magnitude of each of three quantities, with the other two at 0, within surface limits.

    `deflection` (surfaces, 3) is the deflection, or deflection rate, of each surface per unit of each quantity; `limit`
    is the greatest deflection (rad) or rate (rad/s) of each surface.
    """
    return 1.0 / jnp.max(jnp.abs(deflection) / limit[:, None], axis=0)
