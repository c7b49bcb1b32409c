"""The published planner: polynomial paths of equal length, flown in equal time so that the fleet arrives together."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
