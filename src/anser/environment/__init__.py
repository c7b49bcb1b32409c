"""Atmosphere, wind, gusts, turbulence, gravity and the Earth.

================  =====================================================================================================
``environment``   interface of wind fields; steady and layered wind; `Environment` of atmosphere, wind and Earth
``gridded_wind``  wind on a grid of a weather model
``atmosphere``    interface of the atmosphere, U.S. Standard Atmosphere 1976, off-standard days and soundings
``air``           tables of air layers; conversion between true, calibrated and equivalent airspeed
``earth``         flat and rotating Earth: gravity, local map (chart), terms of the equations of motion
``gusts``         interface of gust models, discrete gusts, and sums of gust models
``turbulence``    continuous turbulence with Dryden and von Karman spectra
``gust_filters``  shaping filters of the turbulence
================  =====================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
