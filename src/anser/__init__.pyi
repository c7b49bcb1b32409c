from .campaigns import campaign, rare
from .execution import linearize, plan, run, sweep, trim
from .scenario import load, loads

__version__: str
__all__ = ["campaign", "linearize", "load", "loads", "plan", "rare", "run", "sweep", "trim"]
