"""For which airspeeds, altitudes and Mach numbers the data of an aircraft hold."""

import math

import equinox as eqx

from anser.aircraft.air_data import AirData
from anser.numerics import as_array
from anser.shapes import Flag, Scalar


class Validity(eqx.Module):
    """Least and greatest values for which data hold; infinite where nothing bounds them.

    True airspeed (m/s), geometric altitude (m) and Mach number.
    """

    airspeed: tuple[Scalar, Scalar]
    altitude: tuple[Scalar, Scalar]
    mach: tuple[Scalar, Scalar]

    def excludes(self, air_data: AirData) -> Flag:
        """Whether one of the three lies outside."""
        return (
            outside(air_data.V, self.airspeed)
            | outside(air_data.altitude, self.altitude)
            | outside(air_data.mach, self.mach)
        )


def everywhere() -> Validity:
    """Validity that nothing bounds."""
    ends = as_array(-math.inf), as_array(math.inf)
    return Validity(ends, ends, ends)


def outside(value: Scalar, ends: tuple[Scalar, Scalar]) -> Flag:
    """Whether a value lies outside its least and greatest one."""
    return (value < ends[0]) | (value > ends[1])
