"""Onboard model for dynamic inversion: motion along the path, forces, control authority, and residual of the model."""

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.air_data import Wrench
from anser.aircraft.airframe import AbstractAirframe, AircraftState
from anser.aircraft.motion import AirDataAndForces, angular_acceleration
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
    """Path and attitude angles of one aircraft, its airspeed, and their rates."""

    V: Scalar  # airspeed, m/s
    gamma: Scalar  # path angle through the air, rad
    chi: Scalar  # course through the air, rad
    mu: Scalar  # bank about the velocity vector, rad
    alpha: Scalar  # rad
    beta: Scalar  # rad
    force_rates: Vector3  # f in (mu_dot, alpha_dot, beta_dot) = f + G (P, Q, R): rates due to forces and gravity, rad/s
    rate_matrix: Matrix33  # G: change of (mu_dot, alpha_dot, beta_dot) per (P, Q, R)
    path_rates: Vector3  # (V_dot, gamma_dot, chi_dot) from the acceleration, m/s^2 and rad/s


def path_motion(
    condition: AirDataAndForces, slow_force_b: Vector3, velocity_b: Vector3, mass: ScalarLike, gravity: ScalarLike
) -> PathMotion:
    """Compute path and attitude angles and their rates by the wind-axis equations of theory section 2.

    `force_rates` follow from the non-gravitational force `slow_force_b` (N, see `OnboardModel`), path rates from the
    present force in `condition`. `velocity_b` is the velocity over the ground, body axes, m/s; `gravity` is positive,
    m/s^2. The equations are not valid in vertical flight or at a sideslip of 90 deg.
    """
    alpha, beta = condition.air_data.alpha, condition.air_data.beta
    velocity_air_n = rotate_back(condition.R_bn, velocity_b) - condition.wind_n
    mu = bank_about_velocity(condition.R_bn, alpha, beta)
    force_b = condition.wrench.force_b
    gravity_n = jnp.zeros_like(velocity_air_n).at[2].set(gravity)
    path = polar(velocity_air_n, rotate_back(condition.R_bn, force_b) / mass + gravity_n)
    gamma, chi = path.gamma, path.chi
    V = jnp.maximum(condition.air_data.V, 1.0)
    sa, ca, sb, cb = jnp.sin(alpha), jnp.cos(alpha), jnp.sin(beta), jnp.maximum(jnp.cos(beta), 0.05)
    s_mu, c_mu = jnp.sin(mu), jnp.cos(mu)
    cos_gamma = jnp.maximum(jnp.cos(gamma), 0.05)
    tb, t_gam = sb / cb, jnp.sin(gamma) / cos_gamma
    X, Y, Z = jnp.unstack(slow_force_b)
    mV = mass * V
    mu_force_rate = (
        -(gravity / V) * cos_gamma * c_mu * tb
        + (
            X * (sa * tb + sa * s_mu * t_gam - ca * sb * c_mu * t_gam)
            + Y * cb * c_mu * t_gam
            - Z * (ca * tb + ca * s_mu * t_gam + sa * sb * c_mu * t_gam)
        )
        / mV
    )
    alpha_force_rate = (Z * ca - X * sa) / (mV * cb) + gravity * cos_gamma * c_mu / (V * cb)
    beta_force_rate = (-X * ca * sb + Y * cb - Z * sa * sb) / mV + gravity * cos_gamma * s_mu / V
    zero, unity = jnp.zeros_like(sa), jnp.ones_like(sa)
    rate_matrix = jnp.stack(
        [
            jnp.stack([ca / cb, zero, sa / cb]),
            jnp.stack([-ca * tb, unity, -sa * tb]),
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
        force_rates=jnp.stack([mu_force_rate, alpha_force_rate, beta_force_rate]),
        rate_matrix=rate_matrix,
        path_rates=jnp.stack([path.V_dot, path.gamma_dot, path.chi_dot]),
    )


class OnboardModel(eqx.Module):
    """Onboard model at one instant, which the loops invert: forces, control effectiveness and motion along the path.

    The attitude and velocity loops use the forces of `slow_condition`: neglecting fast surface forces in the slow loops
    is the two-time-scale assumption of dynamic inversion. If these loops used `condition`, the lift of the moving
    elevator would return to the elevator through the feed-forward with a loop gain above one (a limit cycle at the rate
    limit).
    """

    airframe: AbstractAirframe
    limits: FlightLimits
    state: AircraftState
    condition: AirDataAndForces  # forces of the airframe's model at the present deflections, plus `residual`
    slow_condition: AirDataAndForces  # `condition` with the forces at the deflections `surfaces_slow`
    surfaces_slow: Vector  # low-pass filtered deflections, rad
    moments: SurfaceMoments  # aerodynamic moment and control effectiveness at the present deflections
    authority: Authority
    residual: ModelResidual  # 0 if the inversion is model-based
    motion: PathMotion
    gravity: ScalarLike  # m/s^2
    step: ScalarLike  # sampling period, s


def onboard_model(
    belief: Belief, limits: FlightLimits, gains: AutopilotGains, controller_state: AutopilotState, step: ScalarLike
) -> OnboardModel:
    """Evaluate the onboard model at the estimated state in `belief`; advance the residual by one period `step` (s)."""
    airframe = belief.airframe
    state = belief.state
    condition = belief.condition
    gravity = belief.condition.earth.gravity
    mass_properties = airframe.mass_properties
    residual = controller_state.residual.advance(
        mass_properties.mass * belief.specific_force_b - condition.wrench.force_b,
        state.rates_b,
        angular_acceleration(mass_properties, state.rates_b, condition.wrench.moment_b),
        gains.sensor_bandwidth,
        step,
        is_held=airframe.actuators.is_held,
    )
    residual_wrench = Wrench(residual.force_b, times3(mass_properties.inertia_b, residual.acceleration_b))
    condition = eqx.tree_at(lambda c: c.aerodynamic, condition, condition.aerodynamic + residual_wrench)
    surfaces_slow = controller_state.surfaces_slow
    slow_wrench = airframe.aerodynamics(condition.air_data, state.rates_b, surfaces_slow) + residual_wrench
    slow_condition = eqx.tree_at(lambda c: c.aerodynamic, condition, slow_wrench)
    motion = path_motion(condition, slow_condition.wrench.force_b, state.velocity_b, mass_properties.mass, gravity)
    moments = surface_moments(airframe, condition, state.rates_b, state.surfaces)
    authority = surface_authority(airframe.actuators, mass_properties, moments, surfaces_slow)
    forces = slow_condition, surfaces_slow, moments, authority, residual
    return OnboardModel(airframe, limits, state, condition, *forces, motion, gravity, step)
