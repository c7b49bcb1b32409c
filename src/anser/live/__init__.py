"""The live page: a scenario edited in the browser, planned at once, flown and saved; served on this machine only."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
