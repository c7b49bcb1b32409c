"""Envelope limits on the commands of the autopilot."""

import equinox as eqx
import jax.numpy as jnp

from anser.shapes import Scalar, Vector3


class FlightLimits(eqx.Module):
    """Envelope within which the autopilot limits its own commands.

    Attributes
    ----------
    speed_min, speed_max
        Airspeed, m/s.
    bank_max
        Greatest bank about the velocity vector, rad.
    alpha_min, alpha_max
        Angle of attack, rad.
    load_factor_min, load_factor_max
        Lift over weight.
    rates_max
        Greatest body rates (P, Q, R), rad/s.
    altitude_min
        Least altitude, m; the ground is at 0.
    bank_rate_max
        Greatest rate of the commanded bank angle, rad/s; None: no limit.
    """

    speed_min: Scalar
    speed_max: Scalar
    bank_max: Scalar
    alpha_min: Scalar
    alpha_max: Scalar
    load_factor_min: Scalar
    load_factor_max: Scalar
    rates_max: Vector3
    altitude_min: Scalar = eqx.field(default_factory=lambda: jnp.asarray(0.0))
    bank_rate_max: Scalar | None = None


def default_limits() -> FlightLimits:
    """Return limits for the F-16 at low speed: 90 to 240 m/s, 60 deg bank, alpha -5 to 25 deg, load factor -1 to 5."""
    degree = jnp.pi / 180
    return FlightLimits(
        speed_min=jnp.asarray(90.0, dtype=float),
        speed_max=jnp.asarray(240.0, dtype=float),
        bank_max=jnp.asarray(60 * degree, dtype=float),
        alpha_min=jnp.asarray(-5 * degree, dtype=float),
        alpha_max=jnp.asarray(25 * degree, dtype=float),
        load_factor_min=jnp.asarray(-1.0, dtype=float),
        load_factor_max=jnp.asarray(5.0, dtype=float),
        rates_max=jnp.asarray([120.0, 60.0, 60.0]) * degree,
    )
