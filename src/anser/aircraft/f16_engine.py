"""Engine of the Stevens & Lewis F-16: throttle gearing, power lag, thrust tables, and the inverses of each."""

import jax.numpy as jnp

from anser.aircraft.air_data import AirData
from anser.aircraft.engine import AbstractEngine, EnginePower, along_body_x
from anser.aircraft.wrench import Wrench
from anser.numerics import Tables
from anser.shapes import Flag, Scalar, ScalarLike


class F16Engine(AbstractEngine):
    """Afterburning turbofan of [SL] appendix A.

    Attributes
    ----------
    thrust_tables
        Idle, military and maximum thrust (N) over altitude (m) and Mach number.
    """

    thrust_tables: Tables

    def settled(self, power: ScalarLike) -> EnginePower:
        """Power alone."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """See `power_rate`."""
        return EnginePower(self.power_rate(state.power, self.gearing(throttle)))

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Thrust along body x through the centre of gravity."""
        return along_body_x(self.thrust(power, air_data.altitude, air_data.mach))

    def gearing(self, throttle: ScalarLike) -> Scalar:
        """Commanded power (percent) of a throttle setting, held within 0..1 ([SL] TGEAR)."""
        t = jnp.clip(throttle, 0.0, 1.0)
        return jnp.where(t <= 0.77, 64.94 * t, 217.38 * t - 117.38)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Throttle of a commanded power (percent): inverse of the gearing.

        The published gearing falls by 0.0012 percent at throttle 0.77; powers in that gap belong to its upper side.
        """
        power = jnp.clip(power, 0.0, 100.0)
        return jnp.where(power <= 64.94 * 0.77, power / 64.94, (power + 117.38) / 217.38)

    def thrust(self, power: ScalarLike, altitude: ScalarLike, mach: ScalarLike) -> Scalar:
        """Thrust (N) at a power (percent), altitude (m) and Mach number ([SL] THRUST)."""
        idle, military, maximum = self.thrust_tables(altitude, mach)[0]
        low = idle + (military - idle) * power / 50
        high = military + (maximum - military) * (power - 50) / 50
        return jnp.where(power < 50, low, high)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Power (percent, 0..100) whose thrust is nearest to `thrust` (N): the inverted thrust tables."""
        idle, military, maximum = self.thrust_tables(air_data.altitude, air_data.mach)[0]
        dry = 50 * (thrust - idle) / jnp.maximum(military - idle, 1.0)
        wet = 50 + 50 * (thrust - military) / jnp.maximum(maximum - military, 1.0)
        return jnp.clip(jnp.where(thrust < military, dry, wet), 0.0, 100.0)

    def power_rate(self, power: ScalarLike, power_command: ScalarLike) -> Scalar:
        """Engine lag, percent per second ([SL] PDOT and RTAU)."""
        wet_now, wet_wanted = power >= 50, power_command >= 50
        target = jnp.where(
            wet_wanted,
            jnp.where(wet_now, power_command, 60.0),
            jnp.where(wet_now, 40.0, power_command),
        )
        gap = target - power
        slow = jnp.clip(1.9 - 0.036 * gap, 0.1, 1.0)
        return jnp.where(wet_now, 5.0, slow) * gap

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """See `power_command_for_rate`."""
        return self.throttle_for_power(self.power_command_for_rate(power, power_rate))

    def power_command_for_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Power command (percent, 0..100) whose lag gives the wanted rate (percent/s): the inverted lag.

        With the afterburner lit the lag is 5 1/s, otherwise 1 1/s for commands up to 25 percent above the power; a
        larger step makes this engine spool up more slowly, so none is asked for. Across 50 percent the published lag
        leaves out some rates; a wanted rate there gets the command that crosses, which is faster, so that a closed loop
        cannot stick at 50 percent.
        """
        wet = power + power_rate / 5.0
        dry = power + jnp.minimum(power_rate, 25.0)
        return jnp.clip(jnp.where(power >= 50, wet, dry), 0.0, 100.0)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether altitude or Mach number lies outside the thrust tables."""
        return jnp.any(self.thrust_tables.axes.outside(jnp.stack([air_data.altitude, air_data.mach])))
