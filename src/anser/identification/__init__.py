"""Identification of an aircraft from recorded flights: parameters with confidence intervals, and planned manoeuvres."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
