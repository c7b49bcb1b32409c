"""Aircraft models: airframes, actuators, engines, and the six-degree-of-freedom equations of motion."""

import sys

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

sys.modules[__name__].__class__ = sys.modules["anser"].AircraftRoom
