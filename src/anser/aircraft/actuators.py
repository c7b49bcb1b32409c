"""Control surface actuators: first order with position and rate limits."""

import equinox as eqx
import jax.numpy as jnp

from anser.shapes import Vector3


class Actuators(eqx.Module):
    """Three actuators in the order elevator, aileron, rudder.

    Attributes
    ----------
    time_constant
        s, shape (3,).
    lower, upper
        Position limits, rad, shape (3,).
    rate_limit
        rad/s, shape (3,).
    """

    time_constant: Vector3
    lower: Vector3
    upper: Vector3
    rate_limit: Vector3

    def limited(self, command: Vector3) -> Vector3:
        """Command within the position limits, rad."""
        return jnp.clip(command, self.lower, self.upper)

    def rate(self, position: Vector3, command: Vector3) -> Vector3:
        """Rate of the surfaces, rad/s: (limited command - position) / time constant, within the rate limits."""
        wanted = (self.limited(command) - position) / self.time_constant
        return jnp.clip(wanted, -self.rate_limit, self.rate_limit)

    def command_for_rate(self, position: Vector3, rate: Vector3) -> Vector3:
        """Command (rad, within the position limits) whose lag moves the surfaces at a wanted rate (rad/s)."""
        return self.limited(position + self.time_constant * rate)
