"""Memory of one autopilot: what it carries from one sample to the next."""

import equinox as eqx
import jax.numpy as jnp

from anser.control.feedback import Differentiator
from anser.control.limits import FlightLimits
from anser.control.model_residual import ModelResidual, no_residual
from anser.shapes import Scalar, Vector, Vector3


class AutopilotState(eqx.Module):
    """Memory of one autopilot: the loops' integrals and the filters that differentiate inner commands.

    Attributes
    ----------
    velocity_integral, attitude_integral, rates_integral
        Time integrals of the errors in (V, gamma, chi), (mu, alpha, beta) and (P, Q, R).
    attitude_filter, rates_filter
        Filters on the commands that the outer loops pass inwards.
    surfaces_filter
        Filter on the deflections that the fast loop wants.
    surfaces_slow
        Deflections through a low-pass filter, rad.
    residual
        Measured less modelled forces and accelerations.
    bank_command
        The last bank angle commanded, rad; None where the limits leave its rate free.
    """

    velocity_integral: Vector3
    attitude_integral: Vector3
    rates_integral: Vector3
    attitude_filter: Differentiator
    rates_filter: Differentiator
    surfaces_filter: Differentiator
    surfaces_slow: Vector
    residual: ModelResidual
    bank_command: Scalar | None = None


def initial_autopilot_state(
    attitude: Vector3, rates_b: Vector3, surfaces: Vector, limits: FlightLimits | None = None
) -> AutopilotState:
    """Memory of an autopilot that has been holding the given (mu, alpha, beta), (P, Q, R) and surfaces.

    `limits` are those it flies with; None: any that leave the rate of the bank angle free.
    """
    zero = jnp.zeros(3)
    return AutopilotState(
        zero,
        zero,
        zero,
        Differentiator(attitude),
        Differentiator(rates_b),
        Differentiator(surfaces),
        surfaces,
        no_residual(rates_b),
        None if limits is None or limits.bank_rate_max is None else attitude[0],
    )
