"""Numbers that arrive as a text with a unit, or as a point of the compass: what they are in the unit asked for."""

import re

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.units import DEG_RAD, FOOT_M, FOOT_PER_MINUTE_M_S, KNOT_M_S, NAUTICAL_MILE_M, POUND_KG, SLUG_KG

_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\D.*?)?\s*")
_MILE_M = 5280.0 * FOOT_M
_UNITS = {
    "length": {"m": 1.0, "km": 1e3, "ft": FOOT_M, "nmi": NAUTICAL_MILE_M, "nm": NAUTICAL_MILE_M, "mi": _MILE_M},
    "speed": {
        "m/s": 1.0,
        "km/h": 1.0 / 3.6,
        "kph": 1.0 / 3.6,
        "mph": _MILE_M / 3600.0,
        "ft/s": FOOT_M,
        **dict.fromkeys(("kt", "kts", "kn", "knot", "knots"), KNOT_M_S),
        **dict.fromkeys(("fpm", "ft/min"), FOOT_PER_MINUTE_M_S),
    },
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "angle": {"deg": DEG_RAD, "\N{DEGREE SIGN}": DEG_RAD, "rad": 1.0, "mrad": 1e-3},
    "rate": {"deg/s": DEG_RAD, "rad/s": 1.0},
    "acceleration": {"m/s^2": 1.0, "m/s2": 1.0, "ft/s^2": FOOT_M, "g": STANDARD_GRAVITY_M_S2},
    "mass": {"kg": 1.0, "lb": POUND_KG, "slug": SLUG_KG},
}
"""Factors to SI by dimension; small letters."""

_POINTS = ("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW")
"""Points of the compass, each 22.5 deg clockwise of the one before."""


def in_unit(text: str, unit: str) -> str:
    """What to write instead of a text, such as `; 9 kt is 4.63 m/s: write 4.63`; empty where nobody can tell.

    Parameters
    ----------
    text
        What arrived where a number is expected.
    unit
        Of that number, as messages write it; empty for a pure number.
    """
    found = _NUMBER_AND_UNIT.fullmatch(text)
    if found is None:
        point = text.strip()
        if unit != "deg" or point.upper() not in _POINTS:
            return ""
        angle = f"{22.5 * _POINTS.index(point.upper()):g}"
        return f"; {point} is {angle} deg clockwise from north: write {angle}"
    number, given = found.groups()
    if given is None or given.lower() == unit:
        return f"; write {number}, without quotes"
    for factors in _UNITS.values():
        if given.lower() in factors and unit in factors:
            converted = f"{float(number) * factors[given.lower()] / factors[unit]:.6g}"
            return f"; {number} {given} is {converted} {unit}: write {converted}"
    return ""
