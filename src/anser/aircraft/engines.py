"""Interface of an engine, engines with first-order lag, jet engine with tables, engine without lag, no engine."""

import abc
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft.air_data import AirData, Wrench
from anser.numerics.linear import cross
from anser.numerics.tables import Tables
from anser.shapes import Flag, Scalar, ScalarLike, Vector3


class EnginePower(eqx.Module):
    """State of an engine with one state variable: `power`, the power setting in percent of the maximum."""

    power: Scalar


class AbstractEngine(eqx.Module):
    """Interface of an engine, propeller included.

    The engine's `power` is a setting in percent of the maximum, not watts. Each class defines its own engine state;
    every state has an attribute `power`. A new class can be used in any airframe. For use in aircraft files,
    `anser.aircraft_files` must be extended.
    """

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the elements of the engine state, in the order of the pytree's leaves."""
        return ("power",)

    @abc.abstractmethod
    def steady_state(self, power: ScalarLike) -> Any:
        """Return the engine state of steady running at a power (percent), with attribute `power`."""

    @abc.abstractmethod
    def rate(self, state: Any, throttle: ScalarLike, air_data: AirData) -> Any:
        """Return the time derivative of the engine state at a throttle (0..1), as an object of the state's class."""

    def before_step(self, state: Any, throttle: ScalarLike) -> Any:
        """Return the state after any change between integration steps at a throttle (0..1); by default `state`."""
        return state

    def steady_power(self, throttle: ScalarLike) -> Scalar:
        """Return the power (0..100 percent) at which the engine runs steadily at a throttle (0..1)."""

        def halve(_: object, bounds: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            low, high = bounds
            middle = 0.5 * (low + high)
            is_above = self.throttle_for_power(middle) > throttle
            return jnp.where(is_above, low, middle), jnp.where(is_above, middle, high)

        start = jnp.zeros_like(jnp.asarray(throttle, float)), jnp.full_like(jnp.asarray(throttle, float), 100.0)
        low, high = jax.lax.stop_gradient(jax.lax.fori_loop(0, _BISECTIONS, halve, start))
        # One step of Newton carries the derivative, which the bisection does not have.
        power = 0.5 * (low + high)
        value, slope = jax.jvp(self.throttle_for_power, (power,), (jnp.ones_like(power),))
        slope = jax.lax.stop_gradient(slope)
        correction = (value - throttle) / jnp.where(slope > 0.0, slope, 1.0)
        return jnp.clip(power - jnp.where(slope > 0.0, correction, 0.0), 0.0, 100.0)

    @abc.abstractmethod
    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Compute the thrust force (N) and its moment about the centre of gravity (N m) at a power (percent)."""

    @abc.abstractmethod
    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the power (0..100 percent) whose thrust along body x is nearest to `thrust` (N)."""

    @abc.abstractmethod
    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Return the throttle (0..1) at which the engine runs steadily at a power (percent)."""

    @abc.abstractmethod
    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Return the throttle (0..1) that changes the current `power` (percent) at `power_rate` (percent/s).

        If the engine cannot reach this rate, the throttle gives the nearest possible rate.
        """

    @abc.abstractmethod
    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition is outside the valid range of the engine's data."""

    def dispersed(self, thrust: Scalar, shift_b: Vector3) -> "AbstractEngine":
        """Return a copy with the thrust multiplied by `thrust` and the thrust point moved by `shift_b` (m, body axes).

        By default the fields `thrust_factor` and `point_b` are changed; raises TypeError if the engine lacks them.
        """
        if not (hasattr(self, "thrust_factor") and hasattr(self, "point_b")):
            raise TypeError(
                f"a deviation of {type(self).__name__}: arrived an engine without thrust_factor and point_b; expected "
                "these fields, or a method `dispersed`"
            )
        values = self.thrust_factor * thrust, self.point_b + shift_b  # pyright: ignore[reportAttributeAccessIssue]
        return eqx.tree_at(lambda e: (e.thrust_factor, e.point_b), self, values)

    def with_point_shifted(self, shift_b: Vector3) -> Self:
        """Return a copy with the field `point_b` moved by `shift_b` (m, body axes); `self` if the field is missing."""
        if not hasattr(self, "point_b"):
            return self
        return eqx.tree_at(lambda e: e.point_b, self, self.point_b + shift_b)  # pyright: ignore


class NoEngine(AbstractEngine):
    """No engine: zero thrust, for gliders."""

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """Return a state with `power` (percent), which produces no thrust."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """Return a zero rate of power at any throttle."""
        return EnginePower(jnp.zeros_like(state.power))

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Return zero force and moment."""
        zero = jnp.zeros(3, jnp.result_type(air_data.V))
        return Wrench(zero, zero)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return 0 percent for any thrust."""
        return jnp.zeros((), jnp.result_type(thrust, 0.0))

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Return throttle 0 for any power."""
        return jnp.zeros((), jnp.result_type(power, 0.0))

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Return throttle 0 for any rate."""
        return jnp.zeros((), jnp.result_type(power, 0.0))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Return False."""
        return air_data.V < 0.0

    def dispersed(self, thrust: Scalar, shift_b: Vector3) -> "NoEngine":
        """Return `self`."""
        return self


def thrust_along_body_x(thrust: Scalar) -> Wrench:
    """Return the force (N) and the zero moment of a thrust (N) along body x through the centre of gravity."""
    zero = jnp.zeros_like(thrust)
    return Wrench(force_b=jnp.stack([thrust, zero, zero]), moment_b=jnp.stack([zero, zero, zero]))


class AbstractLaggedEngine(AbstractEngine):
    """An engine whose power (percent) follows 100 times the throttle with a first-order lag."""

    lag: eqx.AbstractVar[Scalar]  # time constant, s

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """Return the engine state of steady running at a power (percent)."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """Return the rate of the power, percent/s: (100 throttle - power) / lag, with the throttle limited to 0..1."""
        return EnginePower((100.0 * jnp.clip(throttle, 0.0, 1.0) - state.power) / self.lag)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Return the throttle of steady running at a power (percent): power / 100, limited to 0..1."""
        return jnp.clip(jnp.asarray(power) / 100.0, 0.0, 1.0)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Return the throttle (0..1) whose power rate is nearest to `power_rate` (percent/s) at the current power."""
        return jnp.clip((power + self.lag * power_rate) / 100.0, 0.0, 1.0)


def thrust_at_point(thrust: Scalar, torque: Scalar, point_b: Vector3) -> Wrench:
    """Return force (N) and moment (N m) of a thrust (N) along body x at a point, plus a torque about body x (N m).

    `point_b` is relative to the centre of gravity, body axes, m; the moment is about the centre of gravity.
    """
    zero = jnp.zeros_like(thrust)
    force_b = jnp.stack([thrust, zero, zero])
    return Wrench(force_b=force_b, moment_b=cross(point_b, force_b) + jnp.stack([torque, zero, zero]))


class JetEngine(AbstractLaggedEngine):
    """Jet engine with a thrust linear in the power, from idle to full, and a first-order lag of the power."""

    thrust_tables: Tables  #: Idle and full thrust (N) over altitude (m) and Mach number.
    lag: Scalar  #: Time constant from throttle to power, s.
    point_b: Vector3  #: Point of thrust application relative to the centre of gravity, m.
    thrust_factor: Scalar  #: Factor on the thrust; 1 for the published values.

    def idle_and_full_thrust(self, air_data: AirData) -> tuple[Scalar, Scalar]:
        """Return the thrust (N) at 0 and at 100 percent of power."""
        idle, full = self.thrust_tables(air_data.altitude, air_data.mach)[0]
        return self.thrust_factor * idle, self.thrust_factor * full

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Compute the thrust along body x (N) and its moment about the centre of gravity (N m) at a power (percent)."""
        idle, full = self.idle_and_full_thrust(air_data)
        return thrust_at_point(idle + (full - idle) * power / 100.0, jnp.zeros_like(idle), self.point_b)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the power (0..100 percent) whose thrust is nearest to `thrust` (N)."""
        idle, full = self.idle_and_full_thrust(air_data)
        span = full - idle
        is_positive = span > 0.0
        share = (thrust - idle) / jnp.where(is_positive, span, 1.0)
        return jnp.clip(100.0 * jnp.where(is_positive, share, 0.0), 0.0, 100.0)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether altitude or Mach number is outside the thrust tables."""
        return jnp.any(self.thrust_tables.axes.outside(jnp.stack([air_data.altitude, air_data.mach])))


class InstantEngine(AbstractEngine):
    """An engine without lag: at the start of each step, the power jumps to its steady value for the throttle."""

    engine: AbstractEngine  #: Engine with lag; defines the thrust and the steady relation of throttle and power.
    step: Scalar  #: Sampling period, s.

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """Return the engine state of steady running at a power (percent)."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """Return a zero rate: the power changes only between the integration steps, by `before_step`."""
        return EnginePower(jnp.zeros_like(state.power))

    def before_step(self, state: EnginePower, throttle: ScalarLike) -> EnginePower:
        """Return the engine state of steady running at the throttle (0..1)."""
        return EnginePower(self.steady_power(throttle).astype(state.power.dtype))

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Compute the thrust force (N) and its moment about the centre of gravity (N m) at a power (percent)."""
        return self.engine.propulsion(power, air_data)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the power (0..100 percent) whose thrust along body x is nearest to `thrust` (N)."""
        return self.engine.power_for_thrust(thrust, air_data)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Return the throttle (0..1) at which the engine runs steadily at a power (percent)."""
        return self.engine.throttle_for_power(power)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Return the throttle (0..1) whose steady power is `power` + `step` * `power_rate` (percent)."""
        return self.engine.throttle_for_power(power + self.step * power_rate)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition is outside the valid range of the engine's data."""
        return self.engine.outside_tables(air_data)

    def with_point_shifted(self, shift_b: Vector3) -> "InstantEngine":
        """Return a copy with the thrust point of the field `engine` moved by `shift_b` (m, body axes)."""
        return InstantEngine(self.engine.with_point_shifted(shift_b), self.step)


_BISECTIONS = 48
"""Halvings of 0..100 percent, down to 4e-13 percent."""
