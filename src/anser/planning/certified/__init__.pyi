from .certified_plan import Certificate, CertifiedPlan
from .path_bounds import path_bounds
from .planner import CertifiedPlanner
from .search import SearchOutcome, search
from .task import AircraftTask, Airspace, ArrivalRequest, KeepOuts

__all__ = [
    "AircraftTask",
    "Airspace",
    "ArrivalRequest",
    "Certificate",
    "CertifiedPlan",
    "CertifiedPlanner",
    "KeepOuts",
    "SearchOutcome",
    "path_bounds",
    "search",
]
