"""Reference frames, rotations, flow and path angles, and positions on the Earth."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
