"""Trim of any airframe in straight, climbing, turning and pull-up flight, and points of a trim map."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from anser.aircraft.air_data import AirData, air_data
from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.aircraft.motion import air_data_and_forces, angular_acceleration
from anser.control.allocation import deflection_for_moment
from anser.environment.atmosphere import Air
from anser.environment.earth import AbstractEarth
from anser.environment.environment import Environment
from anser.numerics.arrays import as_array, namespace
from anser.numerics.least_squares import Solution, levenberg_marquardt, with_implicit_derivative
from anser.numerics.linear import cross
from anser.shapes import Flag, Matrix33, Scalar, ScalarLike, Vector, Vector3
from anser.spatial.rotations import quaternion_from_rotation, rotate, rotate_back
from anser.spatial.wind_axes import air_direction_b, attitude_from_path
from anser.units import DEG_RAD

Unknowns = Float[Array, " unknown"]
"""Unknowns of the trim: alpha, beta, mu (rad), deflections of the commanded surfaces (rad), power (fraction of full).

For an aircraft with more than three commanded surfaces, three factors (rad) stand for the deflections, one each for
roll, pitch and yaw: see `_surface_shares`."""

_ALPHA_STARTS_DEG = (2.0, 8.0, 18.0, 30.0, 42.0)
"""Angles of attack from which the solver starts, deg: several, because the lift and moment tables have kinks."""
LIMIT_TOLERANCE = 1e-9
"""Excess over a limit that still counts as inside, rad or fraction of power: a thousand times the solver's noise."""
_CONVERGED = 1e-8  # greatest residual of a solution, g and rad/s^2; solver noise is 1e-12, a missed root 1e-2


class TrimTarget(eqx.Module):
    """The required steady flight condition, relative to the air.

    A pull-up is commanded by `path_rate` or by `pitch_rate`. If the flight has sideslip (for the F-16 due to the
    engine's angular momentum), the pull-ups differ. With `path_rate`, the course is constant, and P and R are not 0.
    With `pitch_rate`, the heading is constant, and P and R are 0.
    """

    speed: Scalar  #: True airspeed, m/s.
    altitude: Scalar  #: Geometric altitude, m.
    path_angle: Scalar  #: Path angle of the velocity through the air, rad, up positive.
    course: Scalar  #: Course of the velocity through the air, rad, clockwise from north.
    turn_rate: Scalar  #: Rate of the course, rad/s; positive turns right.
    #: Rate of the path angle, rad/s; positive bends the path up. The velocity turns about the horizontal line to the
    #: right of the course, also in a turn. If not 0, the condition holds for an instant only.
    path_rate: Scalar
    #: Body rate Q of a pull-up as in [SL] section 3.6, rad/s: P = R = 0, and the wings are level if no side force acts.
    #: If not 0, turn and path rates must be 0, and the condition holds for an instant only.
    pitch_rate: Scalar


class TrimPoint(eqx.Module):
    """Result of `solve_trim`: a solution inside or outside the aircraft's limits, or the best attempt at a solution."""

    #: State at the required position and altitude; the velocity over ground includes the environment's wind.
    state: AircraftState
    controls: Controls  #: Constant deflections (rad) and throttle (0..1, saturated).
    mu: Scalar  #: Bank about the velocity vector, rad.
    alpha: Scalar  #: Angle of attack, rad.
    beta: Scalar  #: Sideslip, rad.
    power: Scalar  #: Engine power that balances the forces, percent; outside 0..100 if the engine cannot deliver it.
    converged: Flag  #: Whether the equations are solved (residual below 1e-8 g and rad/s^2).
    #: Largest remaining acceleration, g and rad/s^2; infinite for a contradictory target, with a pitch rate and also a
    #: turn rate or path rate.
    residual: Scalar
    #: Sum of the violations of alpha, beta, surface (rad) and power (fraction) limits; 0 inside the limits.
    excess: Scalar


