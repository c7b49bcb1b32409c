from .first_plan import FirstPlan, NoPlanError, PlanFileError
from .flight_batches import FlightCase, fly_many
from .plan_output import record_plan
from .plans import plan, read_plan, write_plan
from .runs import FlightResult, run
from .saved_flights import SavedFlight, load_flight
from .sweeps import sweep

__all__ = [
    "FirstPlan",
    "FlightCase",
    "FlightResult",
    "NoPlanError",
    "PlanFileError",
    "SavedFlight",
    "fly_many",
    "load_flight",
    "plan",
    "read_plan",
    "record_plan",
    "run",
    "sweep",
    "write_plan",
]
