"""State of the autopilot between samples: integrals, filters and the residual of the onboard model."""

import equinox as eqx
import jax.numpy as jnp

from anser.control.feedback import Differentiator
from anser.control.limits import FlightLimits
from anser.shapes import Scalar, ScalarLike, Vector, Vector3


class ModelResidual(eqx.Module):
    """Measured minus modelled force and angular acceleration, low-pass filtered, body axes."""

    force_b: Vector3  # mass times measured specific force, minus modelled force without gravity, N
    acceleration_b: Vector3  # measured minus modelled angular acceleration, rad/s^2
    rates_b: Vector3  # gyro reading at the previous sample, rad/s
    model_acceleration_b: Vector3  # modelled angular acceleration at the previous sample, rad/s^2

    def advance(
        self,
        force_residual_b: Vector3,  # measured minus modelled force at the new sample (3,), N
        rates_b: Vector3,  # gyro reading (3,), rad/s
        model_acceleration_b: Vector3,  # modelled angular acceleration at the new sample (3,), rad/s^2
        bandwidth: ScalarLike,  # of the residual's low-pass filter, rad/s; 0 (model-based inversion): no change
        step: ScalarLike,  # sampling period, s
        *,
        is_held: bool = False,  # whether the surfaces had the new sample's deflections during the whole period
    ) -> "ModelResidual":
        """Return the residual after the sampling period that ends with a new sample."""
        fade = -jnp.expm1(-bandwidth * step)
        measured_acceleration = (rates_b - self.rates_b) / step
        # Over the period, a perfect model has the mean of both samples; held surfaces have acted as in the new sample.
        mean_b = 0.5 * (self.model_acceleration_b + model_acceleration_b)
        residual = measured_acceleration - (model_acceleration_b if is_held else mean_b)
        return ModelResidual(
            force_b=self.force_b + fade * (force_residual_b - self.force_b),
            acceleration_b=self.acceleration_b + fade * (residual - self.acceleration_b),
            rates_b=rates_b,
            model_acceleration_b=model_acceleration_b,
        )


def no_residual(rates_b: Vector3) -> ModelResidual:
    """Return the residual at the start: force and accelerations 0, previous gyro reading `rates_b` (rad/s)."""
    zero = jnp.zeros(3)
    return ModelResidual(zero, zero, rates_b, zero)


class AutopilotState(eqx.Module):
    """State of one autopilot between samples."""

    velocity_integral: Vector3  # time integral of the error in (V, gamma, chi), m and rad s
    attitude_integral: Vector3  # time integral of the error in (mu, alpha, beta), rad s
    rates_integral: Vector3  # time integral of the error in (P, Q, R), rad
    attitude_filter: Differentiator  # differentiates the command to the attitude loop
    rates_filter: Differentiator  # differentiates the command to the rate loop
    surfaces_filter: Differentiator  # differentiates the deflections that the rate loop demands
    surfaces_slow: Vector  # low-pass filtered deflections, rad
    residual: ModelResidual  # measured minus modelled forces and accelerations
    bank_command: Scalar | None = None  # previous commanded bank angle, rad; None: the bank rate is not limited


def initial_autopilot_state(
    attitude: Vector3, rates_b: Vector3, surfaces: Vector, limits: FlightLimits | None = None
) -> AutopilotState:
    """Return the state of an autopilot after a long time in steady flight, with zero integrals.

    `attitude` is (mu, alpha, beta), rad; `rates_b` is (P, Q, R), rad/s; `surfaces` are the deflections, rad. If
    `limits` is None, the rate of the commanded bank angle is not limited.
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
