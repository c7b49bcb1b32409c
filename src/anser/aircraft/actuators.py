"""Actuators of control surfaces: first or second order with position and rate limits, or without lag."""

import abc
from typing import Any, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft.air_data import AirData
from anser.shapes import Scalar, ScalarLike, Vector
from anser.variables import STANDARD_SURFACES


class AbstractActuators(eqx.Module):
    """Interface of the actuators of any number of control surfaces; all arrays have the shape (surfaces,).

    Each class defines its own actuator state; every state has an attribute `position` (rad).
    """

    #: Time constant (s) of the lag from command to position, which `command_for_rate` inverts. In `InstantActuators`,
    #: the sampling period.
    time_constant: eqx.AbstractVar[Vector]
    #: Lower and upper position limit, rad, and greatest deflection rate, rad/s.
    lower: eqx.AbstractVar[Vector]
    upper: eqx.AbstractVar[Vector]
    rate_limit: eqx.AbstractVar[Vector]
    names: eqx.AbstractVar[tuple[str, ...]]  #: Distinct names of the surfaces.
    #: Whether the surfaces jump to the command at the start of each step and are held over the step.
    is_held: ClassVar[bool] = False

    @abc.abstractmethod
    def steady_state(self, position: Vector) -> Any:
        """Return the actuator state of surfaces at rest at `position` (rad)."""

    @abc.abstractmethod
    def rate(self, state: Any, command: Vector, air_data: AirData) -> Any:
        """Return the time derivative of the actuator state under a command (rad), as an object of the state's class."""

    def before_step(self, state: Any, command: Vector) -> Any:
        """Return the state after changes between integration steps, such as a jump to `command`; by default `state`."""
        return state

    def scheduled_position(self, position: Vector, air_data: AirData) -> Vector:
        """Return `position` (rad) with scheduled surfaces at their steady deflections in the air data.

        A scheduled surface, for example a leading-edge flap, follows the air data instead of a command. By default no
        surface is scheduled.
        """
        return position

    def steady_state_in_flow(self, position: Vector, air_data: AirData) -> Any:
        """Return the actuator state of surfaces at rest at the positions of `scheduled_position` (rad)."""
        return self.steady_state(self.scheduled_position(position, air_data))

    @property
    def is_commanded(self) -> tuple[bool, ...]:
        """True for each surface that the controller commands (default), False for a surface that follows a schedule."""
        return (True,) * len(self.names)

    @property
    def controls_yaw(self) -> bool:
        """Whether the controller commands at least three surfaces, enough for roll, pitch and yaw."""
        return sum(self.is_commanded) >= len(STANDARD_SURFACES)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the elements of the actuator state in the order of the pytree's leaves; by default `names`."""
        return self.names

    def limit_command(self, command: Vector) -> Vector:
        """Return the command (rad) limited to the position limits."""
        return jnp.clip(command, self.lower, self.upper)

    def with_bandwidth_scaled(self, factor: Scalar) -> Self:
        """Return a copy with the bandwidth times `factor`; by default the time constants are divided by `factor`."""
        return eqx.tree_at(lambda a: a.time_constant, self, self.time_constant / factor)

    def command_for_rate(self, position: Vector, rate: Vector) -> Vector:
        """Return the command (rad, within the stops) that moves a surface with first-order lag at `rate` (rad/s).

        `position` is the present deflection (rad).
        """
        return self.limit_command(position + self.time_constant * rate)

    def travel_per_rate(self, step: ScalarLike) -> Vector:
        """Return the travel within `step` (s) after `command_for_rate(position, rate)`, divided by `rate`; in s."""
        return self.time_constant * (1 - jnp.exp(-step / self.time_constant))


class Deflections(eqx.Module):
    """State of first-order actuators: `position` of the surfaces, rad, shape (surfaces,)."""

    position: Vector


class FirstOrderActuators(AbstractActuators):
    """Actuators with a first-order lag from command to position, a rate limit and position limits."""

    time_constant: Vector
    lower: Vector
    upper: Vector
    rate_limit: Vector
    names: tuple[str, ...] = eqx.field(static=True, default=STANDARD_SURFACES)

    def steady_state(self, position: Vector) -> Deflections:
        """Return the actuator state at rest at `position` (rad)."""
        return Deflections(jnp.asarray(position))

    def rate(self, state: Deflections, command: Vector, air_data: AirData) -> Deflections:
        """Return the rate of the position (rad/s): (limited command - position) / time constant, rate-limited."""
        unlimited_rate = (self.limit_command(command) - state.position) / self.time_constant
        return Deflections(jnp.clip(unlimited_rate, -self.rate_limit, self.rate_limit))


class MovingDeflections(eqx.Module):
    """State of second-order actuators: `position` (rad) and `velocity` (rad/s), both of shape (surfaces,)."""

    position: Vector
    velocity: Vector