def trim_target(
    speed: ScalarLike,
    altitude: ScalarLike,
    path_angle: ScalarLike = 0.0,
    course: ScalarLike = 0.0,
    turn_rate: ScalarLike = 0.0,
    path_rate: ScalarLike = 0.0,
    pitch_rate: ScalarLike = 0.0,
) -> TrimTarget:
    """Build a trim target from airspeed (m/s), altitude (m), angles (rad) and rates (rad/s); see `TrimTarget`.

    Raises ValueError if a pitch rate is combined with a turn or path rate. Rates traced by JAX are not checked; the
    trim then has an infinite `TrimPoint.residual`.
    """
    if _is_known_nonzero(pitch_rate) and (_is_known_nonzero(turn_rate) or _is_known_nonzero(path_rate)):
        raise ValueError(
            f"pitch_rate: arrived {pitch_rate} rad/s with turn_rate {turn_rate} and path_rate {path_rate} rad/s; "
            "expected a pitch rate alone (a pull-up with P = R = 0), or turn and path rates, which set all body rates"
        )
    numbers = (speed, altitude, path_angle, course, turn_rate, path_rate, pitch_rate)
    return TrimTarget(*map(as_array, numbers))


def _is_known_nonzero(rate: ScalarLike) -> bool:
    return not isinstance(rate, Tracer) and float(rate) != 0.0


class _TrimCase(NamedTuple):
    """Constants of the trim equations: aircraft, surroundings and target; `shares` comes from `_surface_shares`."""

    airframe: AbstractAirframe
    shares: Float[Array, "surface unknown"]
    earth: AbstractEarth
    air: Air
    wind_n: Vector3
    position_n: Vector3
    target: TrimTarget


def _attitude(x: Unknowns, target: TrimTarget) -> Matrix33:
    return attitude_from_path(x[2], target.path_angle, target.course, x[0], x[1])


def _rates_b(R_bn: Matrix33, target: TrimTarget) -> Vector3:
    """Return the body rates (P, Q, R), rad/s, that the target's turn, path and pitch rates require."""
    right_b = R_bn[:, 1] * jnp.cos(target.course) - R_bn[:, 0] * jnp.sin(target.course)
    turning_b = target.turn_rate * R_bn[:, 2] + target.path_rate * right_b
    return turning_b.at[1].add(target.pitch_rate)


def _velocity_air_b(x: Unknowns, target: TrimTarget) -> Vector3:
    return target.speed * air_direction_b(x[0], x[1])


def _residual(x: Unknowns, case: _TrimCase) -> Unknowns:
    """Return the accelerations (body axes, g and rad/s^2) that remain at the unknowns `x`; 0 in a steady flight.

    If the actuators control yaw, the last element is side force / weight.
    """
    airframe, _, earth, air, wind_n, position_n, target = case
    R_bn, velocity_b = _attitude(x, target), _velocity_air_b(x, target)
    rates_b = _rates_b(R_bn, target)
    local = earth.local_earth(position_n, rotate_back(R_bn, velocity_b) + wind_n)
    rates_air_b = rates_b + rotate(R_bn, local.transport_rate_n)
    inertial_b = rates_air_b + rotate(R_bn, local.earth_rate_n)
    data = air_data(velocity_b, target.altitude, air)
    propulsive = airframe.engine.propulsion(100 * x[-1], data)
    wrench = airframe.aerodynamics(data, rates_air_b, _surfaces(x, case, data)) + propulsive
    specific_b = wrench.force_b / airframe.mass_properties.mass
    linear = specific_b + rotate(R_bn, local.apparent_gravity_n) - cross(rates_b, velocity_b)
    angular = angular_acceleration(airframe.mass_properties, inertial_b, wrench.moment_b)
    # without yaw control, sideslip balances the yaw, and a side force remains
    coordinated = specific_b[1:2] if airframe.actuators.controls_yaw else jnp.zeros(0)
    return jnp.concatenate([linear / local.gravity, angular, coordinated / local.gravity])


def _surfaces(x: Unknowns, case: _TrimCase, data: AirData) -> Vector:
    """Return all deflections (rad) for the unknowns x; surfaces with a schedule follow the schedule."""
    return case.airframe.actuators.scheduled_position(jnp.sum(case.shares * x[None, 3:-1], axis=1), data)


def _surface_shares(airframe: AbstractAirframe, data: AirData) -> Float[Array, "surface unknown"]:
    """Return the deflection of each surface per unit of each unknown of the trim; 0 for surfaces without command.

    If there are more than three commanded surfaces, the unknowns are factors (rad) for roll, pitch and yaw. To each
    factor belongs the set of deflections that produces the moment about the axis with the least use of the surfaces'
    ranges; the factor is the largest deflection of the set.
    """
    actuators = airframe.actuators
    commanded = np.flatnonzero(actuators.is_commanded)
    if commanded.size <= 3:
        return jnp.asarray(np.eye(len(actuators.names))[:, commanded])
    scheduled = actuators.scheduled_position(jnp.zeros(len(actuators.names)), data)
    slope = jax.jacfwd(lambda u: airframe.aerodynamics(data, jnp.zeros(3), u).moment_b)(scheduled)
    shares = deflection_for_moment(actuators, slope)
    largest = jnp.max(jnp.abs(shares), axis=0, keepdims=True)
    return shares / jnp.where(largest > 0.0, largest, 1.0)  # no surface makes a moment about an axis: no deflection


