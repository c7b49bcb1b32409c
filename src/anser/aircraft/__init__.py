"""Airframes, actuators and engines: forces, moments and their derivatives in state space."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
