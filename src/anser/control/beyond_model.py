"""What the sensors say beyond the model: the incremental form of dynamic inversion.

Model-based inversion solves y_dot(x, u) = nu on the model. The incremental form takes the measured rate as the base and
the model for the change alone: u = u_0 + (d y_dot/d u)^-1 (nu - y_dot measured), all filtered alike. Both are one law
on the model plus a term: its forces and angular accelerations are those of the model plus what was measured beyond
them. With the term held at zero the law is model-based; with the term following the filtered measurements it is
incremental, because what the model says of the present state cancels and only its slopes are left. Source: S.
Sieberling, Q. P. Chu, J. A. Mulder, *J. Guidance* 33(6), 2010; the common filter of surfaces and accelerations after
E. J. J. Smeur, Q. P. Chu, G. C. H. E. de Croon, *J. Guidance* 39(3), 2016.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.shapes import ScalarLike, Vector3


class BeyondModel(eqx.Module):
    """Memory of the sensors, and what they say beyond the model, low-passed.

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
        force_beyond_b: Vector3,
        rates_b: Vector3,
        model_acceleration_b: Vector3,
        bandwidth: ScalarLike,
        step: ScalarLike,
    ) -> "BeyondModel":
        """Take in a new sample.

        Angular acceleration is what the gyros gained since the last sample; it is compared with the mean of what the
        model said at both ends, so that on a perfect model nothing is left.

        Parameters
        ----------
        force_beyond_b
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
        beyond = gained - 0.5 * (self.model_acceleration_b + model_acceleration_b)
        return BeyondModel(
            force_b=self.force_b + fade * (force_beyond_b - self.force_b),
            acceleration_b=self.acceleration_b + fade * (beyond - self.acceleration_b),
            rates_b=rates_b,
            model_acceleration_b=model_acceleration_b,
        )


def nothing_beyond(rates_b: Vector3) -> BeyondModel:
    """Memory of sensors that have seen steady rates and a perfect model."""
    zero = jnp.zeros(3)
    return BeyondModel(zero, zero, rates_b, zero)
