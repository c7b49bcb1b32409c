"""Holds: the motion after the arrival, around the goal or along a path that stays clear of the other holds."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
