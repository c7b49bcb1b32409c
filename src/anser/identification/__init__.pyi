from .estimates import Estimate
from .records import FlightRecord, flight_record

__all__ = ["Estimate", "FlightRecord", "flight_record"]
