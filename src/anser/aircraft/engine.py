"""What every engine publishes: thrust, lag, and the inverses of both."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.air_data import AirData
from anser.aircraft.wrench import Wrench
from anser.shapes import Flag, Scalar, ScalarLike


class EnginePower(eqx.Module):
    """State of an engine with a single lag: `power`, percent of maximum."""

    power: Scalar


class AbstractEngine(eqx.Module):
    """An engine with whatever it drives; what it carries along is its own, but for its `power`, percent of maximum.

    Thrust follows from the power and the air; a controller reaches it through the inverses.
    """

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the elements of the state, in the order of its leaves."""
        return ("power",)

    @abc.abstractmethod
    def settled(self, power: ScalarLike) -> Any:
        """State of an engine that runs steadily at a power (percent); has an attribute `power`."""

    @abc.abstractmethod
    def rate(self, state: Any, throttle: ScalarLike, air_data: AirData) -> Any:
        """Time derivative of the state at a throttle (0..1), as a state of derivatives."""

    @abc.abstractmethod
    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust force and moment at a power (percent)."""

    @abc.abstractmethod
    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Power (percent, within what the engine can give) whose thrust along body x is nearest to `thrust` (N)."""

    @abc.abstractmethod
    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Throttle (0..1) that holds a power (percent) steadily."""

    @abc.abstractmethod
    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Throttle (0..1) whose lag gives nearest to the wanted rate (percent/s) at the present power."""

    @abc.abstractmethod
    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition lies outside the range of the engine's data."""


class NoEngine(AbstractEngine):
    """No engine: no thrust, no power, whatever is wanted."""

    def settled(self, power: ScalarLike) -> EnginePower:
        """Power is kept as it is told: nothing follows from it."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """None."""
        return EnginePower(jnp.zeros_like(state.power))

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """None."""
        none = jnp.zeros(3, jnp.result_type(air_data.V))
        return Wrench(none, none)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """0, whatever is wanted."""
        return jnp.zeros((), jnp.result_type(thrust, 0.0))

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """0, whatever is wanted."""
        return jnp.zeros((), jnp.result_type(power, 0.0))

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """0, whatever is wanted."""
        return jnp.zeros((), jnp.result_type(power, 0.0))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Never."""
        return air_data.V < 0.0


def along_body_x(thrust: Scalar) -> Wrench:
    """Thrust (N) along body x through the centre of gravity."""
    zero = jnp.zeros_like(thrust)
    return Wrench(force_b=jnp.stack([thrust, zero, zero]), moment_b=jnp.stack([zero, zero, zero]))
