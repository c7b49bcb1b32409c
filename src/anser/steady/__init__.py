"""Steady flight: trim, reasons why a trim does not exist, and performance limits.

==================  ====================================================================================================
``trim``            trim of any airframe, and points of a trim map with obstacles and margins
``trim_diagnosis``  violated limits, and the nearest flight conditions with a trim
``performance``     accelerations along the path, and limits of steady flight with a reserve
==================  ====================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
