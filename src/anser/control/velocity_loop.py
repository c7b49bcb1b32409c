"""Velocity loop: thrust, alpha and bank for rates of airspeed, path angle and course (theory section 5, item 3)."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import AirDataAndForces
from anser.control.limits import NORMAL_TURNING_G, FlightLimits
from anser.control.onboard_model import OnboardModel
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.spatial.rotations import safe_hypot

_COS_BANK_MIN = 0.2  # between 78 and 102 deg of bank the lift demand fades out
_COS_FULL_LIFT = 0.5  # cosine of the bank error up to which the full lift is demanded; none from 90 deg on
_NORMAL_MIN_G = 0.2  # acceleration normal to the path, in g, below which no turn is demanded
LIFT_SHARE = 0.9  # share of the lift at alpha_max for bank and commands; the remainder holds the path
_SIDE_SHARE_MAX = 0.1  # of the lift: at most 6 deg of bank against a side force
_INVERSE_ERROR_MAX = 0.1  # acceleration, m/s^2, that an interpolated inverse of the thrust may miss
_NEWTON_STEPS = 2  # the lift curve is piecewise linear: a second step is exact after one breakpoint


class ThrustDemand(eqx.Module):
    """Demand to the engine."""

    throttle: Scalar  # 0..1
    thrust: Scalar  # N
    saturated: Scalar  # whether the engine cannot give the thrust


class AttitudeDemand(eqx.Module):
    """Command of the velocity loop to the attitude loop, and flags of limits."""

    angles: Vector3  # (mu, alpha, beta), rad
    # whether the path angle is not followed: alpha or load factor is at a limit, a push-over is limited, or the bank
    # error exceeds 60 deg
    alpha_saturated: Flag
    # whether the course is not followed: bank or bank rate is at a limit, the turn is reduced, or the demanded lift is
    # too small for a turn (less than 0.2 g normal to the path)
    bank_saturated: Flag
    lift_short: Flag  # whether the turn is reduced because of the lift at alpha_max
    load_factor_short: Flag  # whether the turn is reduced because of the greatest load factor


def thrust_demand(model: OnboardModel, engine_bandwidth: ScalarLike, V_dot: ScalarLike) -> ThrustDemand:
    """Compute throttle and thrust for a commanded V_dot (m/s^2) by inversion of the engine's thrust and lag.

    The thrust is T = [m (V_dot + g sin gamma) - F] / max(cos alpha cos beta, 0.2), with the aerodynamic force F along
    the velocity. The engine power approaches the power for T with the bandwidth `engine_bandwidth` (1/s). The demand is
    saturated if the engine cannot give T.
    """
    airframe, condition, motion, power = model.airframe, model.slow_condition, model.motion, model.state.power
    engine = airframe.engine
    ca, sa = jnp.cos(motion.alpha), jnp.sin(motion.alpha)
    cb, sb = jnp.cos(motion.beta), jnp.sin(motion.beta)
    X, Y, Z = jnp.unstack(condition.aerodynamic.force_b)
    force_along = X * ca * cb + Y * sb + Z * sa * cb
    mass = airframe.mass_properties.mass
    thrust = (mass * (V_dot + model.gravity * jnp.sin(motion.gamma)) - force_along) / jnp.maximum(ca * cb, 0.2)
    power_demand = engine.power_for_thrust(thrust, condition.air_data)
    throttle = engine.throttle_for_power_rate(power, engine_bandwidth * (power_demand - power))
    thrust_available = engine.propulsion(power_demand, condition.air_data).force_b[0]
    # Inside the range of powers, a small difference is an error of the interpolated inverse: the integral removes that;
    # a larger one is a demand below the least thrust.
    is_at_end = (power_demand <= 0.0) | (power_demand >= 100.0)
    missing = jnp.abs(thrust - thrust_available)
    is_short = (is_at_end & (missing > 1.0 + 1e-6 * thrust_available)) | (missing > _INVERSE_ERROR_MAX * mass)
    return ThrustDemand(throttle=throttle, thrust=thrust, saturated=is_short)


def lift_at_alpha(
    airframe: AbstractAirframe,
    condition: AirDataAndForces,
    rates_b: Vector3,
    surfaces: Vector,
    other_force_b: Vector3,
    alpha: ScalarLike,
) -> Scalar:
    """Compute the force normal to the path (N, up positive) in the plane of symmetry at the angle of attack `alpha`.

    L = F_X sin(alpha) - F_Z cos(alpha). The other air data are from `condition`; `surfaces` are the deflections, rad;
    `other_force_b` is the non-aerodynamic force, mainly thrust, N.
    """
    data = eqx.tree_at(lambda d: d.alpha, condition.air_data, jnp.asarray(alpha))
    force_b = airframe.aerodynamics(data, rates_b, surfaces).force_b + other_force_b
    return force_b[0] * jnp.sin(alpha) - force_b[2] * jnp.cos(alpha)


def side_force(model: OnboardModel) -> Scalar:
    """Compute the side force (N, right positive) in straight flight without sideslip; 0 for a symmetric aircraft.

    Body rates and the deflections of commanded surfaces are set to 0.
    """
    airframe, condition = model.airframe, model.slow_condition
    data = eqx.tree_at(lambda d: d.beta, condition.air_data, jnp.zeros_like(condition.air_data.beta))
    at_rest = airframe.actuators.scheduled_position(jnp.zeros_like(model.surfaces_slow), data)
    wrench = airframe.aerodynamics(data, jnp.zeros_like(model.state.rates_b), at_rest)
    return (wrench.force_b + condition.propulsive.force_b)[1]


def attitude_demand(model: OnboardModel, gamma_dot: ScalarLike, chi_dot: ScalarLike) -> AttitudeDemand:
    """Compute bank and angle of attack for commanded gamma_dot and chi_dot (rad/s) in coordinated flight (beta = 0).

    The bank is mu = atan2(V cos(gamma) chi_dot, V gamma_dot + g cos gamma) - asin(Y / (m a)), with the side force Y of
    an asymmetric aircraft, and the root a of the sum of squares of both arguments of atan2. Alpha follows from the
    forces normal to the path at the present bank: m (V gamma_dot + g cos gamma) = L(alpha) cos(mu) - Y sin(mu). L is
    `lift_at_alpha`, including the measured residual. If the bank error exceeds 60 deg, the lift is first reduced.

    If the command needs more than 0.9 of the lift at alpha_max, or more than the greatest load factor, V gamma_dot and
    V cos(gamma) chi_dot are reduced by a common factor; the lift that carries the weight is not reduced.
    """
    limits, condition, motion, gravity = model.limits, model.slow_condition, model.motion, model.gravity
    mass = model.airframe.mass_properties.mass
    weight = mass * gravity
    gravity_normal = gravity * jnp.cos(motion.gamma)
    side_command = motion.V * jnp.cos(motion.gamma) * chi_dot
    normal_command = motion.V * gamma_dot + gravity_normal
    # a push-over in a turn is limited so that enough lift remains for the turn
    turning = jnp.clip(jnp.abs(side_command) / (NORMAL_TURNING_G * gravity), 0.0, 1.0)
    normal = normal_command + turning * jnp.maximum(NORMAL_TURNING_G * gravity - normal_command, 0.0)
    other_force_b = condition.propulsive.force_b + model.residual.force_b

    def lift(alpha: Scalar) -> Scalar:
        return lift_at_alpha(model.airframe, condition, model.state.rates_b, model.surfaces_slow, other_force_b, alpha)

    # bank beyond the available lift would lead into a descending spiral at alpha_max
    lift_max = jnp.maximum(LIFT_SHARE * lift(limits.alpha_max), 0.0)
    force_max = jnp.minimum(lift_max, limits.load_factor_max * weight)
    share = _feasible_share(gravity_normal, normal - gravity_normal, side_command, force_max / mass)
    level_min = _NORMAL_MIN_G * gravity
    level = jnp.maximum(gravity_normal + share * (normal - gravity_normal), level_min)
    # downward lift turns the wrong way: the bank fades out with the demanded lift
    upright = jnp.clip(normal / level_min, 0.0, 1.0)
    mu_target = jnp.arctan2(upright * share * side_command, level)
    lateral_force = None if model.airframe.symmetric else side_force(model)
    if lateral_force is not None:
        sine = lateral_force / (mass * safe_hypot(share * side_command, level))
        mu_target = mu_target - upright * jnp.arcsin(jnp.clip(sine, -_SIDE_SHARE_MAX, _SIDE_SHARE_MAX))
    mu = jnp.clip(mu_target, -limits.bank_max, limits.bank_max)
    c_mu = jnp.cos(motion.mu)
    # with a large bank error, above all inverted, the lift points the wrong way: unload, roll, then pull
    lift_fraction = jnp.clip(jnp.cos(motion.mu - mu) / _COS_FULL_LIFT, 0.0, 1.0)
    divisor = jnp.maximum(c_mu**2, _COS_BANK_MIN**2)
    lift_target = lift_fraction * mass * normal * c_mu / divisor
    if lateral_force is not None:
        lift_target = lift_target + lift_fraction * lateral_force * jnp.sin(motion.mu) * c_mu / divisor
    lift_demand = jnp.clip(lift_target, limits.load_factor_min * weight, limits.load_factor_max * weight)
    slope_min = 0.02 * condition.air_data.qbar  # keeps the step finite past the peak of the lift curve

    def newton_step(_: object, alpha: Scalar) -> Scalar:
        value, slope = jax.jvp(lift, (alpha,), (jnp.ones_like(alpha),))
        step = (lift_demand - value) / jnp.maximum(slope, slope_min)
        return jnp.clip(alpha + step, limits.alpha_min - 0.1, limits.alpha_max + 0.1)

    alpha_target = jax.lax.fori_loop(0, _NEWTON_STEPS, newton_step, motion.alpha)
    alpha = jnp.clip(alpha_target, limits.alpha_min, limits.alpha_max)
    return AttitudeDemand(
        angles=jnp.stack([mu, alpha, jnp.zeros_like(alpha)]),
        alpha_saturated=(alpha != alpha_target)
        | (lift_demand != lift_target)
        | (lift_fraction < 1.0)
        | (normal != normal_command),
        bank_saturated=(mu != mu_target) | (share < 1.0) | ((upright < 1.0) & (side_command != 0.0)),
        lift_short=(share < 1.0) & (lift_max <= force_max),
        load_factor_short=(share < 1.0) & (lift_max > force_max),
    )


def limit_bank_rate(
    demand: AttitudeDemand,  # demand without rate limit
    previous_bank: Scalar | None,  # bank angle commanded one step earlier, rad; None: no rate limit
    limits: FlightLimits,
    step: ScalarLike,  # s
) -> tuple[AttitudeDemand, Scalar | None]:
    """Limit the rate of the commanded bank angle; return the demand, and the bank angle (rad) for the next step.

    A previous bank angle beyond the bank limit, as at a start in an upset, is first set to the limit. If the bank rate
    is not limited, demand and `previous_bank` are returned unchanged.
    """
    if previous_bank is None or limits.bank_rate_max is None:
        return demand, previous_bank
    unlimited_bank, change_max = demand.angles[0], limits.bank_rate_max * step
    bank = jnp.clip(previous_bank, -limits.bank_max, limits.bank_max)
    bank = bank + jnp.clip(unlimited_bank - bank, -change_max, change_max)
    limited = dataclasses.replace(
        demand, angles=demand.angles.at[0].set(bank), bank_saturated=demand.bank_saturated | (bank != unlimited_bank)
    )
    return limited, bank


def _feasible_share(gravity_normal: Scalar, normal: Scalar, lateral: Scalar, magnitude_max: Scalar) -> Scalar:
    """Return the largest s in 0..1 with |(gravity_normal + s normal, s lateral)| <= magnitude_max; all in m/s^2."""
    square = normal**2 + lateral**2 + 1e-12
    root = jnp.sqrt(
        jnp.maximum((gravity_normal * normal) ** 2 + square * (magnitude_max**2 - gravity_normal**2), 1e-12)
    )
    return jnp.clip((root - gravity_normal * normal) / square, 0.0, 1.0)
