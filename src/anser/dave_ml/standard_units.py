"""Units by their ANSI/AIAA S-119 names, and the units permitted for standard variables.

Source: ANSI/AIAA S-119-2011, annex A.
"""

import functools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from anser.dave_ml.definition import Breakpoints, Definition, GriddedTable, UngriddedTable, Variable
from anser.dave_ml.elements import quote
from anser.units import DEG_RAD, FOOT_M, KNOT_M_S, LBF_N, NAUTICAL_MILE_M, POUND_KG, PSF_PA, RANKINE_K, SLUG_KG

_INCH_M: Final = FOOT_M / 12.0
_M, _KG, _S, _RAD, _K, _A = range(6)
_SYMBOLS: Final = ("m", "kg", "s", "rad", "K", "A")


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of measurement with its conversion to SI: ``value_si = factor * value + offset``.

    Attributes
    ----------
    factor, offset
        Conversion to metre, kilogram, second, radian, kelvin, ampere and derived units; percent to a fraction.
    dimension
        Exponents of m, kg, s, rad, K and A.
    """

    factor: float
    offset: float = 0.0
    dimension: tuple[int, ...] = (0, 0, 0, 0, 0, 0)

    @property
    def si(self) -> str:
        """Name of the SI unit, such as ``m s^-2``; empty for a dimensionless number."""
        powers = zip(_SYMBOLS, self.dimension, strict=True)
        return " ".join(name if power == 1 else f"{name}^{power}" for name, power in powers if power)


def _unit(factor: float, *powers: tuple[int, int], offset: float = 0.0) -> Unit:
    dimension = [0] * len(_SYMBOLS)
    for base, power in powers:
        dimension[base] = power
    return Unit(factor, offset, tuple(dimension))


_FORCE_DIMENSION: Final = ((_M, 1), (_KG, 1), (_S, -2))
_PRESSURE_DIMENSION: Final = ((_M, -1), (_KG, 1), (_S, -2))
_POWER_DIMENSION: Final = ((_M, 2), (_KG, 1), (_S, -3))

_NAMED_UNITS: Final = {
    "m": _unit(1.0, (_M, 1)),
    "km": _unit(1e3, (_M, 1)),
    "cm": _unit(1e-2, (_M, 1)),
    "mm": _unit(1e-3, (_M, 1)),
    "ft": _unit(FOOT_M, (_M, 1)),
    "in": _unit(_INCH_M, (_M, 1)),
    "nmi": _unit(NAUTICAL_MILE_M, (_M, 1)),
    "kg": _unit(1.0, (_KG, 1)),
    "slug": _unit(SLUG_KG, (_KG, 1)),
    "lbm": _unit(POUND_KG, (_KG, 1)),
    "s": _unit(1.0, (_S, 1)),
    "min": _unit(60.0, (_S, 1)),
    "h": _unit(3600.0, (_S, 1)),
    "hr": _unit(3600.0, (_S, 1)),
    "rad": _unit(1.0, (_RAD, 1)),
    "deg": _unit(DEG_RAD, (_RAD, 1)),
    "rev": _unit(360.0 * DEG_RAD, (_RAD, 1)),
    "K": _unit(1.0, (_K, 1)),
    "degK": _unit(1.0, (_K, 1)),
    "degR": _unit(RANKINE_K, (_K, 1)),
    "degC": _unit(1.0, (_K, 1), offset=273.15),
    "degF": _unit(RANKINE_K, (_K, 1), offset=459.67 * RANKINE_K),
    "N": _unit(1.0, *_FORCE_DIMENSION),
    "kN": _unit(1e3, *_FORCE_DIMENSION),
    "lbf": _unit(LBF_N, *_FORCE_DIMENSION),
    "Pa": _unit(1.0, *_PRESSURE_DIMENSION),
    "hPa": _unit(1e2, *_PRESSURE_DIMENSION),
    "kPa": _unit(1e3, *_PRESSURE_DIMENSION),
    "psf": _unit(PSF_PA, *_PRESSURE_DIMENSION),
    "psi": _unit(144.0 * PSF_PA, *_PRESSURE_DIMENSION),
    "J": _unit(1.0, (_M, 2), (_KG, 1), (_S, -2)),
    "W": _unit(1.0, *_POWER_DIMENSION),
    "kW": _unit(1e3, *_POWER_DIMENSION),
    "hp": _unit(550.0 * FOOT_M * LBF_N, *_POWER_DIMENSION),
    "kt": _unit(KNOT_M_S, (_M, 1), (_S, -1)),
    "Hz": _unit(1.0, (_S, -1)),
    "A": _unit(1.0, (_A, 1)),
    "V": _unit(1.0, *_POWER_DIMENSION, (_A, -1)),
    "nd": Unit(1.0),
    "ND": Unit(1.0),
    "non-dimensional": Unit(1.0),
    "nondimensional": Unit(1.0),
    "frac": Unit(1.0),
    "fract": Unit(1.0),
    "pct": Unit(0.01),
}
"""Units with a name of their own; other units are products of powers of these."""
_LONGEST_FIRST: Final = sorted(_NAMED_UNITS, key=len, reverse=True)
_NAME_MAX: Final = 40


def parse_unit(name: str) -> Unit:
    """Parse a unit's name; an empty name is dimensionless.

    Raises
    ------
    ValueError
        If the name is unknown.
    """
    unit = _parse_unit(name.strip()) if len(name) <= _NAME_MAX else None
    if unit is None:
        raise ValueError(
            f"unit {quote(name)}; known are {', '.join(_NAMED_UNITS)}, and products and quotients such as ft_s2"
        )
    return unit


def is_convertible(name: str, other_name: str) -> bool:
    """Whether two units can be converted: the same dimension, or the same name, known or not."""
    if name == other_name:
        return True
    try:
        return parse_unit(name).dimension == parse_unit(other_name).dimension
    except ValueError:
        return False


@functools.lru_cache(maxsize=1024)
def _parse_unit(name: str) -> Unit | None:
    if name in ("", *_NAMED_UNITS):
        return _NAMED_UNITS.get(name, Unit(1.0))
    parts = name.replace("/", "_").split("_")
    if len(parts) > 2:
        return None
    factor, dimension = 1.0, [0] * len(_SYMBOLS)
    for part, sign in zip(parts, (1, -1), strict=False):
        product = _product(part) if part else ()
        if product is None:
            return None
        for unit, power in product:
            factor *= unit.factor ** (sign * power)
            dimension = [
                exponent + sign * power * unit_exponent
                for exponent, unit_exponent in zip(dimension, unit.dimension, strict=True)
            ]
    return Unit(factor, 0.0, tuple(dimension))


@functools.lru_cache(maxsize=4096)
def _product(text: str) -> tuple[tuple[Unit, int], ...] | None:
    """Split a text into adjacent unit names, each with a power; longer names match first. None if impossible.

    Cached for every tail of a text: without the cache, the parse time of some names grows exponentially.
    """
    if not text:
        return ()
    for name in _LONGEST_FIRST:
        matched = re.match(f"{name}([2-9]?)", text)
        if matched is None:
            continue
        remaining_units = _product(text[matched.end() :])
        if remaining_units is not None:
            return ((_NAMED_UNITS[name], int(matched[1] or 1)), *remaining_units)
    return None


@dataclass(frozen=True, slots=True)
class Measure:
    """Physical quantity of a standard variable, and its permitted units.

    Attributes
    ----------
    name
        Quantity with an article, as in messages.
    units
        Permitted units.
    accepts_other_units
        Whether other units of the same dimension are permitted.
    """

    name: str
    units: tuple[str, ...]
    accepts_other_units: bool = True

    def accepts(self, units: str) -> bool:
        """Whether a unit, as written in a file, is permitted."""
        if units in self.units or not self.accepts_other_units:
            return units in self.units
        unit = _unit_or_none(units)
        return unit is not None and unit.dimension == parse_unit(self.units[0]).dimension


ANGLE: Final = Measure("an angle", ("rad", "deg"))
DIMENSIONLESS: Final = Measure(
    "a number without a dimension", ("nd", "", "non-dimensional", "nondimensional", "ND"), accepts_other_units=False
)
_RATE: Final = Measure("an angular rate", ("rad_s", "deg_s"))
_LENGTH: Final = Measure("a length", ("m", "ft"))
_AREA: Final = Measure("an area", ("m2", "ft2"))
_SPEED: Final = Measure("a speed", ("m_s", "ft_s", "kt"))
_ACCELERATION: Final = Measure("an acceleration", ("m_s2", "ft_s2"))
_MASS: Final = Measure("a mass", ("kg", "slug", "lbm"))
_INERTIA: Final = Measure("a moment or product of inertia", ("kgm2", "slugft2"))
_FORCE: Final = Measure("a force", ("N", "lbf"))
_MOMENT: Final = Measure("a moment of force", ("Nm", "ftlbf"))
_DENSITY: Final = Measure("a density", ("kg_m3", "slug_ft3"))
_PRESSURE: Final = Measure("a pressure", ("Pa", "lbf_ft2"))
_TEMPERATURE: Final = Measure("a temperature", ("K", "degR"))
_PERCENT: Final = Measure("a share", ("pct", "frac", "fract"), accepts_other_units=False)

_XYZ, _TURNS = ("X", "Y", "Z"), ("Roll", "Pitch", "Yaw")


def _each(measure: Measure, *names: str) -> dict[str, Measure]:
    return dict.fromkeys(names, measure)


def _along(measure: Measure, endings: Iterable[str], *names: str) -> dict[str, Measure]:
    return {f"{name}_{ending}": measure for name in names for ending in endings}


STANDARD_MEASURES: Final[dict[str, Measure]] = {
    **_each(ANGLE, "angleOfAttack", "angleOfSideslip", "flightPathAngle", "geLatitude", "geLongitude"),
    **_each(ANGLE, "trueBaseCourseCommand"),
    **_along(ANGLE, _TURNS, "eulerAngle"),
    **_each(
        ANGLE,
        *(f"{name}Deflection" for name in ("elevator", "aileron", "rudder", "flap", "elevon", "spoiler", "canard")),
        *(f"{name}Deflection" for name in ("leadingEdgeFlap", "trailingEdgeFlap", "speedbrake", "stabilator")),
    ),
    **_each(_RATE, "angleOfAttackRate", "angleOfSideslipRate"),
    **_along(_RATE, _TURNS, "bodyAngularRate", "eulerAngleRate"),
    **_each(_SPEED, "trueAirspeed", "equivalentAirspeed", "calibratedAirspeed", "indicatedAirspeed", "groundSpeed"),
    **_each(_SPEED, "speedOfSound", "equivalentAirspeedCommand"),
    **_along(_SPEED, _XYZ, "bodyVelocity"),
    **_along(_ACCELERATION, _XYZ, "bodyAccel"),
    **_each(_LENGTH, "altitudeMSL", "altitudeMsl", "altitudeMslCommand", "lateralDeviationError"),
    **_each(_LENGTH, "referenceWingSpan", "referenceWingChord"),
    **_along(_LENGTH, _XYZ, "bodyPositionOfCmWrtMrc"),
    **_each(_AREA, "referenceWingArea"),
    **_each(_MASS, "totalMass"),
    **_along(_INERTIA, _TURNS, "bodyMomentOfInertia"),
    **_along(_INERTIA, ("XY", "YZ", "ZX"), "bodyProductOfInertia"),
    **_along(_FORCE, _XYZ, "aeroBodyForce", "thrustBodyForce"),
    **_along(_MOMENT, _TURNS, "aeroBodyMoment", "thrustBodyMoment"),
    **_each(_DENSITY, "airDensity"),
    **_each(_PRESSURE, "dynamicPressure", "ambientPressure", "totalPressure"),
    **_each(_TEMPERATURE, "ambientTemperature", "totalTemperature"),
    **_each(DIMENSIONLESS, "mach", "totalCoefficientOfLift", "totalCoefficientOfDrag"),
    **_along(DIMENSIONLESS, _XYZ, "aeroBodyForceCoefficient"),
    **_along(DIMENSIONLESS, _TURNS, "aeroBodyMomentCoefficient"),
    **_each(_PERCENT, "powerLeverAngle"),
}
"""Physical quantity of each standard variable, by name.

