"""Compiled programs: options, the programs of a process, and the store that keeps them on disk."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