def solve_trim(
    airframe: AbstractAirframe, environment: Environment, target: TrimTarget, position_n: Vector3 | None = None
) -> TrimPoint:
    """Trim an aircraft: solve the equations of a steady flight `target` for alpha, beta, mu, surfaces and power.

    Body velocity and body rates are constant, and the side force vanishes (coordination, [SL] section 3.6); an aircraft
    without yaw control may have a side force. The rates are relative to the NED axes at the aircraft, which turn as the
    aircraft travels over a round Earth. The result is the first of these that exists:

    - the solution inside the limits with the smallest angle of attack
    - the solution with the least excess over the limits; `trim_violations` lists the violated limits
    - the attempt with the least residual

    Differentiable by the implicit function theorem, first derivatives only.

    Parameters
    ----------
    environment
        Atmosphere, wind and Earth; over a flat Earth the wind changes only the ground velocity of the result.
    position_n
        Position (3,), NED in the Earth's chart (local map), m; the altitude is from the target. None: origin.
    """
    north, east = (jnp.zeros(()), jnp.zeros(())) if position_n is None else (position_n[0], position_n[1])
    position_n = jnp.stack([north, east, -target.altitude])
    wind_n = environment.wind.at(position_n, 0.0)
    air = environment.atmosphere.at(target.altitude)
    low = jnp.asarray(_ALPHA_STARTS_DEG[0] * DEG_RAD)
    slow_flight = air_data(target.speed * jnp.stack([jnp.cos(low), 0.0 * low, jnp.sin(low)]), target.altitude, air)
    shares = _surface_shares(airframe, slow_flight)
    case = _TrimCase(airframe, shares, environment.earth, air, wind_n, position_n, target)
    upward = environment.gravity + jnp.maximum(target.speed * target.path_rate, 0.0)
    bank = jnp.arctan2(target.speed * target.turn_rate * jnp.cos(target.path_angle), upward)

    def attempt(alpha_start: Scalar) -> Solution:
        start = jnp.zeros(4 + shares.shape[1]).at[0].set(alpha_start).at[2].set(bank).at[-1].set(0.3)
        return levenberg_marquardt(_residual, case, start)

    solutions = jax.vmap(attempt)(jnp.asarray(_ALPHA_STARTS_DEG) * DEG_RAD)
    excess = jax.vmap(lambda x: _excess(case, x))(solutions.x)
    solved = solutions.residual < _CONVERGED
    # Rank: solutions inside the limits, then solutions outside, then the smallest residual.
    rank = jnp.where(solved, jnp.where(excess > 0, 1e3 + excess, solutions.x[:, 0]), 1e6 + solutions.residual)
    best = jnp.argmin(jax.lax.stop_gradient(rank))
    x = with_implicit_derivative(_residual, case, solutions.x[best])
    turning = (target.turn_rate != 0) | (target.path_rate != 0)
    residual = jnp.where((target.pitch_rate != 0) & turning, jnp.inf, solutions.residual[best])
    R_bn = _attitude(x, target)
    flow = air_data(_velocity_air_b(x, target), target.altitude, air)
    state = AircraftState(
        position_n=position_n,
        velocity_b=_velocity_air_b(x, target) + rotate(R_bn, wind_n),
        quaternion=quaternion_from_rotation(R_bn),
        rates_b=_rates_b(R_bn, target),
        actuators=airframe.actuators.steady_state_in_flow(_surfaces(x, case, flow), flow),
        engine=airframe.engine.steady_state(100 * x[-1]),
    )
    return TrimPoint(
        state=state,
        controls=Controls(surfaces=state.surfaces, throttle=airframe.engine.throttle_for_power(state.power)),
        mu=x[2],
        alpha=x[0],
        beta=x[1],
        power=state.power,
        converged=residual < _CONVERGED,
        residual=residual,
        excess=_excess(case, x),
    )


