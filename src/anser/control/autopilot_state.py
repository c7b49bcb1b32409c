"""State of the autopilot between samples: integrals, filters and the estimate of what the onboard model leaves out."""

import equinox as eqx
import jax.numpy as jnp

from anser.control.feedback import Differentiator
from anser.control.limits import FlightLimits
from anser.shapes import Scalar, ScalarLike, Vector, Vector3


class ModelResidual(eqx.Module):
    """Residual of the model against the sensors, low-passed, and the last sample.

    Attributes
    ----------
    force_b
        Specific force times mass that the model lacks, N.
    acceleration_b
        Angular acceleration that the model lacks, rad/s^2.
    rates_b
        Gyro's reading at the last sample, rad/s.
    model_acceleration_b
        Angular acceleration of the model then, rad/s^2.
    """

    force_b: Vector3
    acceleration_b: Vector3
    rates_b: Vector3
    model_acceleration_b: Vector3

    def advance(
        self,
        force_residual_b: Vector3,
        rates_b: Vector3,
        model_acceleration_b: Vector3,
        bandwidth: ScalarLike,
        step: ScalarLike,
    ) -> "ModelResidual":
        """Take in a new sample.

        Angular acceleration is what the gyros gained since the last sample; it is compared with the mean of what the
        model said at both ends, so that on a perfect model nothing is left.

        Parameters
        ----------
        force_residual_b
            Measured minus modelled force at this sample (3,), N.
        rates_b
            Gyro's reading (3,), rad/s.
        model_acceleration_b
            Angular acceleration of the model at this sample (3,), rad/s^2.
        bandwidth
            Of the low-pass filter, rad/s; 0 takes nothing in: model-based inversion.
        step
            Sampling period, s.
        """
        fade = -jnp.expm1(-bandwidth * step)
        gained = (rates_b - self.rates_b) / step
        residual = gained - 0.5 * (self.model_acceleration_b + model_acceleration_b)
        return ModelResidual(
            force_b=self.force_b + fade * (force_residual_b - self.force_b),
            acceleration_b=self.acceleration_b + fade * (residual - self.acceleration_b),
            rates_b=rates_b,
            model_acceleration_b=model_acceleration_b,
        )


def no_residual(rates_b: Vector3) -> ModelResidual:
    """Residual of a perfect model after steady rates."""
    zero = jnp.zeros(3)
    return ModelResidual(zero, zero, rates_b, zero)


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
