"""Reports, drawn from datasets alone: a flight or a campaign as one self-contained page, figures of much else.

Functions that draw into files never overwrite one: they raise FileExistsError, and ImportError without matplotlib. The
folder that they draw into must exist.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
