from .campaigns import campaign, compare_campaigns, rare
from .execution import linearize, load_flight, plan, run, sweep, trim
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
