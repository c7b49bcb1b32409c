"""Bandwidths of the loops of an autopilot's gains, and their separation."""

from anser.control.gains import AutopilotGains, LoopGains
from anser.control.loop_separations import LoopSeparation, loop_separations
from anser.shapes import Vector3


def loop_bandwidth(gains: LoopGains) -> Vector3:
    """Bandwidth K_P/(1 + K_D) of each channel, 1/s."""
    return gains.proportional / (1.0 + gains.derivative)


def separations_of(gains: AutopilotGains) -> tuple[LoopSeparation, ...]:
    rates, attitude, velocity = (
        loop_bandwidth(loop).tolist() for loop in (gains.rates, gains.attitude, gains.velocity)
    )
    return loop_separations(rates, attitude, velocity, float(gains.actuator_bandwidth), float(gains.engine_bandwidth))
