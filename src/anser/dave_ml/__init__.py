"""DAVE-ML (AIAA S-119) aerodynamic models: reading, evaluating, checking and writing."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
