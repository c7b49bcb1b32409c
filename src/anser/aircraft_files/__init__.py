"""Aircraft files: their schema, where they come from, the airframes built from them, and checks of their data.

A new kind of engine needs a table in schema_tables (and its place in `Engine`), its construction in build
(`build_engine`), and its thrust factor in `anser.aircraft.dispersions`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
