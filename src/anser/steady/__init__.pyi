from .trim import TrimPoint, TrimTarget, solve_trim, trim_target
from .trim_diagnosis import nearest_trims, trim_violations

__all__ = [
    "TrimPoint",
    "TrimTarget",
    "nearest_trims",
    "solve_trim",
    "trim_target",
    "trim_violations",
]
