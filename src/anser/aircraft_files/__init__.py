"""Aircraft files: their schema, where they come from, the airframes built from them, and checks of their data.

A new kind of engine needs a table and a field of `Engine` in `schema_tables`, and construction by `build_engine` in
`build`. The engine class needs the fields `thrust_factor` and `point_b`, or a method `dispersed`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
