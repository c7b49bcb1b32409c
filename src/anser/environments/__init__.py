"""Environments for reinforcement learning: flight tasks with observation, action, reward and automatic reset."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
