"""The closed loop of one aircraft and of a fleet, with its recorders and running summaries."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
