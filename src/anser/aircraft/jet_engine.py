"""A jet engine by tables of thrust over altitude and Mach number, or by two numbers."""

import jax.numpy as jnp

from anser.aircraft.air_data import AirData
from anser.aircraft.engine import AbstractEngine, EnginePower
from anser.aircraft.lagged_power import at_point, lagged_rate, steady_throttle, throttle_of_rate
from anser.aircraft.wrench import Wrench
from anser.numerics import Tables
from anser.shapes import Flag, Scalar, ScalarLike, Vector3


class JetEngine(AbstractEngine):
    """Thrust between idle and full in proportion to a power that follows the throttle with one lag.

    Attributes
    ----------
    thrust_tables
        Idle and full thrust (N) over altitude (m) and Mach number.
    lag
        Time constant, s.
    point_b
        Where the thrust acts, seen from the centre of gravity, m.
    thrust_factor
        On all thrust; 1 as published.
    """

    thrust_tables: Tables
    lag: Scalar
    point_b: Vector3
    thrust_factor: Scalar

    def idle_and_full(self, air_data: AirData) -> tuple[Scalar, Scalar]:
        """Thrust (N) at 0 and at 100 percent of power."""
        idle, full = self.thrust_tables(air_data.altitude, air_data.mach)[0]
        return self.thrust_factor * idle, self.thrust_factor * full

    def settled(self, power: ScalarLike) -> EnginePower:
        """Power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """First-order lag toward 100 times the throttle, percent/s."""
        return lagged_rate(state.power, throttle, self.lag)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust along body x: idle + (full - idle) power / 100."""
        idle, full = self.idle_and_full(air_data)
        return at_point(idle + (full - idle) * power / 100.0, jnp.zeros_like(idle), self.point_b)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Power (0..100 percent) whose thrust is nearest to `thrust` (N)."""
        idle, full = self.idle_and_full(air_data)
        span = full - idle
        gives_any = span > 0.0
        share = (thrust - idle) / jnp.where(gives_any, span, 1.0)
        return jnp.clip(100.0 * jnp.where(gives_any, share, 0.0), 0.0, 100.0)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Throttle that holds a power."""
        return steady_throttle(power)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Throttle whose lag gives nearest to the wanted rate."""
        return throttle_of_rate(power, power_rate, self.lag)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether altitude or Mach number lies outside the tables of thrust."""
        return jnp.any(self.thrust_tables.axes.outside(jnp.stack([air_data.altitude, air_data.mach])))
