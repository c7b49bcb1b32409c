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
    """Actuators of any number of control surfaces; the state is specific to the class, but has an attribute `position`.

    Attributes
    ----------
    time_constant
        Lag from command to position, for inversion by a controller, s, shape (surfaces,).
    lower, upper
        Position limits, rad, shape (surfaces,).
    rate_limit
        rad/s, shape (surfaces,).
    names
        Distinct names of the surfaces.
    """

    time_constant: eqx.AbstractVar[Vector]
    lower: eqx.AbstractVar[Vector]
    upper: eqx.AbstractVar[Vector]
    rate_limit: eqx.AbstractVar[Vector]
    names: eqx.AbstractVar[tuple[str, ...]]

    @abc.abstractmethod
    def steady_state(self, position: Vector) -> Any:
        """State at rest at a position (rad)."""

    @abc.abstractmethod
    def rate(self, state: Any, command: Vector, air_data: AirData) -> Any:
        """Time derivative of the state for a command (rad), in the state's structure."""

    def scheduled_position(self, position: Vector, air_data: AirData) -> Vector:
        """Replace the positions (rad) of scheduled surfaces, without command, by the steady values for the air data."""
        return position

    def steady_state_in_flow(self, position: Vector, air_data: AirData) -> Any:
        """State at rest in a steady flow, with scheduled surfaces at the values for the air data."""
        return self.steady_state(self.scheduled_position(position, air_data))

    @property
    def is_commanded(self) -> tuple[bool, ...]:
        """Whether each surface is commanded by the controller; the remaining surfaces follow a schedule."""
        return (True,) * len(self.names)

    @property
    def controls_yaw(self) -> bool:
        """Whether there are enough commanded surfaces to control roll, pitch and yaw."""
        return sum(self.is_commanded) >= len(STANDARD_SURFACES)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the state's elements, in leaf order."""
        return self.names

    def limit_command(self, command: Vector) -> Vector:
        """Command within the position limits, rad."""
        return jnp.clip(command, self.lower, self.upper)

    def command_for_rate(self, position: Vector, rate: Vector) -> Vector:
        """Command (rad, within the position limits) for a required surface rate (rad/s): the inverse of the lag."""
        return self.limit_command(position + self.time_constant * rate)


class Deflections(eqx.Module):
    """State of first-order actuators: `position`, rad, shape (surfaces,)."""

    position: Vector


class FirstOrderActuators(AbstractActuators):
    """Actuators with a first-order lag from command to position."""

    time_constant: Vector
    lower: Vector
    upper: Vector
    rate_limit: Vector
    names: tuple[str, ...] = eqx.field(static=True, default=STANDARD_SURFACES)

    def steady_state(self, position: Vector) -> Deflections:
        """State at rest: the position alone."""
        return Deflections(jnp.asarray(position))

    def rate(self, state: Deflections, command: Vector, air_data: AirData) -> Deflections:
        """Rate of the position: (limited command - position) / time constant, within the rate limits."""
        unlimited_rate = (self.limit_command(command) - state.position) / self.time_constant
        return Deflections(jnp.clip(unlimited_rate, -self.rate_limit, self.rate_limit))


class MovingDeflections(eqx.Module):
    """State of second-order actuators: `position` (rad) and `velocity` (rad/s), both of shape (surfaces,)."""

    position: Vector
    velocity: Vector


class SecondOrderActuators(AbstractActuators):
    """Actuators with second-order dynamics and limited speed.

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
        """Lag in slow motion: 2 damping / frequency, s."""
        return 2.0 * self.damping / self.frequency

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the positions, then of the velocities."""
        return (*self.names, *(f"{name}_velocity" for name in self.names))

    def steady_state(self, position: Vector) -> MovingDeflections:
        """State at rest: zero velocity."""
        position = jnp.asarray(position)
        return MovingDeflections(position, jnp.zeros_like(position))

    def rate(self, state: MovingDeflections, command: Vector, air_data: AirData) -> MovingDeflections:
        """Rates of position x and velocity: x'' = w^2 (limited command - x) - 2 z w x', x' within the rate limit."""
        w = self.frequency
        free_acceleration = (
            w * w * (self.limit_command(command) - state.position) - 2.0 * self.damping * w * state.velocity
        )
        limited_velocity = jnp.clip(state.velocity, -self.rate_limit, self.rate_limit)
        # at the rate limit the speed cannot grow, and an overshoot by an integration step decays
        return_acceleration = (limited_velocity - state.velocity) * w
        acceleration = jnp.where(
            state.velocity >= self.rate_limit,
            jnp.minimum(free_acceleration, return_acceleration),
            jnp.where(
                state.velocity <= -self.rate_limit,
                jnp.maximum(free_acceleration, return_acceleration),
                free_acceleration,
            ),
        )
        return MovingDeflections(limited_velocity, acceleration)
