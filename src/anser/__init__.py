"""Fleets of fixed-wing aircraft that must be at moving places at the same time.

>>> import anser
>>> flown = anser.run(anser.load("scenarios/three-aircraft.toml"))
>>> flown.dataset.altitude_m, flown.summary["fleet"]["arrival_spread_s"]

Importing anser switches JAX to float64, which all of it needs, whether JAX is imported before or after it; anser itself
loads JAX only when something is used that computes with arrays.
"""

import importlib
import os
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anser.campaign import linearize, plan, run
    from anser.scenario import load, loads

if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)
else:
    os.environ["JAX_ENABLE_X64"] = "1"  # JAX reads it when it is imported

__version__ = "0.1.0"
__all__ = ["__version__", "linearize", "load", "loads", "plan", "run"]

_WHERE = {
    "linearize": "anser.campaign",
    "load": "anser.scenario",
    "loads": "anser.scenario",
    "plan": "anser.campaign",
    "run": "anser.campaign",
}


def __getattr__(name: str) -> Any:
    """Load the user's entry points on first use: the kernels need neither xarray nor pydantic."""
    if name not in _WHERE:
        raise AttributeError(f"module 'anser' has no attribute {name!r}")
    return getattr(importlib.import_module(_WHERE[name]), name)
