"""Simulation: the closed loop of a fleet, trim, responses, linear models, the recorded history."""

from anser.simulation.broken_loop import BREAKPOINTS, HELD_BACK, MemoryFields, loop_memory
from anser.simulation.dispersed_flight import Reading, Readings, dispersed_flight, steady_readings
from anser.simulation.fleet import CertifiedFleet, Fleet, Flight, FlightState, Timing
from anser.simulation.flight import SEGMENT_STEPS, fly_segment, step_flight
from anser.simulation.flight_summary import AUTOPILOT_LIMITS, BETA_BOUND, TABLE_AXES, FlightSummary
from anser.simulation.hold_assignment import assign_holds
from anser.simulation.linearize_inversion import InversionPole, inversion_poles
from anser.simulation.linearize_open import LinearModel, linearize
from anser.simulation.linearize_sampled import CHANNELS, linearize_loop
from anser.simulation.margins import NEUTRAL, LoopAnalysis, LoopResponse, analyse_loops, largest_pole
from anser.simulation.modes import Mode, modes_of, wind_axis_states
from anser.simulation.motion import advance
from anser.simulation.planned_hold import PlannedHolds, cells_for
from anser.simulation.response import Loop, Response, step_response
from anser.simulation.sensing import Sensed, sense
from anser.simulation.start import Ready, begin, make_ready, start_flight, travellers
from anser.simulation.status import FLYING, NO_TRIM, STATUS_MESSAGES
from anser.simulation.survey import survey_flight
from anser.simulation.survey_trim import TRIM_STOPS, MapPoint, map_point
from anser.simulation.trim import TrimPoint, TrimTarget, solve_trim, trim_target
from anser.simulation.trim_diagnosis import NearestTrim, NearestTrims, nearest_trims, trim_violations

__all__ = [
    "AUTOPILOT_LIMITS",
    "BETA_BOUND",
    "BREAKPOINTS",
    "CHANNELS",
    "FLYING",
    "HELD_BACK",
    "NEUTRAL",
    "NO_TRIM",
    "SEGMENT_STEPS",
    "STATUS_MESSAGES",
    "TABLE_AXES",
    "TRIM_STOPS",
    "CertifiedFleet",
    "Fleet",
    "Flight",
    "FlightState",
    "FlightSummary",
    "InversionPole",
    "LinearModel",
    "Loop",
    "LoopAnalysis",
    "LoopResponse",
    "MapPoint",
    "MemoryFields",
    "Mode",
    "NearestTrim",
    "NearestTrims",
    "PlannedHolds",
    "Reading",
    "Readings",
    "Ready",
    "Response",
    "Sensed",
    "Timing",
    "TrimPoint",
    "TrimTarget",
    "advance",
    "analyse_loops",
    "assign_holds",
    "begin",
    "cells_for",
    "dispersed_flight",
    "fly_segment",
    "inversion_poles",
    "largest_pole",
    "linearize",
    "linearize_loop",
    "loop_memory",
    "make_ready",
    "map_point",
    "modes_of",
    "nearest_trims",
    "sense",
    "solve_trim",
    "start_flight",
    "steady_readings",
    "step_flight",
    "step_response",
    "survey_flight",
    "travellers",
    "trim_target",
    "trim_violations",
    "wind_axis_states",
]
