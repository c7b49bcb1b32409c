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
    """Aerodynamic moment, linearized about the deflections of n surfaces."""

    surfaces: Vector  # deflections (n,), rad
    moment_b: Vector3  # aerodynamic moment about the centre of gravity at `surfaces`, body axes (3,), N m
    # derivative of the moment by the deflections (3, n), N m/rad; 0 for surfaces that no controller commands
    effectiveness: Float[Array, "3 n"]


class SurfaceDemand(eqx.Module):
    """Surface deflections, or commands to the actuators, within the stops."""

    surfaces: Vector  # deflections or commands (n,), rad
    saturated: Bool[Array, " n"]  # True: the moment would need a deflection beyond a stop


def surface_moments(
    airframe: AbstractAirframe, condition: AirDataAndForces, rates_b: Vector3, surfaces: Vector
) -> SurfaceMoments:
    """Compute aerodynamic moment (N m) and control effectiveness (N m/rad) at the deflections `surfaces` (rad)."""

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

    S is the effectiveness, and W the diagonal of the squared half ranges between the stops. The result is

    - S^-1 for one surface per axis,
    - the right inverse W S' (S W S')^-1 for more surfaces: the smallest deflections relative to the ranges,
    - the weighted least-squares inverse for fewer surfaces or a rank-deficient S; yaw is given up first, pitch last.

    Source: O. Harkegard, "Efficient active set algorithms for solving constrained least squares problems in aircraft
    control allocation", 2002; here with the weights in closed form.
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

    `moment_b` is the total moment about the centre of gravity, body axes. `present` is the aerodynamic moment at the
    present deflections. Surfaces that follow a schedule keep their present deflections.

    If a surface needs a deflection beyond a stop, the surface is fixed at the stop. The free surfaces then give as much
    of the missing moment as possible, pitch before roll before yaw. If there is one surface per axis, no other surface
    can compensate. The flags of the result refer to the solution before this redistribution.
    """
    target_b = moment_b - condition.propulsive.moment_b
    actuators = airframe.actuators
    lower, upper = actuators.lower, actuators.upper
    moments, solution = present, present.surfaces
    for k in range(_NEWTON_STEPS):
        if k:  # Cm0 is not linear in the elevator: theory section 5, item 1
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
    """Return `surfaces` with the commanded surfaces at 0, or at the stop nearest to 0; the allocation starts there."""
    neutral = actuators.limit_command(jnp.zeros_like(surfaces))
    return jnp.where(jnp.asarray(actuators.is_commanded), neutral, surfaces)


def _weighted_inverse(
    actuators: AbstractActuators, effectiveness: Float[Array, "3 n"], is_free: Float[Array, " n"]
) -> Float[Array, "n 3"]:
    """Return the weighted pseudo-inverse W S' (S W S' + E)^-1 of the effectiveness S, rad/(N m), shape (surfaces, 3).

    W is the diagonal of the squared half ranges, with 0 for fixed surfaces (`is_free` 0). The small diagonal E sets the
    order in which unattainable moments are given up: yaw, roll, pitch.
    """
    half = 0.5 * (actuators.upper - actuators.lower)
    weight = is_free * half**2
    weighted = effectiveness * weight[None, :]
    gram = jnp.sum(weighted[:, None, :] * effectiveness[None, :, :], axis=2)
    square_max = jnp.max(jnp.sum((effectiveness * half[None, :]) ** 2, axis=1))
    inverse = inverse3(gram + jnp.diag(_REGULARIZATION * square_max * _AXIS_PENALTY.astype(square_max.dtype)))
    return jnp.sum(weighted[:, :, None] * inverse[:, None, :], axis=0)


def _redistribute(actuators: AbstractActuators, moments: SurfaceMoments, target_b: Vector3, solution: Vector) -> Vector:
    """Limit the deflections `solution` to the stops; the free surfaces then best give the moment `target_b` (N m)."""
    lower, upper = actuators.lower, actuators.upper
    commanded = jnp.asarray(actuators.is_commanded)
    fixed = ~commanded | (solution < lower) | (solution > upper)
    limited = jnp.clip(solution, lower, upper)
    # each round fixes the surfaces beyond a stop at the stop, and solves for the free surfaces
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
"""Fraction of deflection margins and rate limits that one channel may use; the rest is for other channels and
disturbances."""
_MARGIN_MIN = 0.1
"""Least margin to a stop, as a fraction of the surface's half range: keeps the loops active near a stop."""


class Authority(eqx.Module):
    """Control authority: deflections that n surfaces can still make, and their effect on the body rates."""

    deflection: Float[Array, "n 3"]  # deflections per angular acceleration about each body axis, rad/(rad/s^2)
    margin: Vector  # deflection available up to the nearer stop (n,), rad; at least a tenth of half the range
    rate_limit: Vector  # greatest deflection rate (n,), rad/s

    @property
    def rates_jerk(self) -> Vector3:
        """Greatest rates of change of the angular accelerations about the body axes (P, Q, R), rad/s^3.

        Each value is for one axis alone, with 30 percent of the surfaces' rate limits.
        """
        return _AUTHORITY_SHARE * _largest_outputs(self.deflection, self.rate_limit)

    def attitude_acceleration(self, rate_matrix: Matrix33) -> Vector3:
        """Return the greatest angular accelerations of (mu, alpha, beta), rad/s^2.

        Each value is for one angle alone, with 30 percent of the surfaces' margins. `rate_matrix` is the matrix G of
        `PathMotion`.
        """
        return _AUTHORITY_SHARE * _largest_outputs(product3(self.deflection, inverse3(rate_matrix)), self.margin)


def surface_authority(
    actuators: AbstractActuators, mass_properties: MassProperties, moments: SurfaceMoments, surfaces_slow: Vector
) -> Authority:
    """Compute the control authority; margins are measured from low-pass filtered deflections `surfaces_slow`, rad."""
    half = 0.5 * (actuators.upper - actuators.lower)
    margin = jnp.minimum(surfaces_slow - actuators.lower, actuators.upper - surfaces_slow)
    return Authority(
        deflection=product3(deflection_for_moment(actuators, moments.effectiveness), mass_properties.inertia_b),
        margin=jnp.maximum(margin, _MARGIN_MIN * half),
        rate_limit=actuators.rate_limit,
    )


def _largest_outputs(deflection: Float[Array, "n 3"], limit: Vector) -> Vector3:
    """Return the greatest magnitude that each of three quantities can have alone.

    `limit` is the greatest deflection or rate of each surface; `deflection` (surfaces, 3) is the deflection or rate of
    each surface per unit of each quantity.
    """
    return 1.0 / jnp.max(jnp.abs(deflection) / limit[:, None], axis=0)
