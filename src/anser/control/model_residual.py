"""Measured less modelled forces and accelerations: the incremental form of dynamic inversion.

Model-based inversion solves y_dot(x, u) = nu on the model. The incremental form takes the measured rate as the base and
the model for the change alone: u = u_0 + (d y_dot/d u)^-1 (nu - y_dot measured), all filtered alike. Both are one law
on the model plus a term, the residual: measured minus modelled forces and angular accelerations. With the term held at
zero the law is model-based; with the term following the filtered measurements it is incremental, because what the model
says of the present state cancels and only its slopes are left. Source: S. Sieberling, Q. P. Chu, J. A. Mulder, *J.
Guidance* 33(6), 2010; the common filter of surfaces and accelerations after E. J. J. Smeur, Q. P. Chu, G. C. H. E. de
Croon, *J. Guidance* 39(3), 2016.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.shapes import ScalarLike, Vector3


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

    def advanced(
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
