from .flight import AircraftFlight
from .input_signals import InputSignal
from .model import AircraftModel
from .performance import PerformanceSheet

__all__ = ["AircraftFlight", "AircraftModel", "InputSignal", "PerformanceSheet"]
