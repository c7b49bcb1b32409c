"""Single aircraft: model with trim and linear model, performance sheet, simulated flight, and a simulator by steps."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
