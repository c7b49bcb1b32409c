"""A piston engine with a propeller of constant efficiency."""

import jax.numpy as jnp

from anser.aircraft.air_data import AirData
from anser.aircraft.engine import AbstractEngine, EnginePower
from anser.aircraft.lagged_power import at_point, lagged_rate, steady_throttle, throttle_of_rate
from anser.aircraft.wrench import Wrench
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

_SEA_LEVEL_DENSITY_KG_M3 = 1.225
_FRICTION = 0.132
_LEAST_SHARE = 0.01
"""Where the formula would leave less power than that, high up, so much remains: the inverse stays finite."""


class PistonPropeller(AbstractEngine):
    """Thrust of a propeller that turns a part of the engine's power into that of flight, limited at rest.

    Shaft power falls with density as that of an engine without supercharger: P = P0 (1.132 rho / rho0 - 0.132)
    (F. Gagg, E. Farrar, *Altitude performance of aircraft engines equipped with gear-driven superchargers*, SAE
    Transactions 29, 1934). Thrust is eta P / sqrt(V^2 + V0^2) with V0 = eta P0 / T0, so that it is eta P / V in fast
    flight and the static thrust T0 at rest at sea level.

    Attributes
    ----------
    shaft_power
        P0, of the engine at full throttle at sea level, W.
    efficiency
        eta, of the propeller in fast flight.
    static_thrust
        T0, N.
    torque_per_power
        Reaction torque about body x per shaft power, N m / W, of a propeller of constant speed: 1 / angular velocity,
        positive for one that turns to the left seen from behind.
    lag
        Time constant, s.
    point_b
        Where the thrust acts, seen from the centre of gravity, m.
    thrust_factor
        On all thrust; 1 as published.
    """

    shaft_power: Scalar
    efficiency: Scalar
    static_thrust: Scalar
    torque_per_power: Scalar
    lag: Scalar
    point_b: Vector3
    thrust_factor: Scalar

    def _full(self, air_data: AirData) -> tuple[Scalar, Scalar]:
        """Thrust (N) and shaft power (W) at 100 percent."""
        share = (1.0 + _FRICTION) * air_data.density / _SEA_LEVEL_DENSITY_KG_M3 - _FRICTION
        power = self.shaft_power * jnp.maximum(share, _LEAST_SHARE)
        slow = self.efficiency * self.shaft_power / self.static_thrust
        return self.thrust_factor * self.efficiency * power / jnp.sqrt(air_data.V**2 + slow**2), power

    def settled(self, power: ScalarLike) -> EnginePower:
        """Power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """First-order lag toward 100 times the throttle, percent/s."""
        return lagged_rate(state.power, throttle, self.lag)

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust along body x, and the reaction to the propeller's torque; both in proportion to the power."""
        thrust, shaft_power = self._full(air_data)
        return at_point(thrust * power / 100.0, self.torque_per_power * shaft_power * power / 100.0, self.point_b)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Power (0..100 percent) whose thrust is nearest to `thrust` (N)."""
        return jnp.clip(100.0 * thrust / self._full(air_data)[0], 0.0, 100.0)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Throttle that holds a power."""
        return steady_throttle(power)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Throttle whose lag gives nearest to the wanted rate."""
        return throttle_of_rate(power, power_rate, self.lag)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Never: the formula holds at any speed."""
        return air_data.V < 0.0
