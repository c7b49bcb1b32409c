from .analysis import linearize, trim
from .campaigns import campaign, compare_campaigns, load_campaign, rare
from .cli.console import progress_bar
from .identification.identify import identify
from .live.notebook import live
from .missions import load_flight, plan, run, sweep
from .parts.input_signals import doublet, multisine, sine_sweep, step_input, three_two_one_one
from .scenario import load, loads
from .single_aircraft.flight import simulate
from .single_aircraft.linear_feedback import LinearFeedback
from .single_aircraft.model import aircraft
from .single_aircraft.simulator import Simulator

__version__: str
__all__ = [
    "LinearFeedback",
    "Simulator",
    "aircraft",
    "campaign",
    "compare_campaigns",
    "doublet",
    "identify",
    "linearize",
    "live",
    "load",
    "load_campaign",
    "load_flight",
    "loads",
    "multisine",
    "plan",
    "progress_bar",
    "rare",
    "run",
    "simulate",
    "sine_sweep",
    "step_input",
    "sweep",
    "three_two_one_one",
    "trim",
]
