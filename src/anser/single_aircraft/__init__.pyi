from .flight import AircraftFlight
from .model import AircraftModel
from .performance import PerformanceSheet

__all__ = ["AircraftFlight", "AircraftModel", "PerformanceSheet"]
