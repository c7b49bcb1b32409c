"""Units by their ANSI/AIAA S-119 names, conversion to SI, and the units permitted for standard variables.

Source: ANSI/AIAA S-119-2011, annex A.
"""

import functools
import re
from dataclasses import dataclass
from typing import Final

from anser.dave_ml.definition import Breakpoints, Definition, GriddedTable, UngriddedTable, Variable
from anser.dave_ml.elements import quote
from anser.units import DEG_RAD, FOOT_M, KNOT_M_S, LBF_N, NAUTICAL_MILE_M, POUND_KG, PSF_PA, RANKINE_K, SLUG_KG

_SYMBOLS: Final = ("m", "kg", "s", "rad", "K", "A")


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of measurement, with its conversion to SI: ``value_si = factor * value + offset``."""

    #: Conversion to metre, kilogram, second, radian, kelvin, ampere and derived units; percent to a fraction.
    factor: float
    offset: float = 0.0
    dimension: tuple[int, ...] = (0, 0, 0, 0, 0, 0)  #: Exponents of m, kg, s, rad, K and A.

    @property
    def si(self) -> str:
        """Name of the SI unit, such as ``m s^-2``; empty for a dimensionless number."""
        powers = zip(_SYMBOLS, self.dimension, strict=True)
        return " ".join(name if power == 1 else f"{name}^{power}" for name, power in powers if power)


def _unit(factor: float, si: str = "", offset: float = 0.0) -> Unit:
    powers = {symbol: int(power or 1) for symbol, _, power in (part.partition("^") for part in si.split())}
    return Unit(factor, offset, tuple(powers.get(symbol, 0) for symbol in _SYMBOLS))


_NEWTON, _PASCAL, _JOULE, _WATT = "m kg s^-2", "m^-1 kg s^-2", "m^2 kg s^-2", "m^2 kg s^-3"
_NAMED_UNITS: Final = {
    "m": _unit(1.0, "m"),
    "km": _unit(1e3, "m"),
    "cm": _unit(1e-2, "m"),
    "mm": _unit(1e-3, "m"),
    "ft": _unit(FOOT_M, "m"),
    "in": _unit(FOOT_M / 12.0, "m"),
    "nmi": _unit(NAUTICAL_MILE_M, "m"),
    "kg": _unit(1.0, "kg"),
    "slug": _unit(SLUG_KG, "kg"),
    "lbm": _unit(POUND_KG, "kg"),
    "s": _unit(1.0, "s"),
    "min": _unit(60.0, "s"),
    **dict.fromkeys(("h", "hr"), _unit(3600.0, "s")),
    "rad": _unit(1.0, "rad"),
    "deg": _unit(DEG_RAD, "rad"),
    "rev": _unit(360.0 * DEG_RAD, "rad"),
    **dict.fromkeys(("K", "degK"), _unit(1.0, "K")),
    "degR": _unit(RANKINE_K, "K"),
    "degC": _unit(1.0, "K", offset=273.15),
    "degF": _unit(RANKINE_K, "K", offset=459.67 * RANKINE_K),
    "N": _unit(1.0, _NEWTON),
    "kN": _unit(1e3, _NEWTON),
    "lbf": _unit(LBF_N, _NEWTON),
    "Pa": _unit(1.0, _PASCAL),
    "hPa": _unit(1e2, _PASCAL),
    "kPa": _unit(1e3, _PASCAL),
    "psf": _unit(PSF_PA, _PASCAL),
    "psi": _unit(144.0 * PSF_PA, _PASCAL),
    "J": _unit(1.0, _JOULE),
    "W": _unit(1.0, _WATT),
    "kW": _unit(1e3, _WATT),
    "hp": _unit(550.0 * FOOT_M * LBF_N, _WATT),
    "kt": _unit(KNOT_M_S, "m s^-1"),
    "Hz": _unit(1.0, "s^-1"),
    "A": _unit(1.0, "A"),
    "V": _unit(1.0, f"{_WATT} A^-1"),
    **dict.fromkeys(("nd", "ND", "non-dimensional", "nondimensional", "frac", "fract"), Unit(1.0)),
    "pct": Unit(0.01),
}
"""Named units; all other units are products and quotients of powers of these units."""
_LONGEST_FIRST: Final = sorted(_NAMED_UNITS, key=len, reverse=True)
_NAME_MAX: Final = 40


def parse_unit(name: str) -> Unit:
    """Return the unit of a name such as ``ft_s2``; an empty name is dimensionless. Raises ValueError if unknown."""
    unit = _parse_unit(name.strip()) if len(name) <= _NAME_MAX else None
    if unit is None:
        raise ValueError(
            f"unit {quote(name)}; known are {', '.join(_NAMED_UNITS)}, and products and quotients such as ft_s2"
        )
    return unit


def is_convertible(name: str, other_name: str) -> bool:
    """Whether two unit names have the same dimension or are equal; False for different names if a name is unknown."""
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
    """Split a text of adjacent unit names into units and powers, longer names first; return None if impossible.

    Without the cache, the parse time of some names grows exponentially.
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
    """Physical quantity of a standard variable, such as "a length", and its permitted units."""

    name: str
    units: tuple[str, ...]
    accepts_other_units: bool = True  #: True: all units of the dimension of `units` are permitted.

    def accepts(self, units: str) -> bool:
        """Whether a unit, as written in a file, is permitted for the quantity."""
        if units in self.units or not self.accepts_other_units:
            return units in self.units
        unit = _unit_or_none(units)
        return unit is not None and unit.dimension == parse_unit(self.units[0]).dimension


