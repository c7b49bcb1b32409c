"""Linear part of the loops: virtual control from the error, its integral and derivative, and a feed-forward."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from anser.control.gains import LoopGains
from anser.shapes import Flag, ScalarLike, Vector, Vector3


class Differentiator(eqx.Module):
    """First-order filter x_dot = N (r - x) that estimates the rate of a command r; N is the bandwidth, rad/s.

    Each step is exact if r is constant over the step.
    """

    state: Vector  # x, one value per channel, in the unit of r

    def rate(self, reference: Vector, bandwidth: ScalarLike, step: ScalarLike) -> Vector:
        """Estimate the rate of the reference r (unit per s): the mean of x_dot over the coming step."""
        return -jnp.expm1(-bandwidth * step) / step * (reference - self.state)

    def limited_rate(self, reference: Vector, bandwidth: ScalarLike, step: ScalarLike, acceleration: Vector) -> Vector:
        """Estimate the rate of the reference (unit per s), limited to `acceleration` / `bandwidth` in both directions.

        `acceleration` is the greatest acceleration of the loop that follows the reference, unit per s^2.
        """
        # A command with rate r may stop within the filter's time constant 1/N: the loop then needs r N.
        rate_max = acceleration / bandwidth
        return jnp.clip(self.rate(reference, bandwidth, step), -rate_max, rate_max)

    def advance(self, reference: Vector, bandwidth: ScalarLike, step: ScalarLike) -> "Differentiator":
        """Return the filter after one step (s) with constant `reference`."""
        return Differentiator(self.state + step * self.rate(reference, bandwidth, step))


def wrap_angle(angle: Vector3 | ScalarLike) -> Array:
    """Wrap an angle difference (rad), a scalar or (3,), to -pi..pi; smooth except at -pi and pi."""
    return angle - 2 * jnp.pi * jnp.round(angle / (2 * jnp.pi))


def virtual_control(
    gains: LoopGains,
    error: Vector3,  # r - y, shape (3,), angles wrapped
    integral: Vector3,  # time integral of the error, shape (3,)
    # rates of the reference and of the output; only the derivative term uses the output's rate
    reference_rate: Vector3,
    measured_rate: Vector3 | ScalarLike,
) -> Vector3:
    """Compute the virtual control nu of a loop: the demanded rate of the output y, in units of the output per second.

    nu = K_FF r_dot + K_P e + K_I integral(e) + K_D (r_dot - y_dot), with the reference r and the error e = r - y
    (theory section 5; sign as in section 9, item 4).
    """
    return (
        gains.feed_forward * reference_rate
        + gains.proportional * error
        + gains.integral * integral
        + gains.derivative * (reference_rate - measured_rate)
    )


def limit_to_braking(
    gains: LoopGains,
    error: Vector3,  # r - y, shape (3,)
    acceleration: Vector3,  # L, shape (3,), units of the error per s^2, above 0
) -> Vector3:
    """Return the error, limited so that the loop approaches the reference no faster than `acceleration` can brake.

    The linear loop e_dot = -K e, K = K_P / (1 + K_D), needs the acceleration K^2 e, which exceeds L if |e| > L / K^2.
    For a larger error, |e_dot| is limited to sqrt(2 L (|e| - L / (2 K^2))), which joins K |e| smoothly. This is
    time-optimal braking with bounded acceleration (A. E. Bryson, Y.-C. Ho, *Applied Optimal Control*, 1975). If the
    error were not limited, large commands would drive the surfaces into a limit cycle between the stops.
    """
    bandwidth = jnp.maximum(gains.proportional / (1 + gains.derivative), 1e-6)
    linear_error_max = acceleration / bandwidth**2
    magnitude = jnp.abs(error)
    outer_magnitude = jnp.maximum(magnitude, linear_error_max)  # keeps the root real in the unused branch
    return jnp.where(
        magnitude <= linear_error_max,
        error,
        jnp.sign(error) * jnp.sqrt(linear_error_max * (2 * outer_magnitude - linear_error_max)),
    )


def advance_integral(
    integral: Vector3, error: Vector3, saturated: Flag | Bool[Array, "3"], step: ScalarLike
) -> Vector3:
    """Return the time integral of the error after one step (s); saturated channels keep their value (anti-windup)."""
    return jnp.where(saturated, integral, integral + step * error)
