"""Campaigns: a scenario flown many times with numbers of it dispersed, kept in a store, and what follows from it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