def _excess(case: _TrimCase, x: Unknowns) -> Scalar:
    """Return the sum of the violations of alpha, beta, surface (rad) and power (fraction) limits; 0 inside."""
    airframe, target = case.airframe, case.target
    surfaces = _surfaces(x, case, air_data(_velocity_air_b(x, target), target.altitude, case.air))

    def beyond(value: Scalar | Vector, lower: Scalar | Vector, upper: Scalar | Vector) -> Scalar:
        return jnp.sum(jnp.maximum(value - upper, 0.0) + jnp.maximum(lower - value, 0.0))

    return (
        beyond(x[0], *airframe.alpha_range)
        + beyond(x[1], *airframe.beta_range)
        + beyond(surfaces, airframe.actuators.lower, airframe.actuators.upper)
        + beyond(x[-1], jnp.zeros(()), jnp.ones(()))
    )


TRIM_OBSTACLES = ("tables", "no_balance", "thrust_max", "thrust_idle", "surfaces", "alpha", "beta")
"""Obstacles to steady flight: airspeed, altitude or Mach number outside the data; unbalanced forces or moments; power
above 100 percent; power below 0; a surface beyond its stop; alpha outside the data; beta outside the data."""


class TrimMapPoint(eqx.Module):
    """One point of a trim map: the trim, obstacles to this flight, and margins to the limits."""

    trim: TrimPoint  # solution of the trim equations, even if it cannot be flown
    obstacles: Bool[Array, "7"]  # flags of the `TRIM_OBSTACLES`; all false if the point can be flown
    mach: Scalar  # Mach number
    load_factor: Scalar  # aerodynamic and propulsive force along -z of the body, divided by the weight
    # distance of the power from 100 percent and from 0, as a fraction of full power; negative beyond the limit
    power_margin: Scalar
    power_above_idle: Scalar
    # distance of each surface from its stop, divided by the travel from mid-range to stop; negative beyond the stop
    surface_margin: Vector

    @property
    def trimmable(self) -> Bool[Array, "..."]:
        """Whether the point can be flown: no flag of `obstacles` is set; for a batch, one flag per point."""
        xp = namespace(self.obstacles)
        return ~xp.any(xp.asarray(self.obstacles), axis=-1)


def trim_map_point(airframe: AbstractAirframe, environment: Environment, target: TrimTarget) -> TrimMapPoint:
    """Trim an aircraft at north = east = 0; return the trim, obstacles to this flight, and margins to the limits."""
    point = solve_trim(airframe, environment, target)
    condition = air_data_and_forces(airframe, environment, 0.0, point.state)
    data = condition.air_data
    # the flow angles have separate flags
    inside = dataclasses.replace(
        data, alpha=jnp.clip(data.alpha, *airframe.alpha_range), beta=jnp.clip(data.beta, *airframe.beta_range)
    )
    power, surfaces = point.power / 100, point.state.surfaces
    actuators = airframe.actuators

    def beyond(value: Scalar | Vector3, lower: Scalar | Vector3, upper: Scalar | Vector3) -> Flag:
        return jnp.any((value < lower - LIMIT_TOLERANCE) | (value > upper + LIMIT_TOLERANCE))

    stops = [
        power > 1 + LIMIT_TOLERANCE,
        power < -LIMIT_TOLERANCE,
        beyond(surfaces, actuators.lower, actuators.upper),
        beyond(point.alpha, *airframe.alpha_range),
        beyond(point.beta, *airframe.beta_range),
    ]
    # without a solution, power, surfaces and angles are meaningless
    stops = [airframe.outside_tables(inside), ~point.converged, *(stop & point.converged for stop in stops)]
    return TrimMapPoint(
        trim=point,
        obstacles=jnp.stack(stops),
        mach=data.mach,
        load_factor=-condition.wrench.force_b[2] / (airframe.mass_properties.mass * condition.earth.gravity),
        power_margin=1 - power,
        power_above_idle=power,
        surface_margin=1 - surface_share(airframe, surfaces),
    )


def surface_share(airframe: AbstractAirframe, surfaces: Vector) -> Vector:
    """Return |deflection from mid-range| / (travel from mid-range to the stop) of each surface; 1 at the stop."""
    lower, upper = airframe.actuators.lower, airframe.actuators.upper
    return jnp.abs(2 * surfaces - lower - upper) / (upper - lower)
