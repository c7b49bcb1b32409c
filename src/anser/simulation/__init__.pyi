from .closed_loop import STATUS_MESSAGES
from .fleet_summary import FleetSummary, SummaryRecorder
from .flight import Flight, FlightState, assemble, fly
from .open_loop import believed_variables
from .recorders import AbstractRecorder, AircraftSample, History
from .response import step_response
from .start import start_flight
from .vehicle import Faults, Mission, Vehicle

__all__ = [
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
    "Vehicle",
    "assemble",
    "believed_variables",
    "fly",
    "start_flight",
    "step_response",
]