ANGLE: Final = Measure("an angle", ("rad", "deg"))
_DIMENSIONLESS: Final = Measure(
    "a number without a dimension", ("nd", "", "non-dimensional", "nondimensional", "ND"), accepts_other_units=False
)
_STANDARD_VARIABLES: Final[tuple[tuple[Measure, str], ...]] = (
    (ANGLE, "angleOfAttack angleOfSideslip flightPathAngle geLatitude geLongitude eulerAngle_RPY"),
    (ANGLE, "elevatorDeflection aileronDeflection rudderDeflection flapDeflection elevonDeflection spoilerDeflection"),
    (ANGLE, "leadingEdgeFlapDeflection trailingEdgeFlapDeflection canardDeflection speedbrakeDeflection"),
    (ANGLE, "stabilatorDeflection trueBaseCourseCommand"),
    (
        Measure("an angular rate", ("rad_s", "deg_s")),
        "angleOfAttackRate angleOfSideslipRate bodyAngularRate_RPY eulerAngleRate_RPY",
    ),
    (
        Measure("a speed", ("m_s", "ft_s", "kt")),
        "trueAirspeed equivalentAirspeed calibratedAirspeed indicatedAirspeed groundSpeed speedOfSound"
        " equivalentAirspeedCommand bodyVelocity_XYZ",
    ),
    (Measure("an acceleration", ("m_s2", "ft_s2")), "bodyAccel_XYZ"),
    (
        Measure("a length", ("m", "ft")),
        "altitudeMSL altitudeMsl altitudeMslCommand lateralDeviationError referenceWingSpan referenceWingChord"
        " bodyPositionOfCmWrtMrc_XYZ",
    ),
    (Measure("an area", ("m2", "ft2")), "referenceWingArea"),
    (Measure("a mass", ("kg", "slug", "lbm")), "totalMass"),
    (
        Measure("a moment or product of inertia", ("kgm2", "slugft2")),
        "bodyMomentOfInertia_RPY bodyProductOfInertia_XY bodyProductOfInertia_YZ bodyProductOfInertia_ZX",
    ),
    (Measure("a force", ("N", "lbf")), "aeroBodyForce_XYZ thrustBodyForce_XYZ"),
    (Measure("a moment of force", ("Nm", "ftlbf")), "aeroBodyMoment_RPY thrustBodyMoment_RPY"),
    (Measure("a density", ("kg_m3", "slug_ft3")), "airDensity"),
    (Measure("a pressure", ("Pa", "lbf_ft2")), "dynamicPressure ambientPressure totalPressure"),
    (Measure("a temperature", ("K", "degR")), "ambientTemperature totalTemperature"),
    (
        _DIMENSIONLESS,
        "mach totalCoefficientOfLift totalCoefficientOfDrag aeroBodyForceCoefficient_XYZ aeroBodyMomentCoefficient_RPY",
    ),
    (Measure("a share", ("pct", "frac", "fract"), accepts_other_units=False), "powerLeverAngle"),
)
"""Names of standard variables; `_XYZ` and `_RPY` stand for three names each, with the endings of `_AXES`."""
_AXES: Final = {"XYZ": ("X", "Y", "Z"), "RPY": ("Roll", "Pitch", "Yaw")}


def _names_of(pattern: str) -> list[str]:
    stem, _, axes = pattern.rpartition("_")
    return [f"{stem}_{axis}" for axis in _AXES[axes]] if axes in _AXES else [pattern]


STANDARD_MEASURES: Final[dict[str, Measure]] = {
    name: measure
    for measure, patterns in _STANDARD_VARIABLES
    for pattern in patterns.split()
    for name in _names_of(pattern)
}
"""Physical quantity of each standard variable, by name."""


def refuse_wrong_units(definition: Definition) -> None:
    """Raise DaveMlError if a standard variable or a table has wrong units.

    A standard variable needs a known unit of the right dimension. Units stated for a table must equal the units of the
    function's result; units stated for breakpoints must equal the units of the function's argument.
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
    """Raise DaveMlError if a variable's units are not permitted for the physical quantity `measure`."""
    if not measure.accepts(variable.units):
        units = " or ".join(quote(unit) for unit in measure.units)
        other_units = ", or another unit of it" if measure.accepts_other_units else ""
        arrived = f"units={quote(variable.units)} of {quote(variable.name)} (varID {quote(variable.id)})"
        raise variable.location.fault(arrived, f"{measure.name}: {units}{other_units}")


def _refuse_contradiction(part: Breakpoints | GriddedTable | UngriddedTable, variable: Variable | None) -> None:
    if variable is None or part.units in ("", variable.units):  # missing variables are reported elsewhere
        return
    part_unit, variable_unit = _unit_or_none(part.units), _unit_or_none(variable.units)
    if part_unit is not None and variable_unit is not None and part_unit != variable_unit:
        kind = "breakpoints" if isinstance(part, Breakpoints) else "table"
        arrived = f"units={quote(part.units)} of {kind} {quote(part.id)}"
        raise part.location.fault(arrived, f"those of its variable {quote(variable.id)}, {quote(variable.units)}")


def _unit_or_none(units: str) -> Unit | None:
    try:
        return parse_unit(units)
    except ValueError:
        return None
