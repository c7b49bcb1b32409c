"""Trim of any airframe for straight, climbing and turning flight: steady forces and moments, no side force."""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from anser.aircraft import (
    AbstractAirframe,
    AircraftState,
    Controls,
    air_data,
    angular_acceleration,
)
from anser.environment import Environment
from anser.shapes import Flag, Scalar, ScalarLike, Vector3
from anser.spatial import attitude_from_path, cross, quaternion_from_rotation, rotate

_ALPHA_STARTS_DEG = (2.0, 8.0, 18.0, 30.0, 42.0)  # the lift and moment tables have kinks: one start is not enough
_CONVERGED = 1e-8  # residual in g and rad/s^2; solver noise is 1e-12, a missed root 1e-2


class TrimTarget(eqx.Module):
    """The steady flight wanted.

    Attributes
    ----------
    speed
        True airspeed, m/s.
    altitude
        Geometric altitude, m.
    path_angle, course
        Of the velocity through the air, rad.
    turn_rate
        Rate of the course, rad/s; positive turns right.
    """

    speed: Scalar
    altitude: Scalar
    path_angle: Scalar
    course: Scalar
    turn_rate: Scalar


class TrimPoint(eqx.Module):
    """A solution of the trim equations, inside the aircraft's limits or not.

    Attributes
    ----------
    state
        At north 0, east 0 and the target's altitude, velocity over ground for the environment's wind.
    controls
        Held surfaces and throttle (0..1; at its stop where the power wanted lies beyond).
    mu, alpha, beta
        Bank about the velocity vector, angle of attack, sideslip, rad.
    power
        Power that balances the drag, percent; outside 0..100 where the engine cannot.
    converged
        Whether the equations are solved (residual below 1e-8 g and rad/s^2).
    residual
        Largest remaining acceleration, g and rad/s^2.
    """

    state: AircraftState
    controls: Controls
    mu: Scalar
    alpha: Scalar
    beta: Scalar
    power: Scalar
    converged: Flag
    residual: Scalar


def trim_target(
    speed: ScalarLike,
    altitude: ScalarLike,
    path_angle: ScalarLike = 0.0,
    course: ScalarLike = 0.0,
    turn_rate: ScalarLike = 0.0,
) -> TrimTarget:
    """Build a target from numbers: m/s, m, rad, rad, rad/s."""
    return TrimTarget(*(jnp.asarray(x, dtype=float) for x in (speed, altitude, path_angle, course, turn_rate)))


def _steady_state(target: TrimTarget, x: Float[Array, "7"]) -> AircraftState:
    alpha, beta, mu = x[0], x[1], x[2]
    R_bn = attitude_from_path(mu, target.path_angle, target.course, alpha, beta)
    sa, ca, sb, cb = jnp.sin(alpha), jnp.cos(alpha), jnp.sin(beta), jnp.cos(beta)
    zero = jnp.zeros_like(alpha)
    return AircraftState(
        position_n=jnp.stack([zero, zero, -target.altitude]),
        velocity_b=target.speed * jnp.stack([ca * cb, sb, sa * cb]),
        quaternion=quaternion_from_rotation(R_bn),
        rates_b=rotate(R_bn, jnp.stack([zero, zero, target.turn_rate])),
        surfaces=x[3:6],
        power=100 * x[6],
    )


def _residual(x: Float[Array, "7"], case: tuple[AbstractAirframe, Environment, TrimTarget]) -> Float[Array, "7"]:
    """Accelerations that must vanish, in g and rad/s^2, and the side force over the weight."""
    airframe, environment, target = case
    state = _steady_state(target, x)
    R_bn = attitude_from_path(x[2], target.path_angle, target.course, x[0], x[1])
    air = environment.atmosphere.at(target.altitude)
    data = air_data(state.velocity_b, target.altitude, air)
    wrench = airframe.aerodynamics(data, state.rates_b, state.surfaces) + airframe.propulsion(
        state.power, target.altitude, data.mach
    )
    mass = airframe.mass_properties.mass
    g = environment.gravity
    specific_b = wrench.force_b / mass
    fall_b = rotate(R_bn, jnp.zeros(3).at[2].set(g))
    linear = (specific_b + fall_b - cross(state.rates_b, state.velocity_b)) / g
    angular = angular_acceleration(airframe.mass_properties, state.rates_b, wrench.moment_b)
    return jnp.concatenate([linear, angular, specific_b[1:2] / g])


def solve_trim(airframe: AbstractAirframe, environment: Environment, target: TrimTarget) -> TrimPoint:
    """Solve the seven trim equations for alpha, beta, mu, three surfaces and power.

    Equations: body velocity and body rates constant in a steady (helical) turn, and no side force (coordination; [SL]
    section 3.6 imposes the same). Limits are not imposed, so that a diagnosis can tell by how much they are exceeded:
    see `anser.simulation.trim_violations`. Levenberg-Marquardt from several angles of attack; of the solutions, the one
    inside the limits with the least angle of attack is taken. Differentiable by the implicit function theorem.

    Parameters
    ----------
    airframe, environment
        Any airframe; the wind sets the ground velocity of the result only.
    target
        Steady flight wanted.
    """
    solver = optx.LevenbergMarquardt(rtol=1e-12, atol=1e-12)
    bank = jnp.arctan2(target.speed * target.turn_rate * jnp.cos(target.path_angle), environment.gravity)

    def attempt(alpha_start: Scalar) -> tuple[Float[Array, "7"], Scalar]:
        start = jnp.zeros(7).at[0].set(alpha_start).at[2].set(bank).at[6].set(0.3)
        case = (airframe, environment, target)
        x = optx.least_squares(_residual, solver, start, args=case, max_steps=64, throw=False).value
        return x, jnp.max(jnp.abs(_residual(x, case)))

    candidates, residuals = jax.vmap(attempt)(jnp.deg2rad(jnp.asarray(_ALPHA_STARTS_DEG)))
    residuals = jnp.where(jnp.isfinite(residuals), residuals, jnp.inf)
    excess = jax.vmap(lambda x: _excess(airframe, x))(candidates)
    rank = jnp.where(residuals < _CONVERGED, jnp.where(excess > 0, 1e3 + excess, candidates[:, 0]), 1e6 + residuals)
    best = jnp.argmin(rank)
    x, residual = candidates[best], residuals[best]
    state = _steady_state(target, x)
    wind_b = rotate(
        attitude_from_path(x[2], target.path_angle, target.course, x[0], x[1]),
        environment.wind.at(state.position_n, 0.0),
    )
    state = eqx.tree_at(lambda s: s.velocity_b, state, state.velocity_b + wind_b)
    return TrimPoint(
        state=state,
        controls=Controls(surfaces=state.surfaces, throttle=airframe.throttle_for_power(state.power)),
        mu=x[2],
        alpha=x[0],
        beta=x[1],
        power=state.power,
        converged=residual < _CONVERGED,
        residual=residual,
    )


def _excess(airframe: AbstractAirframe, x: Float[Array, "7"]) -> Scalar:
    """How far a solution lies outside the limits (rad and fractions of power, summed); 0 inside."""

    def beyond(value: Scalar | Vector3, lower: Scalar | Vector3, upper: Scalar | Vector3) -> Scalar:
        return jnp.sum(jnp.maximum(value - upper, 0.0) + jnp.maximum(lower - value, 0.0))

    return (
        beyond(x[0], *airframe.alpha_range)
        + beyond(x[1], *airframe.beta_range)
        + beyond(x[3:6], airframe.actuators.lower, airframe.actuators.upper)
        + beyond(x[6], jnp.zeros(()), jnp.ones(()))
    )
