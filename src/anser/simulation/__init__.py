"""Simulation: the closed loop of a fleet, trim, responses, linear models, the recorded history."""

from anser.simulation.broken_loop import HELD_BACK, MemoryFields, breakpoints, loop_memory
from anser.simulation.capability import ALPHA_LEFT, Capability, capability_of, capability_points
from anser.simulation.certified_planner import CertifiedPlanner, CertifiedPlanState
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.decentralised_planner import DecentralisedPlanner, DecentralisedPlanState
from anser.simulation.deep_stall import (
    PitchBranch,
    SteadyDescent,
    follow_pitch_trim,
    pitching_moment,
    steady_descent,
)
from anser.simulation.faults import Faults, no_faults
from anser.simulation.fleet import Flight, FlightState, Timing, assemble, statuses
from anser.simulation.fleet_summary import FleetSummary, SummaryRecorder
from anser.simulation.flight import SEGMENT_STEPS, fly
from anser.simulation.flight_summary import AUTOPILOT_LIMITS, BETA_BOUND, TABLE_AXES, FlightSummary
from anser.simulation.hold import HoldAroundGoal
from anser.simulation.hold_assignment import assign_holds
from anser.simulation.linearize_inversion import InversionPole, inversion_poles
from anser.simulation.linearize_open import LinearModel, linearize
from anser.simulation.linearize_sampled import CHANNELS, linearize_loop
from anser.simulation.margins import (
    FREQUENCY_MIN,
    NEUTRAL,
    LoopAnalysis,
    LoopResponse,
    analyse_loops,
    largest_pole,
)
from anser.simulation.modes import Mode, modes_of, wind_axis_states
from anser.simulation.motion import advance
from anser.simulation.network import Network
from anser.simulation.planned_hold import PlannedHolds, cells_for, moved_with_goals
from anser.simulation.precision import PRECISIONS, Precision, flight_in, state_in
from anser.simulation.recorder import AbstractRecorder, AircraftSample, FleetSample, History
from anser.simulation.response import Loop, LoopCase, Response, step_response
from anser.simulation.start import TrimmedFleet, begin, start_flight, trimmed_fleet
from anser.simulation.status import STATUS_MESSAGES
from anser.simulation.survey import survey_flight
from anser.simulation.survey_trim import TRIM_STOPS, MapPoint, map_point
from anser.simulation.trim import TrimPoint, TrimTarget, solve_trim, trim_target
from anser.simulation.trim_diagnosis import NearestTrim, NearestTrims, nearest_trims, trim_violations
from anser.simulation.vehicle import Mission, Vehicle, VehicleState

__all__ = [
    "ALPHA_LEFT",
    "AUTOPILOT_LIMITS",
    "BETA_BOUND",
    "CHANNELS",
    "FREQUENCY_MIN",
    "HELD_BACK",
    "NEUTRAL",
    "PRECISIONS",
    "SEGMENT_STEPS",
    "STATUS_MESSAGES",
    "TABLE_AXES",
    "TRIM_STOPS",
    "AbstractRecorder",
    "AircraftSample",
    "Capability",
    "CertifiedPlanState",
    "CertifiedPlanner",
    "DecentralisedPlanState",
    "DecentralisedPlanner",
    "Faults",
    "FleetSample",
    "FleetSummary",
    "Flight",
    "FlightState",
    "FlightSummary",
    "History",
    "HoldAroundGoal",
    "InversionPole",
    "LinearModel",
    "Loop",
    "LoopAnalysis",
    "LoopCase",
    "LoopResponse",
    "MapPoint",
    "MemoryFields",
    "Mission",
    "Mode",
    "NearestTrim",
    "NearestTrims",
    "Network",
    "PitchBranch",
    "PlannedHolds",
    "Precision",
    "Response",
    "SteadyDescent",
    "SummaryRecorder",
    "Timing",
    "TrimPoint",
    "TrimTarget",
    "TrimmedFleet",
    "Vehicle",
    "VehicleState",
    "advance",
    "analyse_loops",
    "assemble",
    "assign_holds",
    "begin",
    "breakpoints",
    "capability_of",
    "capability_points",
    "cells_for",
    "flight_in",
    "fly",
    "fly_alone",
    "follow_pitch_trim",
    "inversion_poles",
    "largest_pole",
    "linearize",
    "linearize_loop",
    "loop_memory",
    "map_point",
    "modes_of",
    "moved_with_goals",
    "nearest_trims",
    "no_faults",
    "pitching_moment",
    "solve_trim",
    "start_flight",
    "state_in",
    "statuses",
    "steady_descent",
    "step_response",
    "survey_flight",
    "trim_target",
    "trim_violations",
    "trimmed_fleet",
    "trimmed_vehicle",
    "wind_axis_states",
]
