from .air import calibrated_from_true, true_from_calibrated
from .atmosphere import AbstractAtmosphere, Air, StandardAtmosphere
from .earth import AbstractEarth, FlatEarth, RotatingEarth, wgs84_earth
from .environment import AbstractWind, Environment, LayeredWind, SteadyWind, standard_environment
from .gusts import AbstractGusts, DiscreteGust
from .turbulence import Turbulence

__all__ = [
    "AbstractAtmosphere",
    "AbstractEarth",
    "AbstractGusts",
    "AbstractWind",
    "Air",
    "DiscreteGust",
    "Environment",
    "FlatEarth",
    "LayeredWind",
    "RotatingEarth",
    "StandardAtmosphere",
    "SteadyWind",
    "Turbulence",
    "calibrated_from_true",
    "standard_environment",
    "true_from_calibrated",
    "wgs84_earth",
]
