"""Actuators of control surfaces: first or second order, with position and rate limits."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.air_data import AirData
from anser.shapes import Vector
from anser.variables import STANDARD_SURFACES


class AbstractActuators(eqx.Module):
    """Actuators of any number of control surfaces; what they carry along is their own, but for its `position`.

    Attributes
    ----------
    time_constant
        Lag from command to position that a controller may invert, s, shape (surfaces,).
    lower, upper
        Position limits, rad, shape (surfaces,).
    rate_limit
        rad/s, shape (surfaces,).
    names
        Of the surfaces, unique.
    """

    time_constant: eqx.AbstractVar[Vector]
    lower: eqx.AbstractVar[Vector]
    upper: eqx.AbstractVar[Vector]
    rate_limit: eqx.AbstractVar[Vector]
    names: eqx.AbstractVar[tuple[str, ...]]

    @abc.abstractmethod
    def steady_state(self, position: Vector) -> Any:
        """State of actuators at rest at a position (rad); has an attribute `position`."""

    @abc.abstractmethod
    def rate(self, state: Any, command: Vector, air_data: AirData) -> Any:
        """Time derivative of the state under a command (rad), as a state of derivatives."""

    def scheduled_position(self, position: Vector, air_data: AirData) -> Vector:
        """Steady positions (rad) where surfaces that no controller commands stand as the flow has them."""
        return position

    def steady_state_in_flow(self, position: Vector, air_data: AirData) -> Any:
        """State of actuators at rest in a steady flow, scheduled surfaces where the flow has them."""
        return self.steady_state(self.scheduled_position(position, air_data))

    @property
    def is_commanded(self) -> tuple[bool, ...]:
        """Whether a controller commands each surface; the others move by schedules of their own."""
        return (True,) * len(self.names)

    @property
    def controls_yaw(self) -> bool:
        """Whether the commanded surfaces turn the aircraft about three axes, yaw among them."""
        return sum(self.is_commanded) >= len(STANDARD_SURFACES)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the elements of the state, in the order of its leaves."""
        return self.names

    def limit_command(self, command: Vector) -> Vector:
        """Command within the position limits, rad."""
        return jnp.clip(command, self.lower, self.upper)

    def command_for_rate(self, position: Vector, rate: Vector) -> Vector:
        """Command (rad, within the position limits) whose lag moves the surfaces at a wanted rate (rad/s)."""
        return self.limit_command(position + self.time_constant * rate)


class Deflections(eqx.Module):
    """State of first-order actuators: `position`, rad, shape (surfaces,)."""

    position: Vector


class FirstOrderActuators(AbstractActuators):
    """Each surface follows its command with a first-order lag."""

    time_constant: Vector
    lower: Vector
    upper: Vector
    rate_limit: Vector
    names: tuple[str, ...] = eqx.field(static=True, default=STANDARD_SURFACES)

    def steady_state(self, position: Vector) -> Deflections:
        """At rest: the position alone."""
        return Deflections(jnp.asarray(position))

    def rate(self, state: Deflections, command: Vector, air_data: AirData) -> Deflections:
        """(limited command - position) / time constant, within the rate limits."""
        wanted = (self.limit_command(command) - state.position) / self.time_constant
        return Deflections(jnp.clip(wanted, -self.rate_limit, self.rate_limit))


class MovingDeflections(eqx.Module):
    """State of second-order actuators: `position` (rad) and `velocity` (rad/s), shape (surfaces,) each."""

    position: Vector
    velocity: Vector


class SecondOrderActuators(AbstractActuators):
    """Each surface follows its command as a damped oscillator whose speed is limited.

    Attributes
    ----------
    frequency
        Undamped natural frequency, rad/s, shape (surfaces,).
    damping
        Damping ratio, shape (surfaces,).
    """

    frequency: Vector
    damping: Vector
    lower: Vector
    upper: Vector
    rate_limit: Vector
    names: tuple[str, ...] = eqx.field(static=True, default=STANDARD_SURFACES)

    @property
    def time_constant(self) -> Float[Array, " surfaces"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Lag of slow motion: 2 damping / frequency, s."""
        return 2.0 * self.damping / self.frequency

    @property
    def state_names(self) -> tuple[str, ...]:
        """Positions, then velocities."""
        return (*self.names, *(f"{name}_velocity" for name in self.names))

    def steady_state(self, position: Vector) -> MovingDeflections:
        """At rest: no velocity."""
        position = jnp.asarray(position)
        return MovingDeflections(position, jnp.zeros_like(position))

    def rate(self, state: MovingDeflections, command: Vector, air_data: AirData) -> MovingDeflections:
        """X'' = w^2 (limited command - x) - 2 z w x', with x' held within the rate limit."""
        w = self.frequency
        pulled = w * w * (self.limit_command(command) - state.position) - 2.0 * self.damping * w * state.velocity
        moving = jnp.clip(state.velocity, -self.rate_limit, self.rate_limit)
        # at the limit nothing accelerates further, and what lies beyond by a step of the integrator comes back
        back = (moving - state.velocity) * w
        acceleration = jnp.where(
            state.velocity >= self.rate_limit,
            jnp.minimum(pulled, back),
            jnp.where(state.velocity <= -self.rate_limit, jnp.maximum(pulled, back), pulled),
        )
        return MovingDeflections(moving, acceleration)
