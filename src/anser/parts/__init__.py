"""Interfaces of the closed loop's parts (sensors, estimators, guidance, controllers, planners), and their signals."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
