"""Autopilot by nonlinear dynamic inversion (gains, loops, control allocation), guidance, and DAVE-ML control laws."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
