from .certified_plan import CertifiedPlan
from .planner import CertifiedPlanner
from .search import SearchOutcome
from .task import Airspace, ArrivalRequest, KeepOuts

__all__ = [
    "Airspace",
    "ArrivalRequest",
    "CertifiedPlan",
    "CertifiedPlanner",
    "KeepOuts",
    "SearchOutcome",
]
