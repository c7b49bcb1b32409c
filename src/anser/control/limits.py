"""Envelope limits on the commands of the autopilot."""

import equinox as eqx
import jax.numpy as jnp

from anser.shapes import Scalar, ScalarLike, Vector3

NORMAL_TURNING_G = 0.5
"""Least acceleration normal to the path in a turn, in g: neither autopilot nor plans push over below this value."""


class FlightLimits(eqx.Module):
    """Flight envelope to which the autopilot limits its commands."""

    speed_min: Scalar  #: Least airspeed, m/s.
    speed_max: Scalar  #: Greatest airspeed, m/s.
    bank_max: Scalar  #: Greatest bank about the velocity vector, rad.
    alpha_min: Scalar  #: Least angle of attack, rad.
    alpha_max: Scalar  #: Greatest angle of attack, rad.
    load_factor_min: Scalar  #: Least load factor: lift over weight.
    load_factor_max: Scalar  #: Greatest load factor: lift over weight.
    rates_max: Vector3  #: Greatest body rates (P, Q, R), rad/s.
    #: Least altitude, m; the ground is at 0.
    altitude_min: Scalar = eqx.field(default_factory=lambda: jnp.asarray(0.0))
    bank_rate_max: Scalar | None = None  #: Greatest rate of the commanded bank angle, rad/s; None: no limit.


def default_limits(alpha_range: tuple[ScalarLike, ScalarLike] = (-jnp.inf, jnp.inf)) -> FlightLimits:
    """Return limits for the F-16 at low speed, with the angle of attack within `alpha_range`, rad.

    Airspeed 90 to 240 m/s, bank 60 deg, angle of attack -5 to 25 deg, load factor -1 to 5, body rates (P, Q, R) 120, 60
    and 60 deg/s, least altitude 0 m; the bank rate is not limited.
    """
    degree = jnp.pi / 180
    return FlightLimits(
        speed_min=jnp.asarray(90.0, dtype=float),
        speed_max=jnp.asarray(240.0, dtype=float),
        bank_max=jnp.asarray(60 * degree, dtype=float),
        alpha_min=jnp.clip(jnp.asarray(-5 * degree, dtype=float), *alpha_range),
        alpha_max=jnp.clip(jnp.asarray(25 * degree, dtype=float), *alpha_range),
        load_factor_min=jnp.asarray(-1.0, dtype=float),
        load_factor_max=jnp.asarray(5.0, dtype=float),
        rates_max=jnp.asarray([120.0, 60.0, 60.0]) * degree,
    )
