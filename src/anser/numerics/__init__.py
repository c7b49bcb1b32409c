"""Numerical methods in JAX: arrays, roots, least squares, integration, tables, polynomials and random numbers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
