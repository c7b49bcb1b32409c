"""Holds: the motion after the arrival, around the goal or along a path that stays clear of the other holds.

``assignment`` chooses a hold for each aircraft of a fleet, ``hold_paths`` computes holds as paths over time,
``hold_around_goal`` is the guidance in the hold.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
