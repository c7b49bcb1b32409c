"""What the standard names of variables measure, and in which units a file may give it (ANSI/AIAA S-119-2011, annex A).

The names here are those that aircraft, engines and control laws are read by, and their nearest relatives.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from anser.dave_ml.definition import Breakpoints, Definition, GriddedTable, UngriddedTable, Variable
from anser.dave_ml.errors import shown
from anser.dave_ml.unit_names import Unit, unit_of


@dataclass(frozen=True, slots=True)
class Measure:
    """A physical quantity as files give it.

    Attributes
    ----------
    name
        In words.
    units
        Units that it may have.
    has_others
        Whether all other units of the same dimension will do, too.
    """

    name: str
    units: tuple[str, ...]
    has_others: bool = True

    def accepts(self, units: str) -> bool:
        """Whether units, as a file writes them, are those of this quantity."""
        if units in self.units or not self.has_others:
            return units in self.units
        unit = _known(units)
        return unit is not None and unit.dimension == unit_of(self.units[0]).dimension


ANGLE: Final = Measure("an angle", ("rad", "deg"))
NUMBER: Final = Measure(
    "a number without a dimension", ("nd", "", "non-dimensional", "nondimensional", "ND"), has_others=False
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
_PERCENT: Final = Measure("a share", ("pct", "frac", "fract"), has_others=False)

_XYZ, _TURNS = ("X", "Y", "Z"), ("Roll", "Pitch", "Yaw")


def _each(measure: Measure, *names: str) -> dict[str, Measure]:
    return dict.fromkeys(names, measure)


def _along(measure: Measure, endings: Iterable[str], *names: str) -> dict[str, Measure]:
    return {f"{name}_{ending}": measure for name in names for ending in endings}


STANDARD: Final[dict[str, Measure]] = {
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
    **_each(NUMBER, "mach", "totalCoefficientOfLift", "totalCoefficientOfDrag"),
    **_along(NUMBER, _XYZ, "aeroBodyForceCoefficient"),
    **_along(NUMBER, _TURNS, "aeroBodyMomentCoefficient"),
    **_each(_PERCENT, "powerLeverAngle"),
}
"""Measures by name. `powerLeverAngle` is a share of the full one: its angle would say nothing of the thrust."""


def refuse_wrong_units(definition: Definition) -> None:
    """Raise DaveMlError if a variable of a standard name has units of something else, or a table those of another axis.

    A unit of another dimension, an unknown one, or none where the quantity has a dimension is refused. The breakpoints
    and values of tables are in the units of their variables; units of their own may only repeat them.
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
    """Raise DaveMlError if a variable of a standard name has units of something else."""
    measure = STANDARD.get(variable.name)
    if measure is not None:
        refuse_other_units(variable, measure)


def refuse_other_units(variable: Variable, measure: Measure) -> None:
    """Raise DaveMlError if the units of a variable are none of a quantity."""
    if not measure.accepts(variable.units):
        units = " or ".join(shown(one) for one in measure.units)
        others = ", or another unit of it" if measure.has_others else ""
        arrived = f"units={shown(variable.units)} of {shown(variable.name)} (varID {shown(variable.id)})"
        raise variable.place.fault(arrived, f"{measure.name}: {units}{others}")


def _refuse_contradiction(part: Breakpoints | GriddedTable | UngriddedTable, variable: Variable | None) -> None:
    if variable is None or part.units in ("", variable.units):  # a variable that is not there is told elsewhere
        return
    own, of_variable = _known(part.units), _known(variable.units)
    if own is None or of_variable is None:
        return
    if (own.dimension, own.factor, own.offset) != (of_variable.dimension, of_variable.factor, of_variable.offset):
        kind = "breakpoints" if isinstance(part, Breakpoints) else "table"
        arrived = f"units={shown(part.units)} of {kind} {shown(part.id)}"
        raise part.place.fault(arrived, f"those of its variable {shown(variable.id)}, {shown(variable.units)}")


def _known(units: str) -> Unit | None:
    try:
        return unit_of(units)
    except ValueError:
        return None
