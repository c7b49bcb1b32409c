"""Scenarios planned and flown: single flights, batches, sweeps and saved flights."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
