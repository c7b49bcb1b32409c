from .integration import rk4_step
from .randomness import AbstractRandomness, PrescribedRandomness, flight_randomness
from .tables import Axes, Tables, make_axes, make_tables

__all__ = [
    "AbstractRandomness",
    "Axes",
    "PrescribedRandomness",
    "Tables",
    "flight_randomness",
    "make_axes",
    "make_tables",
    "rk4_step",
]
