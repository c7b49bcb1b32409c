"""Compilation of JAX functions: compiler options, the programs of a process, and their storage on disk.

A program is a compiled function for arguments of certain shapes.

==================  ==================================================================================================
``options``         decorators that make programs of functions, threads for a batch, and the user's cache folder
``program``         class of a program: look-up, tracing, compilation in the background, limit of the memory
``keys``            keys of stored programs: hashes of everything on which the machine code depends
``store``           programs in a folder on disk
``executables``     machine code as bytes, and its loading
``single_kernel``   small computations as one CPU kernel
``measuring``       size and CPU time of each compilation, and the time left
==================  ==================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
