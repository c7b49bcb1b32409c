"""The published planner: polynomial paths of equal length, flown in equal time so that the fleet arrives together.

================  ==================================================================================
``planner``       planner in flight: side of each detour, check of the paths against limits
``coordination``  common arrival time, one trajectory per aircraft, correction and replanning
``trajectory``    Hermite cubic with bends, its length, and the bend for a required length
``time_law``      path parameter over time: as published, or for an evenly changing airspeed
================  ==================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
