"""Compilation of JAX functions: compiler options, the programs of a process, and their storage on disk.

A program is a compiled function for arguments of certain shapes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
