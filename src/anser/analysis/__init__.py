"""Analyses of an aircraft with its autopilot: trim, linear models, margins, step tests, envelope, robustness."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
