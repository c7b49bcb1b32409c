"""How the velocity vector and the attitude about it move: the plant that the two outer loops invert."""

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft import Condition
from anser.planning import polar
from anser.shapes import Matrix33, Scalar, ScalarLike, Vector3
from anser.spatial import bank_about_velocity, rotate_back


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
    now: Condition, slow_force_b: Vector3, velocity_b: Vector3, mass: ScalarLike, gravity: ScalarLike
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