`powerLeverAngle` is a fraction of full power: an angle would not define the thrust."""


def refuse_wrong_units(definition: Definition) -> None:
    """Raise DaveMlError if a standard variable or a table has wrong units.

    A standard variable needs a known unit of the right dimension. Breakpoints and table values are in the units of
    their variables; units on the table itself may only repeat them.
    """
    for variable in definition.variables.values():
        refuse_nonstandard_units(variable)
    for function in definition.functions:
        table = definition.gridded.get(function.table) or definition.ungridded[function.table]
        _refuse_contradiction(table, definition.variables.get(function.result))
        if isinstance(table, GriddedTable):
            for argument, axis in zip(function.arguments, table.axes, strict=True):
                _refuse_contradiction(definition.breakpoints[axis], definition.variables.get(argument.id))


def refuse_nonstandard_units(variable: Variable) -> None:
    """Raise DaveMlError if a standard variable has units of another physical quantity."""
    measure = STANDARD_MEASURES.get(variable.name)
    if measure is not None:
        refuse_other_units(variable, measure)


def refuse_other_units(variable: Variable, measure: Measure) -> None:
    """Raise DaveMlError if a variable's units are not units of the given physical quantity."""
    if not measure.accepts(variable.units):
        units = " or ".join(quote(unit) for unit in measure.units)
        other_units = ", or another unit of it" if measure.accepts_other_units else ""
        arrived = f"units={quote(variable.units)} of {quote(variable.name)} (varID {quote(variable.id)})"
        raise variable.location.fault(arrived, f"{measure.name}: {units}{other_units}")


def _refuse_contradiction(part: Breakpoints | GriddedTable | UngriddedTable, variable: Variable | None) -> None:
    if variable is None or part.units in ("", variable.units):  # missing variables are reported elsewhere
        return
    part_unit, variable_unit = _unit_or_none(part.units), _unit_or_none(variable.units)
    if part_unit is None or variable_unit is None:
        return
    if (part_unit.dimension, part_unit.factor, part_unit.offset) != (
        variable_unit.dimension,
        variable_unit.factor,
        variable_unit.offset,
    ):
        kind = "breakpoints" if isinstance(part, Breakpoints) else "table"
        arrived = f"units={quote(part.units)} of {kind} {quote(part.id)}"
        raise part.location.fault(arrived, f"those of its variable {quote(variable.id)}, {quote(variable.units)}")


def _unit_or_none(units: str) -> Unit | None:
    try:
        return parse_unit(units)
    except ValueError:
        return None