class SecondOrderActuators(AbstractActuators):
    """Actuators with second-order dynamics, rate limit and hard stops.

    During an integration step a surface may overshoot a stop, but by less than the travel in the step.
    """

    frequency: Vector  #: Natural frequency, rad/s.
    damping: Vector  #: Damping ratio.
    lower: Vector
    upper: Vector
    rate_limit: Vector
    names: tuple[str, ...] = eqx.field(static=True, default=STANDARD_SURFACES)

    @property
    def time_constant(self) -> Float[Array, " surfaces"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Lag of the position behind a slowly moving command, s: 2 damping / frequency."""
        return 2.0 * self.damping / self.frequency

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the elements of the actuator state: positions of the surfaces, then their velocities."""
        return (*self.names, *(f"{name}_velocity" for name in self.names))

    def with_bandwidth_scaled(self, factor: Scalar) -> Self:
        """Return a copy with the natural frequencies multiplied by `factor`."""
        return eqx.tree_at(lambda a: a.frequency, self, self.frequency * factor)

    def steady_state(self, position: Vector) -> MovingDeflections:
        """Return the state at rest: `position` (rad) and zero velocity."""
        position = jnp.asarray(position)
        return MovingDeflections(position, jnp.zeros_like(position))

    def rate(self, state: MovingDeflections, command: Vector, air_data: AirData) -> MovingDeflections:
        """Return the derivatives x' (rad/s) and v' (rad/s^2) of the positions x and the velocities v.

        x' is v within the rate limit. v' is w^2 (limited command - x) - 2 z w v, with natural frequency w and damping
        ratio z, but at the rate limit the speed does not grow. At a stop x' is not outward, and an outward v decays.
        """
        w = self.frequency
        free_acceleration = (
            w * w * (self.limit_command(command) - state.position) - 2.0 * self.damping * w * state.velocity
        )
        limited_velocity = jnp.clip(state.velocity, -self.rate_limit, self.rate_limit)
        # at the rate limit the speed cannot grow, and an overshoot by an integration step decays
        return_acceleration = (limited_velocity - state.velocity) * w
        is_rising, is_falling = self._pushes_upper(state), self._pushes_lower(state)
        return_acceleration = jnp.where(is_rising | is_falling, -state.velocity * w, return_acceleration)
        acceleration = jnp.where(
            (state.velocity >= self.rate_limit) | is_rising,
            jnp.minimum(free_acceleration, return_acceleration),
            jnp.where(
                (state.velocity <= -self.rate_limit) | is_falling,
                jnp.maximum(free_acceleration, return_acceleration),
                free_acceleration,
            ),
        )
        return MovingDeflections(jnp.where(is_rising | is_falling, 0.0, limited_velocity), acceleration)

    def before_step(self, state: MovingDeflections, command: Vector) -> MovingDeflections:
        """Return the state with positions limited to the stops; surfaces that move outwards at a stop come to rest."""
        is_stopped = self._pushes_upper(state) | self._pushes_lower(state)
        velocity = jnp.where(is_stopped, 0.0, state.velocity)
        return MovingDeflections(self.limit_command(state.position), velocity)

    def _pushes_upper(self, state: MovingDeflections) -> Bool[Array, " surfaces"]:
        return (state.position >= self.upper) & (state.velocity > 0.0)

    def _pushes_lower(self, state: MovingDeflections) -> Bool[Array, " surfaces"]:
        return (state.position <= self.lower) & (state.velocity < 0.0)


class InstantActuators(AbstractActuators):
    """Actuators without lag or rate limit: the surfaces jump to the limited command at the start of each step."""

    time_constant: Vector  #: Sampling period, s: the surfaces jump once per period.
    lower: Vector
    upper: Vector
    rate_limit: Vector
    names: tuple[str, ...] = eqx.field(static=True, default=STANDARD_SURFACES)
    is_held: ClassVar[bool] = True

    def steady_state(self, position: Vector) -> Deflections:
        """Return the actuator state at rest at `position` (rad)."""
        return Deflections(jnp.asarray(position))

    def rate(self, state: Deflections, command: Vector, air_data: AirData) -> Deflections:
        """Return zero rates: the surfaces move only between the integration steps, by `before_step`."""
        return Deflections(jnp.zeros_like(state.position))

    def before_step(self, state: Deflections, command: Vector) -> Deflections:
        """Return the state with the surfaces at the command (rad), limited to the stops."""
        return Deflections(self.limit_command(command).astype(state.position.dtype))

    def travel_per_rate(self, step: ScalarLike) -> Vector:
        """Return the travel after `command_for_rate(position, rate)`, divided by `rate`: the sampling period, s."""
        return self.time_constant

    def with_bandwidth_scaled(self, factor: Scalar) -> Self:
        """Return `self`: the bandwidth of actuators without lag is infinite."""
        return self


def without_lag(actuators: AbstractActuators, step: ScalarLike) -> InstantActuators:
    """Return actuators of the same surfaces and position limits, without lag or rate limit, sampled every `step` (s).

    Raises ValueError if a surface follows a schedule instead of a command.
    """
    if not all(actuators.is_commanded):
        scheduled = [name for name, flag in zip(actuators.names, actuators.is_commanded, strict=True) if not flag]
        raise ValueError(
            f"actuators without lag: arrived {', '.join(scheduled)} on a schedule; expected commanded surfaces"
        )
    infinite, period = jnp.full_like(actuators.lower, jnp.inf), jnp.full_like(actuators.lower, step)
    return InstantActuators(period, actuators.lower, actuators.upper, infinite, actuators.names)
