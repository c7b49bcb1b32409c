"""What is kept of one flight of a survey, built up sample by sample."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.units import DEG_RAD

AUTOPILOT_LIMITS = (
    "thrust_max",
    "thrust_idle",
    "alpha",
    "load_factor",
    "unloading",
    "bank",
    "body_rates",
    "surfaces",
    "surface_rates",
)
"""Limits at which a command of the autopilot may stand; `unloading` is the lift withheld while the bank is 60 deg off,
`surfaces` and `surface_rates` are the stops and the rate limits of the actuators."""
TABLE_AXES = ("alpha", "beta", "altitude", "mach")
"""Arguments of the airframe's data."""

BETA_BOUND = 2.0 * DEG_RAD
"""Sideslip (rad) that a flight should not pass."""


class FlightSummary(eqx.Module):
    """What is kept of one flight. Channels are (V, gamma, chi), m/s and rad; surfaces elevator, aileron, rudder.

    Attributes
    ----------
    final_error, final_error_max
        Command minus output over the last tenth of the flight: mean, and largest amount.
    settling_time
        From the step until the error stays within the tolerance, s; infinite where it does not before the end.
    overshoot
        Beyond the command, part of the step; 0 for channels without a step.
    coupling
        Largest error of the channels without a step; 0 for the others.
    beta_max
        Largest amount of sideslip, rad.
    alpha_min, alpha_max
        rad.
    load_factor_min, load_factor_max
        Minus body z force over weight.
    surface_share
        Largest part of the way from the middle to the stop that each surface went.
    surface_rate_share, body_rate_share
        Largest rate of each surface over the actuator's limit; largest (P, Q, R) over the autopilot's.
    limited_time, limited_late
        Time at each of `AUTOPILOT_LIMITS`, s: in the whole flight, and in its last tenth.
    limited_before_slip
        The same until sideslip first passes `BETA_BOUND`.
    left_time
        First time outside the airframe's data along each of `TABLE_AXES`, s; infinite if never.
    finite
        Whether the state at the end is a number throughout.
    """

    final_error: Vector3
    final_error_max: Vector3
    settling_time: Vector3
    overshoot: Vector3
    coupling: Vector3
    beta_max: Scalar
    alpha_min: Scalar
    alpha_max: Scalar
    load_factor_min: Scalar
    load_factor_max: Scalar
    surface_share: Vector
    surface_rate_share: Vector
    body_rate_share: Vector3
    limited_time: Float[Array, "9"]
    limited_late: Float[Array, "9"]
    limited_before_slip: Float[Array, "9"]
    left_time: Float[Array, "4"]
    finite: Flag


class Sample(NamedTuple):
    """What the summary takes of one instant."""

    time: ScalarLike
    error: Vector3
    alpha: ScalarLike
    beta: ScalarLike
    load_factor: ScalarLike
    surface_share: Vector
    surface_rate_share: Vector
    body_rate_share: Vector3
    limited: Bool[Array, "9"]
    outside: Bool[Array, "4"]


def nothing_yet(surfaces: int) -> FlightSummary:
    """Summary of no sample of an aircraft with so many surfaces."""
    none, least, most = jnp.zeros(3), jnp.asarray(jnp.inf), jnp.asarray(-jnp.inf)
    return FlightSummary(
        final_error=none,
        final_error_max=none,
        settling_time=none,
        overshoot=none,
        coupling=none,
        beta_max=jnp.zeros(()),
        alpha_min=least,
        alpha_max=most,
        load_factor_min=least,
        load_factor_max=most,
        surface_share=jnp.zeros(surfaces),
        surface_rate_share=jnp.zeros(surfaces),
        body_rate_share=none,
        limited_time=jnp.zeros(len(AUTOPILOT_LIMITS)),
        limited_late=jnp.zeros(len(AUTOPILOT_LIMITS)),
        limited_before_slip=jnp.zeros(len(AUTOPILOT_LIMITS)),
        left_time=jnp.full(len(TABLE_AXES), jnp.inf),
        finite=jnp.asarray(True),
    )


def including(
    before: FlightSummary, now: Sample, size: Vector3, tolerance: Vector3, step: ScalarLike, late: Flag
) -> FlightSummary:
    """Summary with one more sample; until the end `final_error` is a sum and `settling_time` the last time outside."""
    stepped = size != 0.0
    amount = jnp.abs(now.error)
    beyond = jnp.where(stepped, -now.error / jnp.where(stepped, size, 1.0), 0.0)
    left = jnp.where(now.outside, now.time, jnp.inf)
    return FlightSummary(
        final_error=before.final_error + jnp.where(late, now.error, 0.0),
        final_error_max=jnp.where(late, jnp.maximum(before.final_error_max, amount), before.final_error_max),
        settling_time=jnp.where(amount > tolerance, now.time, before.settling_time),
        overshoot=jnp.maximum(before.overshoot, beyond),
        coupling=jnp.maximum(before.coupling, jnp.where(stepped, 0.0, amount)),
        beta_max=jnp.maximum(before.beta_max, jnp.abs(now.beta)),
        alpha_min=jnp.minimum(before.alpha_min, now.alpha),
        alpha_max=jnp.maximum(before.alpha_max, now.alpha),
        load_factor_min=jnp.minimum(before.load_factor_min, now.load_factor),
        load_factor_max=jnp.maximum(before.load_factor_max, now.load_factor),
        surface_share=jnp.maximum(before.surface_share, now.surface_share),
        surface_rate_share=jnp.maximum(before.surface_rate_share, now.surface_rate_share),
        body_rate_share=jnp.maximum(before.body_rate_share, now.body_rate_share),
        limited_time=before.limited_time + jnp.where(now.limited, step, 0.0),
        limited_late=before.limited_late + jnp.where(now.limited & late, step, 0.0),
        limited_before_slip=before.limited_before_slip
        + jnp.where(now.limited & (before.beta_max <= BETA_BOUND), step, 0.0),
        left_time=jnp.minimum(before.left_time, left),
        finite=before.finite,
    )
