"""Simulation of fleets of fixed-wing aircraft that meet moving goals at a common time.

>>> import anser
>>> flown = anser.run(anser.load("scenarios/three-aircraft.toml"))
>>> flown.dataset.altitude_m, flown.summary["fleet"]["arrival_spread_s"]

The import of anser switches JAX to float64, on which the whole package depends. JAX itself is imported on the first use
of a function that computes with arrays.
"""

import os
import sys
import types
from typing import Any

import lazy_loader

if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)
else:
    os.environ["JAX_ENABLE_X64"] = "1"  # JAX reads it when it is imported

_public_object, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Import a public object of anser on its first use, or compute `__version__`."""
    if name == "__version__":
        from anser.version import source_version

        return source_version().version
    return _public_object(name)


class AircraftRoom(types.ModuleType):
    """Module type of the package `anser.aircraft` that makes the package callable: `anser.aircraft("f16")`.

    The function `anser.aircraft` loads an aircraft. An import of the package of the same name replaces the function; a
    call of the package then does what the function does.
    """

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Load an aircraft, with the arguments and errors of `anser.single_aircraft.aircraft`."""
        from anser.single_aircraft.model import aircraft

        return aircraft(*args, **kwargs)
