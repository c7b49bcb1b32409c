from .flight import AircraftFlight, simulate
from .input_signals import InputSignal, doublet, multisine, sine_sweep, step_input, three_two_one_one
from .model import AircraftModel, aircraft
from .performance import PerformanceSheet
from .simulator import Simulator

__all__ = [
    "AircraftFlight",
    "AircraftModel",
    "InputSignal",
    "PerformanceSheet",
    "Simulator",
    "aircraft",
    "doublet",
    "multisine",
    "simulate",
    "sine_sweep",
    "step_input",
    "three_two_one_one",
]
