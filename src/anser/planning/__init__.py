"""Planners, and the quantities that every planner shares: limits, paths in time, separation, holds."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
