"""The on-board model that dynamic inversion inverts.

Path motion, the residual of the model against the sensors (the incremental form), and the autopilot's state.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.air_data import Wrench
from anser.aircraft.airframe import AbstractAirframe, AircraftState
from anser.aircraft.motion import FlightCondition, angular_acceleration
from anser.control.allocation import Authority, SurfaceMoments, surface_authority, surface_moments
from anser.control.autopilot_state import AutopilotState, ModelResidual
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.numerics.linear import times3
from anser.parts.paths import polar
from anser.parts.perception import Belief
from anser.shapes import Matrix33, Scalar, ScalarLike, Vector, Vector3
from anser.spatial.rotations import rotate_back
from anser.spatial.wind_axes import bank_about_velocity


class PathMotion(eqx.Module):
    """Wind-axis angles of one aircraft and the parts of their rates that carry no body rate.

    Attributes
    ----------
    V, gamma, chi
        Airspeed (m/s), path angle and course through the air (rad).
    mu, alpha, beta
        Bank about the velocity vector, angle of attack, sideslip, rad.
    drift
        The terms of (mu_dot, alpha_dot, beta_dot) without body rates, rad/s.
    effectiveness
        G in (mu_dot, alpha_dot, beta_dot) = drift + G (P, Q, R).
    path_rates
        (V_dot, gamma_dot, chi_dot) from the acceleration, m/s^2 and rad/s.
    """

    V: Scalar
    gamma: Scalar
    chi: Scalar
    mu: Scalar
    alpha: Scalar
    beta: Scalar
    drift: Vector3
    effectiveness: Matrix33
    path_rates: Vector3


def path_motion(
    now: FlightCondition, slow_force_b: Vector3, velocity_b: Vector3, mass: ScalarLike, gravity: ScalarLike
) -> PathMotion:
    """Evaluate theory section 2's wind-axis equations (g > 0).

    `slow_force_b` is the force without gravity that `drift` is built from (see `OnboardModel`); the path rates are
    built from the force that acts now.

    Vertical flight (cos gamma = 0) and beta of 90 deg are outside their domain; the denominators are held away from 0.
    """
    alpha, beta = now.air_data.alpha, now.air_data.beta
    velocity_air_n = rotate_back(now.R_bn, velocity_b) - now.wind_n
    mu = bank_about_velocity(now.R_bn, alpha, beta)
    force_b = now.wrench.force_b
    fall_n = jnp.zeros_like(velocity_air_n).at[2].set(gravity)
    path = polar(velocity_air_n, rotate_back(now.R_bn, force_b) / mass + fall_n)
    gamma, chi = path.gamma, path.chi
    V = jnp.maximum(now.air_data.V, 1.0)
    sa, ca, sb, cb = jnp.sin(alpha), jnp.cos(alpha), jnp.sin(beta), jnp.maximum(jnp.cos(beta), 0.05)
    s_mu, c_mu = jnp.sin(mu), jnp.cos(mu)
    cos_gamma = jnp.maximum(jnp.cos(gamma), 0.05)
    tb, t_gam = sb / cb, jnp.sin(gamma) / cos_gamma
    X, Y, Z = slow_force_b
    mV = mass * V
    mu_drift = (
        -(gravity / V) * cos_gamma * c_mu * tb
        + (
            X * (sa * tb + sa * s_mu * t_gam - ca * sb * c_mu * t_gam)
            + Y * cb * c_mu * t_gam
            - Z * (ca * tb + ca * s_mu * t_gam + sa * sb * c_mu * t_gam)
        )
        / mV
    )
    alpha_drift = (Z * ca - X * sa) / (mV * cb) + gravity * cos_gamma * c_mu / (V * cb)
    beta_drift = (-X * ca * sb + Y * cb - Z * sa * sb) / mV + gravity * cos_gamma * s_mu / V
    zero, one = jnp.zeros_like(sa), jnp.ones_like(sa)
    effectiveness = jnp.stack(
        [
            jnp.stack([ca / cb, zero, sa / cb]),
            jnp.stack([-ca * tb, one, -sa * tb]),
            jnp.stack([sa, zero, -ca]),
        ]
    )
    return PathMotion(
        V=V,
        gamma=gamma,
        chi=chi,
        mu=mu,
        alpha=alpha,
        beta=beta,
        drift=jnp.stack([mu_drift, alpha_drift, beta_drift]),
        effectiveness=effectiveness,
        path_rates=jnp.stack([path.V_dot, path.gamma_dot, path.chi_dot]),
    )


class OnboardModel(eqx.Module):
    """On-board model at one instant, which the loops invert.

    The forces in `now` and `slow` are those of the model of `airframe`, plus the residual that the sensors measure
    where the inversion is incremental.

    The two outer loops see the forces as they are with `surfaces_slow`, low-passed deflections: the lift of the moving
    elevator, differentiated twice on its way through the feed-forward, would come back to the elevator with a loop gain
    above one (a limit cycle at the rate limit). Neglecting fast surface forces in the slow loops is the two-time-scale
    assumption of dynamic inversion.
    """

    airframe: AbstractAirframe
    limits: FlightLimits
    state: AircraftState
    condition: FlightCondition
    slow_condition: FlightCondition
    surfaces_slow: Vector
    moments: SurfaceMoments
    authority: Authority
    residual: ModelResidual
    motion: PathMotion
    gravity: ScalarLike
    step: ScalarLike


def onboard_model(
    belief: Belief, limits: FlightLimits, gains: AutopilotGains, controller_state: AutopilotState, step: ScalarLike
) -> OnboardModel:
    """Evaluate the on-board model of what an aircraft believes; `step` is the sampling period, s."""
    airframe, state, now, gravity = belief.airframe, belief.state, belief.condition, belief.condition.earth.gravity
    mass_properties = airframe.mass_properties
    residual = controller_state.residual.advance(
        mass_properties.mass * belief.specific_force_b - now.wrench.force_b,
        state.rates_b,
        angular_acceleration(mass_properties, state.rates_b, now.wrench.moment_b),
        gains.sensor_bandwidth,
        step,
    )
    residual_wrench = Wrench(residual.force_b, times3(mass_properties.inertia_b, residual.acceleration_b))
    now = eqx.tree_at(lambda c: c.aerodynamic, now, now.aerodynamic + residual_wrench)
    surfaces_slow = controller_state.surfaces_slow
    slow_wrench = airframe.aerodynamics(now.air_data, state.rates_b, surfaces_slow) + residual_wrench
    slow = eqx.tree_at(lambda c: c.aerodynamic, now, slow_wrench)
    motion = path_motion(now, slow.wrench.force_b, state.velocity_b, mass_properties.mass, gravity)
    moments = surface_moments(airframe, now, state.rates_b, state.surfaces)
    authority = surface_authority(airframe.actuators, mass_properties, moments, surfaces_slow)
    return OnboardModel(
        airframe, limits, state, now, slow, surfaces_slow, moments, authority, residual, motion, gravity, step
    )
