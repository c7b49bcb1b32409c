from .analysis import linearize, trim
from .campaigns import campaign, compare_campaigns, rare
from .missions import load_flight, plan, run, sweep
from .scenario import load, loads

__version__: str
__all__ = [
    "campaign",
    "compare_campaigns",
    "linearize",
    "load",
    "load_flight",
    "loads",
    "plan",
    "rare",
    "run",
    "sweep",
    "trim",
]
