from .first_plan import FirstPlan, NoPlanError
from .flight_batches import fly_many
from .plans import plan, read_plan, write_plan
from .runs import FlightResult, run
from .saved_flights import SavedFlight, load_flight
from .sweeps import sweep

__all__ = [
    "FirstPlan",
    "FlightResult",
    "NoPlanError",
    "SavedFlight",
    "fly_many",
    "load_flight",
    "plan",
    "read_plan",
    "run",
    "sweep",
    "write_plan",
]
