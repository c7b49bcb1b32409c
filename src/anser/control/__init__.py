"""Autopilot by nonlinear dynamic inversion (gains, three loops, control allocation) and guidance."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
