"""Sensors of the vehicle and of its goal, filters, and ideal perception."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
