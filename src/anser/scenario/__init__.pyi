from .build import build_flight
from .files import convert, load, loads, write_starter
from .schema import Scenario, scenario_hash, validate

__all__ = [
    "Scenario",
    "build_flight",
    "convert",
    "load",
    "loads",
    "scenario_hash",
    "validate",
    "write_starter",
]
