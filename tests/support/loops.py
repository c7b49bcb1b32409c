"""Separation of the loops of an autopilot's gains."""

from anser.control.gains import AutopilotGains, loop_bandwidth
from anser.control.loop_separations import LoopSeparation, loop_separations


def separations_of(gains: AutopilotGains) -> tuple[LoopSeparation, ...]:
    rates, attitude, velocity = (
        loop_bandwidth(loop).tolist() for loop in (gains.rates, gains.attitude, gains.velocity)
    )
    return loop_separations(rates, attitude, velocity, float(gains.actuator_bandwidth), float(gains.engine_bandwidth))
