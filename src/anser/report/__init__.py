"""Reports (HTML pages), figures and exports of flights, plans, studies and campaigns, from their datasets."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
