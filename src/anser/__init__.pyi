from .campaigns import campaign, compare_campaigns, rare
from .execution import linearize, plan, run, sweep, trim
from .scenario import load, loads

__version__: str
__all__ = ["campaign", "compare_campaigns", "linearize", "load", "loads", "plan", "rare", "run", "sweep", "trim"]
