"""Actuators of the F-16 of NASA TP-1538: three commanded surfaces, and a leading-edge flap that follows the flow."""

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData
from anser.shapes import Scalar, ScalarLike, Vector

_STATIC_PRESSURE_SHARE = 0.7  # qbar / ps = (gamma / 2) M^2 with gamma = 1.4
_FLAP = 3


class ScheduledFlap(eqx.Module):
    """State of `ScheduledFlapActuators`.

    Attributes
    ----------
    position
        Elevator, aileron, rudder, leading-edge flap, rad, shape (4,).
    alpha_lag
        Angle of attack through the schedule's low-pass filter, rad.
    """

    position: Vector
    alpha_lag: Scalar


class ScheduledFlapActuators(AbstractActuators):
    """First-order actuators of elevator, aileron, rudder; the leading-edge flap has a schedule and no command.

    Its schedule is gain (2 s + pole)/(s + pole) alpha - compression qbar/ps + offset, within the stops (TP-1538), with
    qbar/ps = 0.7 M^2; the flap follows with a lag and a rate limit. The lead-lag is 2 alpha - x with
    x' = pole (alpha - x), so that x is the state. Above `alpha_down` the flap goes fully down whatever the filter says:
    there the wind tunnel had it nowhere else.

    Attributes
    ----------
    time_constant, lower, upper, rate_limit
        As in `AbstractActuators`, shape (4,).
    gain
        Flap per angle of attack.
    pole
        1/s.
    compression, offset
        Rad.
    alpha_down
        Angle of attack, rad, from which the flap stands fully down.
    """

    time_constant: Vector
    lower: Vector
    upper: Vector
    rate_limit: Vector
    gain: Scalar
    pole: Scalar
    compression: Scalar
    offset: Scalar
    alpha_down: Scalar
    names: tuple[str, ...] = eqx.field(static=True, default=("elevator", "aileron", "rudder", "leading_edge_flap"))

    @property
    def commanded(self) -> tuple[bool, ...]:
        """All but the flap."""
        return (True, True, True, False)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Positions, then the filtered angle of attack."""
        return (*self.names, "alpha_lag")

    def settled(self, position: Vector) -> ScheduledFlap:
        """At rest, with the filter at the angle of attack for which the schedule has the flap there at low speed."""
        position = jnp.asarray(position)
        return ScheduledFlap(position, (position[_FLAP] - self.offset) / self.gain)

    def steady(self, position: Vector, air_data: AirData) -> ScheduledFlap:
        """At rest in a steady flow: the flap at its schedule, the filter at the angle of attack."""
        return ScheduledFlap(self.scheduled(position, air_data), jnp.asarray(air_data.alpha))

    def rate(self, state: ScheduledFlap, command: Vector, air_data: AirData) -> ScheduledFlap:
        """Lags within the rate limits; the command of the flap is not looked at."""
        flap = self._flap(2.0 * air_data.alpha - state.alpha_lag, air_data)
        wanted = self.limited(jnp.concatenate([command[:_FLAP], flap[None]]))
        moving = (wanted - state.position) / self.time_constant
        return ScheduledFlap(
            jnp.clip(moving, -self.rate_limit, self.rate_limit), self.pole * (air_data.alpha - state.alpha_lag)
        )

    def scheduled(self, position: Vector, air_data: AirData) -> Vector:
        """The flap at its schedule's steady value, rad; the others as they are."""
        flap = jnp.clip(self._flap(air_data.alpha, air_data), self.lower[_FLAP], self.upper[_FLAP])
        return jnp.concatenate([position[:_FLAP], flap[None]])

    def _flap(self, led_alpha: ScalarLike, air_data: AirData) -> Scalar:
        """Flap that the schedule wants, rad, not yet within its stops."""
        pressure_ratio = _STATIC_PRESSURE_SHARE * air_data.mach**2
        wanted = self.gain * led_alpha - self.compression * pressure_ratio + self.offset
        return jnp.where(air_data.alpha > self.alpha_down, self.upper[_FLAP], wanted)
