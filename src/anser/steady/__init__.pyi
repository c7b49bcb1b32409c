from .performance import Capability
from .trim import TrimPoint, TrimTarget, solve_trim, trim_target
from .trim_diagnosis import TrimDiagnosis, nearest_trims, trim_violations

__all__ = [
    "Capability",
    "TrimDiagnosis",
    "TrimPoint",
    "TrimTarget",
    "nearest_trims",
    "solve_trim",
    "trim_target",
    "trim_violations",
]
