"""Simulation: the closed loop of a fleet, trim, responses, the recorded history."""

from anser.simulation.fleet import Fleet, Flight, FlightState, Timing
from anser.simulation.flight import SEGMENT_STEPS, fly_segment, start_flight, step_flight
from anser.simulation.motion import advance
from anser.simulation.response import Response, step_response
from anser.simulation.sensing import Sensed, sense
from anser.simulation.status import FLYING, NO_TRIM, STATUS_MESSAGES
from anser.simulation.trim import TrimPoint, TrimTarget, solve_trim, trim_target
from anser.simulation.trim_diagnosis import NearestTrim, NearestTrims, nearest_trims, trim_violations

__all__ = [
    "FLYING",
    "NO_TRIM",
    "SEGMENT_STEPS",
    "STATUS_MESSAGES",
    "Fleet",
    "Flight",
    "FlightState",
    "NearestTrim",
    "NearestTrims",
    "Response",
    "Sensed",
    "Timing",
    "TrimPoint",
    "TrimTarget",
    "advance",
    "fly_segment",
    "nearest_trims",
    "sense",
    "solve_trim",
    "start_flight",
    "step_flight",
    "step_response",
    "trim_target",
    "trim_violations",
]
