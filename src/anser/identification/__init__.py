"""Identification of an aircraft from flight records: estimators in batch, their bounds, and planned experiments."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
