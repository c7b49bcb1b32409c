"""What surrounds an aircraft: the standard atmosphere, wind, gravity and the Earth, flat or round."""

from anser.environment.atmosphere import (
    AbstractAtmosphere,
    Air,
    StandardAtmosphere,
    geometric_from_geopotential,
    geopotential_from_geometric,
    is_within,
)
from anser.environment.earth import (
    AbstractEarth,
    FlatEarth,
    LocalEarth,
    RotatingEarth,
    spherical_earth,
    wgs84_earth,
)
from anser.environment.environment import Environment, standard_environment
from anser.environment.gravity import gravitation_j2, somigliana
from anser.environment.gusts import AbstractGusts, AirFlow, DiscreteGust, Gust, NoGusts, SummedGusts
from anser.environment.turbulence import Turbulence
from anser.environment.turbulence_levels import ExceedanceTable
from anser.environment.wind import AbstractWind, LayeredWind, SteadyWind, VaryingWind, steady_wind_from

__all__ = [
    "AbstractAtmosphere",
    "AbstractEarth",
    "AbstractGusts",
    "AbstractWind",
    "Air",
    "AirFlow",
    "DiscreteGust",
    "Environment",
    "ExceedanceTable",
    "FlatEarth",
    "Gust",
    "LayeredWind",
    "LocalEarth",
    "NoGusts",
    "RotatingEarth",
    "StandardAtmosphere",
    "SteadyWind",
    "SummedGusts",
    "Turbulence",
    "VaryingWind",
    "geometric_from_geopotential",
    "geopotential_from_geometric",
    "gravitation_j2",
    "is_within",
    "somigliana",
    "spherical_earth",
    "standard_environment",
    "steady_wind_from",
    "wgs84_earth",
]
