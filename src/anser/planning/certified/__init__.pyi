from .certified_plan import CertifiedPlan
from .path_bounds import path_bounds
from .planner import CertifiedPlanner
from .search import SearchOutcome, search
from .task import Airspace, ArrivalRequest, KeepOuts

__all__ = [
    "Airspace",
    "ArrivalRequest",
    "CertifiedPlan",
    "CertifiedPlanner",
    "KeepOuts",
    "SearchOutcome",
    "path_bounds",
    "search",
]
