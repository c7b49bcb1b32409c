"""Steady flight: trim, reasons why a trim does not exist, and performance limits."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
