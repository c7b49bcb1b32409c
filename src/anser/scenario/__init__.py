"""Scenario files: their tables (schema_*), checks, and the construction of a flight from a scenario (build_*)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
