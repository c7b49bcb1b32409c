"""What surrounds an aircraft: the standard atmosphere, wind and gravity."""

from anser.environment.atmosphere import (
    AbstractAtmosphere,
    Air,
    StandardAtmosphere,
    geometric_from_geopotential,
    geopotential_from_geometric,
    is_within,
)
from anser.environment.environment import Environment, standard_environment
from anser.environment.gravity import somigliana
from anser.environment.wind import AbstractWind, SteadyWind, steady_wind_from

__all__ = [
    "AbstractAtmosphere",
    "AbstractWind",
    "Air",
    "Environment",
    "StandardAtmosphere",
    "SteadyWind",
    "geometric_from_geopotential",
    "geopotential_from_geometric",
    "is_within",
    "somigliana",
    "standard_environment",
    "steady_wind_from",
]
