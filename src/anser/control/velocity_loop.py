"""Slowest loop: airspeed, path angle and course to thrust, angle of attack and bank (theory section 5, item 3)."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import FlightCondition
from anser.control.limits import FlightLimits
from anser.control.onboard_model import OnboardModel
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.spatial.rotations import safe_hypot

_COS_BANK_MIN = 0.2  # between 78 and 102 deg of bank lift is asked less and less to hold the path
_COS_READY = 0.5  # cosine of the bank error up to which all of the lift is asked; none at 90 deg and beyond
_UP_MIN_G = 0.2  # acceleration normal to the path, in g, below which lift is not asked to turn
_UP_TURNING_G = 0.5  # the same in a turn
LIFT_SHARE = 0.9  # part of the lift at alpha_max that banks and commands may use; the rest holds the path meanwhile
_SIDE_MAX = 0.1  # of the lift: 6 deg of bank against a side force, beyond which it is no steady flight
_NEWTON_STEPS = 2  # the lift curve is piecewise linear: the second step lands when the first crossed a breakpoint


class ThrustDemand(eqx.Module):
    """Throttle with the thrust (N) it is meant to give and whether the engine can give it."""

    throttle: Scalar
    thrust: Scalar
    saturated: Scalar


class AttitudeDemand(eqx.Module):
    """Wanted (mu, alpha, beta), and what stands in the way of the path that was asked for.

    Attributes
    ----------
    angles
        (mu, alpha, beta), rad.
    alpha_saturated
        The path angle is not served: alpha or load factor at a limit, the lift let go, or a push-over held back.
    bank_saturated
        The course is not served: bank or its rate at its limit, bank faded out, or the lift too small for it.
    lift_short
        The bank is held back because the lift at alpha_max is too small.
    load_factor_short
        The bank is held back because the greatest load factor is too small.
    """

    angles: Vector3
    alpha_saturated: Flag
    bank_saturated: Flag
    lift_short: Flag
    load_factor_short: Flag


def thrust_demand(model: OnboardModel, engine_bandwidth: ScalarLike, V_dot: ScalarLike) -> ThrustDemand:
    """Thrust for a wanted V_dot (m/s^2), through the inverted thrust tables, engine lag and gearing.

    T = [m (V_dot + g sin gamma) - (aerodynamic force along the velocity)] / (cos alpha cos beta).
    """
    airframe, now, motion, power = model.airframe, model.slow_condition, model.motion, model.state.power
    engine = airframe.engine
    ca, sa = jnp.cos(motion.alpha), jnp.sin(motion.alpha)
    cb, sb = jnp.cos(motion.beta), jnp.sin(motion.beta)
    X, Y, Z = now.aerodynamic.force_b
    along = X * ca * cb + Y * sb + Z * sa * cb
    mass = airframe.mass_properties.mass
    thrust = (mass * (V_dot + model.gravity * jnp.sin(motion.gamma)) - along) / jnp.maximum(ca * cb, 0.2)
    wanted = engine.power_for_thrust(thrust, now.air_data)
    throttle = engine.throttle_for_power_rate(power, engine_bandwidth * (wanted - power))
    reachable = engine.propulsion(wanted, now.air_data).force_b[0]
    return ThrustDemand(
        throttle=throttle, thrust=thrust, saturated=jnp.abs(thrust - reachable) > 1.0 + 1e-6 * reachable
    )


def lift_at_alpha(
    airframe: AbstractAirframe,
    now: FlightCondition,
    rates_b: Vector3,
    surfaces: Vector,
    other_force_b: Vector3,
    alpha: ScalarLike,
) -> Scalar:
    """Force normal to the path that an angle of attack (rad) gives, up in the aircraft's plane of symmetry, N.

    L = F_X sin(alpha) - F_Z cos(alpha); `other_force_b` is what acts besides the aerodynamics, thrust above all, N.
    """
    data = eqx.tree_at(lambda d: d.alpha, now.air_data, jnp.asarray(alpha))
    force_b = airframe.aerodynamics(data, rates_b, surfaces).force_b + other_force_b
    return force_b[0] * jnp.sin(alpha) - force_b[2] * jnp.cos(alpha)


def side_force(model: OnboardModel) -> Scalar:
    """Force to the right in straight flight without sideslip, N: of an aircraft that is not symmetric.

    With the surfaces at rest: what small deflections against its rolling and yawing moments add is left out.
    """
    airframe, now = model.airframe, model.slow_condition
    data = eqx.tree_at(lambda d: d.beta, now.air_data, jnp.zeros_like(now.air_data.beta))
    at_rest = airframe.actuators.scheduled_position(jnp.zeros_like(model.surfaces_slow), data)
    wrench = airframe.aerodynamics(data, jnp.zeros_like(model.state.rates_b), at_rest)
    return (wrench.force_b + now.propulsive.force_b)[1]


def attitude_demand(model: OnboardModel, gamma_dot: ScalarLike, chi_dot: ScalarLike) -> AttitudeDemand:
    """Bank and angle of attack for wanted gamma_dot and chi_dot (rad/s), sideslip zero (coordinated turns).

    mu = atan2(V cos(gamma) chi_dot, V gamma_dot + g cos gamma) - asin(Y / (m a)), the well-conditioned form, where a is
    the acceleration of both and Y the side force of an aircraft that is not symmetric; alpha from the balance of forces
    normal to the path at the present bank, m (V gamma_dot + g cos gamma) = L(alpha) cos(mu) - Y sin(mu) with
    L = F_X sin(alpha) - F_Z cos(alpha), solved by Newton steps on the airframe's own forces and what the sensors say
    beyond them. With the bank more than 60 deg off, an upset, the aircraft is unloaded first.

    What the lift at alpha_max or the load factor cannot give is left out of both turns alike, of the path's and of the
    course's: gravity is carried first.
    """
    limits, now, motion, gravity = model.limits, model.slow_condition, model.motion, model.gravity
    mass = model.airframe.mass_properties.mass
    weight = mass * gravity
    fall = gravity * jnp.cos(motion.gamma)
    side_free = motion.V * jnp.cos(motion.gamma) * chi_dot
    up_free = motion.V * gamma_dot + fall
    # in a turn the path is pushed down no faster than leaves lift to turn with
    turning = jnp.clip(jnp.abs(side_free) / (_UP_TURNING_G * gravity), 0.0, 1.0)
    up = up_free + turning * jnp.maximum(_UP_TURNING_G * gravity - up_free, 0.0)
    other_force_b = now.propulsive.force_b + model.residual.force_b

    def lift(alpha: Scalar) -> Scalar:
        return lift_at_alpha(model.airframe, now, model.state.rates_b, model.surfaces_slow, other_force_b, alpha)

    # more bank than the lift can hold would be a sinking spiral up to alpha_max and beyond
    lift_most = jnp.maximum(LIFT_SHARE * lift(limits.alpha_max), 0.0)
    most = jnp.minimum(lift_most, limits.load_factor_max * weight)
    share = _share_within(fall, up - fall, side_free, most / mass)
    level_min = _UP_MIN_G * gravity
    level = jnp.maximum(fall + share * (up - fall), level_min)
    # a lift that points down turns the wrong way: bank fades out with the lift that is wanted
    upright = jnp.clip(up / level_min, 0.0, 1.0)
    mu_free = jnp.arctan2(upright * share * side_free, level)
    beside = None if model.airframe.symmetric else side_force(model)
    if beside is not None:
        tilt = jnp.arcsin(jnp.clip(beside / (mass * safe_hypot(share * side_free, level)), -_SIDE_MAX, _SIDE_MAX))
        mu_free = mu_free - upright * tilt
    mu = jnp.clip(mu_free, -limits.bank_max, limits.bank_max)
    c_mu = jnp.cos(motion.mu)
    # far from the wanted bank, on the back above all, the lift would point the wrong way: unload first, roll, then pull
    ready = jnp.clip(jnp.cos(motion.mu - mu) / _COS_READY, 0.0, 1.0)
    lift_free = ready * mass * up * c_mu / jnp.maximum(c_mu**2, _COS_BANK_MIN**2)
    if beside is not None:
        lift_free = lift_free + ready * beside * jnp.sin(motion.mu) * c_mu / jnp.maximum(c_mu**2, _COS_BANK_MIN**2)
    lift_wanted = jnp.clip(lift_free, limits.load_factor_min * weight, limits.load_factor_max * weight)
    slope_min = 0.02 * now.air_data.qbar  # keeps the step finite past the peak of the lift curve

    def closer(_: object, alpha: Scalar) -> Scalar:
        value, slope = jax.jvp(lift, (alpha,), (jnp.ones_like(alpha),))
        step = (lift_wanted - value) / jnp.maximum(slope, slope_min)
        return jnp.clip(alpha + step, limits.alpha_min - 0.1, limits.alpha_max + 0.1)

    alpha_free = jax.lax.fori_loop(0, _NEWTON_STEPS, closer, motion.alpha)
    alpha = jnp.clip(alpha_free, limits.alpha_min, limits.alpha_max)
    return AttitudeDemand(
        angles=jnp.stack([mu, alpha, jnp.zeros_like(alpha)]),
        alpha_saturated=(alpha != alpha_free) | (lift_wanted != lift_free) | (ready < 1.0) | (up != up_free),
        bank_saturated=(mu != mu_free) | (share < 1.0) | ((upright < 1.0) & (side_free != 0.0)),
        lift_short=(share < 1.0) & (lift_most <= most),
        load_factor_short=(share < 1.0) & (lift_most > most),
    )


def limit_bank_rate(
    demand: AttitudeDemand, before: Scalar | None, limits: FlightLimits, step: ScalarLike
) -> tuple[AttitudeDemand, Scalar | None]:
    """The demand with a bank angle that changes no faster than the limits say, and that angle for the next step.

    After an upset, beyond the greatest bank angle, the rate counts from that angle on: the attitude loop rolls back.

    Parameters
    ----------
    demand
        As if the rate were free.
    before
        The bank angle commanded a step (s) ago, rad; None where the rate is free.
    """
    if before is None or limits.bank_rate_max is None:
        return demand, before
    free, most = demand.angles[0], limits.bank_rate_max * step
    bank = jnp.clip(before, -limits.bank_max, limits.bank_max)
    bank = bank + jnp.clip(free - bank, -most, most)
    limited = eqx.tree_at(
        lambda d: (d.angles, d.bank_saturated),
        demand,
        (demand.angles.at[0].set(bank), demand.bank_saturated | (bank != free)),
    )
    return limited, bank


def _share_within(fall: Scalar, up: Scalar, side: Scalar, most: Scalar) -> Scalar:
    """Share s, 0..1, of an acceleration (up, side) with |(fall + s up, s side)| <= most: gravity is carried first."""
    square = up**2 + side**2 + 1e-12
    root = jnp.sqrt(jnp.maximum((fall * up) ** 2 + square * (most**2 - fall**2), 1e-12))
    return jnp.clip((root - fall * up) / square, 0.0, 1.0)
