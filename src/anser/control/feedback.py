"""The linear part of each loop: virtual control from the error, its integral and derivative, and a feed-forward."""

import equinox as eqx
import jax.numpy as jnp

from anser.control.gains import LoopGains
from anser.shapes import Flag, ScalarLike, Vector, Vector3


class Differentiator(eqx.Module):
    """State of a filter that yields the rate of a command: x_dot = N (r - x), exact for an r held over each step.

    Attributes
    ----------
    memory
        x, one for each channel.
    """

    state: Vector

    def rate(self, reference: Vector, bandwidth: ScalarLike, step: ScalarLike) -> Vector:
        """Rate of the reference: the mean of x_dot over the coming step, so that a ramp's rate has no bias."""
        return -jnp.expm1(-bandwidth * step) / step * (reference - self.state)

    def limited_rate(self, reference: Vector, bandwidth: ScalarLike, step: ScalarLike, acceleration: Vector) -> Vector:
        """Rate of the reference as far as a loop can follow it: no more than acceleration / bandwidth.

        A command that moves at a rate r and may stop within the filter's time asks for accelerations of r N.
        """
        most = acceleration / bandwidth
        return jnp.clip(self.rate(reference, bandwidth, step), -most, most)

    def advance(self, reference: Vector, bandwidth: ScalarLike, step: ScalarLike) -> "Differentiator":
        """State one step later, for a reference held over the step."""
        return Differentiator(self.state + step * self.rate(reference, bandwidth, step))


def wrap_angle(angle: Vector3 | ScalarLike) -> Vector3:
    """Angle difference wrapped to -pi..pi, rad; smooth but at the cut itself."""
    return angle - 2 * jnp.pi * jnp.round(angle / (2 * jnp.pi))


def virtual_control(
    gains: LoopGains, error: Vector3, integral: Vector3, reference_rate: Vector3, measured_rate: Vector3 | ScalarLike
) -> Vector3:
    """Nu = K_FF r_dot + K_P e + K_I integral(e) + K_D (r_dot - y_dot) (theory section 5; sign per section 9 no. 4).

    Parameters
    ----------
    gains
        Of this loop.
    error
        r - y, shape (3,), angles already wrapped.
    integral
        Time integral of the error.
    reference_rate, measured_rate
        Rates of the reference and of the output; the latter is used by the derivative term alone.
    """
    return (
        gains.feed_forward * reference_rate
        + gains.proportional * error
        + gains.integral * integral
        + gains.derivative * (reference_rate - measured_rate)
    )


def limit_to_braking(gains: LoopGains, error: Vector3, acceleration: Vector3) -> Vector3:
    """Error as far as a loop may work on it whose output can be accelerated by no more than `acceleration`.

    By itself the loop e_dot = -K e, K = K_P / (1 + K_D), comes to rest with e_ddot = K^2 e. Beyond |e| = L / K^2 that
    is more than the acceleration L: there e_dot is held to what L can brake, sqrt(2 L (|e| - L / 2K^2)), which joins
    K e smoothly: the stop under bounded acceleration of time-optimal control (A. E. Bryson, Y.-C. Ho, *Applied Optimal
    Control*, 1975). Without it large commands drive the surfaces into a limit cycle between their stops.

    Parameters
    ----------
    gains
        Of this loop.
    error
        r - y, shape (3,).
    acceleration
        L, shape (3,), units of the error per s^2, above 0.
    """
    bandwidth = jnp.maximum(gains.proportional / (1 + gains.derivative), 1e-6)
    edge = acceleration / bandwidth**2
    amount = jnp.abs(error)
    far = jnp.maximum(amount, edge)  # keeps the root away from the branch that is not taken
    return jnp.where(amount <= edge, error, jnp.sign(error) * jnp.sqrt(edge * (2 * far - edge)))


def advance_integral(integral: Vector3, error: Vector3, saturated: Flag | Vector3, step: ScalarLike) -> Vector3:
    """Integral one step later; a channel whose actuator or command is saturated stands still (anti-windup)."""
    return jnp.where(saturated, integral, integral + step * error)
