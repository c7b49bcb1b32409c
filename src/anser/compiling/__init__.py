"""Compilation of JAX functions: compiler options, compiled programs in memory, and their storage on disk.

A program is a compiled function for arguments of certain shapes.

==================  ==================================================================================================
``options``         decorators that compile functions, division of a batch among threads, the user's cache folder
``program``         look-up, tracing and compilation of programs; limit of the memory that the programs use
``keys``            keys of stored programs: hashes of everything on which the machine code depends
``store``           programs in a folder on disk
``executables``     conversion of programs to bytes, and loading of machine code
``single_kernel``   small computations as one CPU kernel
``measuring``       size and CPU time of each compilation, and the time left
==================  ==================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
