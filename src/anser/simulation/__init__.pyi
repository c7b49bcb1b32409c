from .closed_loop import STATUS_MESSAGES, fly_alone, trimmed_vehicle
from .fleet_summary import FleetSummary, SummaryRecorder
from .flight import SEGMENT_STEPS, Flight, FlightState, Timing, assemble, fly
from .recorders import AbstractRecorder, AircraftSample, History
from .response import step_response
from .start import start_flight
from .vehicle import Faults, Mission, Vehicle

__all__ = [
    "SEGMENT_STEPS",
    "STATUS_MESSAGES",
    "AbstractRecorder",
    "AircraftSample",
    "Faults",
    "FleetSummary",
    "Flight",
    "FlightState",
    "History",
    "Mission",
    "SummaryRecorder",
    "Timing",
    "Vehicle",
    "assemble",
    "fly",
    "fly_alone",
    "start_flight",
    "step_response",
    "trimmed_vehicle",
]
