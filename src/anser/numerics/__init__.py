"""Numerical methods in JAX: arrays, root finding, least squares, integration, tables and random numbers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
