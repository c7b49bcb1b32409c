"""Compiled programs: compiler options, the program cache of a process, and the program store on disk."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
