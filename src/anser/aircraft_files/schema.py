"""The two kinds of aircraft file.

By stability derivatives and by DAVE-ML files (ANSI/AIAA S-119), validated, in the units of the file.
"""

import difflib
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from anser.aircraft_files.schema_aerodynamics import Aerodynamics, CoefficientTable, Engine
from anser.aircraft_files.schema_body import (
    ActuatedSurface,
    BodyVector,
    Check,
    Geometry,
    Mass,
    Surface,
    Validity,
    body_vector,
)
from anser.airframe_data import COEFFICIENTS, DERIVATIVE_ARGUMENTS, derivative_index
from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import SLUG_EXPECTED, SLUG_PATTERN, Table, expects, number, tables
from anser.config.tables import table as part

_TEXT = "a text in quotes"


class AnyAirframeFile(Table):
    """Name, source, engine, ranges and check data of an aircraft."""

    format: Literal[1] = Field(
        description="version of the file format", json_schema_extra=expects("1, the format that this anser reads")
    )
    name: str = Field(
        pattern=SLUG_PATTERN,
        max_length=64,
        description="name of the aircraft",
        json_schema_extra=expects(SLUG_EXPECTED),
    )
    description: str = Field("", description="what it is", json_schema_extra=expects(_TEXT))
    source: str = Field(min_length=1, description="where the numbers come from", json_schema_extra=expects(_TEXT))
    assumed: str = Field(
        "", description="which of them the source does not give, and why they are so", json_schema_extra=expects(_TEXT)
    )
    engine: Engine | None = part("engine; left out: none", "a table [engine]", None)
    validity: Validity = part("where the data hold", "a table [validity]")
    check: Check = part("what must come out", "a table [check]", Check())

    @property
    def has_engine(self) -> bool:
        """Whether anything drives it."""
        return self.engine is not None


def check_problems(check: Check, surfaces: Sequence[str]) -> list[Problem]:
    """Find deflections, in the check data of a file, of what is no surface of it."""
    found = []
    known = f"names of surfaces of this file ({', '.join(surfaces)})"
    for kind, checks in (("forces", check.forces), ("trim", check.trim)):
        for k, one in enumerate(checks):
            key = "surfaces_rad" if kind == "forces" else "surfaces_deg"
            unknown = [name for name in getattr(one, key) if name not in surfaces]
            found += [
                Problem(f"check.{kind}[{k}].{key}", f"the unknown key {describe_value(n)}", known) for n in unknown
            ]
    return found


def surface_problems(surface: Sequence[ActuatedSurface]) -> list[Problem]:
    """Find names given twice, and actuators of both orders."""
    found = []
    names = [one.name for one in surface]
    for k, one in enumerate(surface):
        if one.name in names[:k]:
            taken = f"{describe_value(one.name)}, already the name of surface[{names.index(one.name)}]"
            found.append(Problem(f"surface[{k}].name", taken, "a name of its own"))
        if (one.lag_s is None) != (surface[0].lag_s is None):
            way = "frequency_rad_s and damping" if surface[0].lag_s is None else "lag_s"
            words = f"{way}, as of the first surface: all actuators are of one order"
            found.append(
                Problem(f"surface[{k}].lag_s", "nothing" if one.lag_s is None else format_number(one.lag_s), words)
            )
    return found


_STATIC = {
    "alpha": tuple(DERIVATIVE_ARGUMENTS.index(one) for one in ("0", "_alpha", "_alpha2")),
    "beta": tuple(DERIVATIVE_ARGUMENTS.index(one) for one in ("_beta", "_beta2")),
}


class AirframeFile(AnyAirframeFile):
    """An aircraft by its derivatives; read one with :func:`anser.scenario.airframe_file.read_airframe`."""

    mass: Mass = part("mass and inertia", "a table [mass]")
    geometry: Geometry = part("reference lengths and area", "a table [geometry]")
    aerodynamics: Aerodynamics = part("stability derivatives", "a table [aerodynamics]")
    table: tuple[CoefficientTable, ...] = tables(
        "values over angles in the place of derivatives", "tables [[table]], in double brackets", at_least=0, default=()
    )
    surface: tuple[Surface, ...] = tables("control surfaces", "tables [[surface]], in double brackets", at_least=1)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the surfaces."""
        return tuple(one.name for one in self.surface)

    def consistency_problems(self) -> list[Problem]:
        """Find what is wrong between tables of the file."""
        own = [*surface_problems(self.surface), *self._table_problems()]
        return [*own, *check_problems(self.check, self.surfaces)]

    def _table_problems(self) -> list[Problem]:
        found = []
        inputs = ("alpha", "beta", *self.surfaces)
        for k, one in enumerate(self.table):
            for j, name in enumerate(one.over):
                if name not in inputs or name in one.over[:j]:
                    words = f"one of {', '.join(inputs)}, each once"
                    found.append(Problem(f"table[{k}].over[{j}]", describe_value(name), words))
            place = coefficient_index(one.replaces, self.surfaces)
            if place is None:
                near = difflib.get_close_matches(one.replaces, _replaceable(self.surfaces), n=1)
                words = "a coefficient (CL, CD, CY, Cl, Cm, Cn) or one of its derivatives, such as Cm_q"
                guess = f'perhaps "{near[0]}"; ' if near else ""
                found.append(Problem(f"table[{k}].replaces", describe_value(one.replaces), guess + words))
            else:
                found += self._overridden_derivatives(k, one, place)
        return found

    def _overridden_derivatives(self, k: int, table: CoefficientTable, place: tuple[int, int]) -> list[Problem]:
        """Find derivatives that stand beside a table that takes their place."""
        found = []
        row = COEFFICIENTS[place[0]]
        words = f"nothing, or 0: table[{k}] of {table.replaces} takes its place"
        for column in replaced_columns(table, place):
            if column < len(DERIVATIVE_ARGUMENTS):
                path, value = (
                    f"aerodynamics.{row}{DERIVATIVE_ARGUMENTS[column]}",
                    getattr(self.aerodynamics, row + DERIVATIVE_ARGUMENTS[column]),
                )
            else:
                n = column - len(DERIVATIVE_ARGUMENTS)
                path, value = f"surface[{n}].{row}", getattr(self.surface[n], row)
            if value != 0.0:
                found.append(Problem(path, format_number(value), words))
        surfaces = [name for name in table.over if name in self.surfaces] if table.replaces in COEFFICIENTS else []
        for name in surfaces:
            n = self.surfaces.index(name)
            if getattr(self.surface[n], row) != 0.0:
                found.append(Problem(f"surface[{n}].{row}", format_number(getattr(self.surface[n], row)), words))
        return found


def coefficient_index(name: str, surfaces: tuple[str, ...]) -> tuple[int, int] | None:
    """Row and column of what a table gives: `Cm` as a whole is that without a factor, as `Cm0`."""
    return derivative_index(f"{name}0" if name in COEFFICIENTS else name, surfaces)


def replaced_columns(table: CoefficientTable, place: tuple[int, int]) -> tuple[int, ...]:
    """Columns of the derivatives in whose place a table stands, surfaces of a whole coefficient left aside."""
    if table.replaces not in COEFFICIENTS:
        return (place[1],)
    return (0, *(column for name in table.over for column in _STATIC.get(name, ()) if column))


def _replaceable(surfaces: tuple[str, ...]) -> list[str]:
    return [
        row + column for row in COEFFICIENTS for column in ("", *DERIVATIVE_ARGUMENTS[1:], *(f"_{s}" for s in surfaces))
    ]


DAVE_ML_PARTS = ("aerodynamics", "inertia", "propulsion")
"""What a DAVE-ML file may be of."""
_PATH = 'the path of a DAVE-ML file, seen from the aircraft file, such as "my_aero.dml"'
_NAMES = 'a table such as { aeroBodyForceCoefficient_X = "CX" }: standard name = name or varID in the file'
_GIVEN = "a table of numbers by name or varID, in the units of the file, such as { vrsPositionOfCM = 25.0 }"


class DaveMlText(Table):
    """A DAVE-ML file, held whole: what flies is known without it."""

    file: str = Field(description="its name", json_schema_extra=expects("a text in quotes"))
    text: str = Field(description="what it says", json_schema_extra=expects("the text of a DAVE-ML file"))


class DaveMl(Table):
    """The files, and what connects their variables with the aircraft."""

    aerodynamics: DaveMlText = part("coefficients in body axes and reference lengths", _PATH)
    inertia: DaveMlText | None = part("mass, inertia and centre of mass; left out: [mass]", _PATH, None)
    propulsion: DaveMlText | None = part("thrust by power lever; left out: [engine], or no engine", _PATH, None)
    propulsion_lag_s: float | None = number(
        "time constant from throttle to power, with propulsion", 0, 60, "s", None, exclusive_minimum=True
    )
    cg_offset_m: BodyVector | None = body_vector(
        "centre of mass seen from the moment reference, with [mass]", "m", None
    )
    names: Annotated[dict[str, str], Field(strict=False)] = Field(
        default_factory=dict, description="names other than the standard ones", json_schema_extra=expects(_NAMES)
    )
    given: Annotated[dict[str, float], Field(strict=False)] = Field(
        default_factory=dict,
        description="inputs that stay as they are, such as the centre of gravity, a gear or a flap",
        json_schema_extra=expects(_GIVEN),
    )


class DaveMlSurface(ActuatedSurface):
    """A control surface: the input of the aerodynamics that it moves."""

    input: str | None = Field(
        None,
        description="name or varID of that input; left out: the surface's name and Deflection, as elevatorDeflection",
        json_schema_extra=expects("a text in quotes"),
    )

    @property
    def input_name(self) -> str:
        """The input that it moves."""
        return f"{self.name}Deflection" if self.input is None else self.input


class DaveMlFile(AnyAirframeFile):
    """An aircraft by DAVE-ML files; read one with :func:`anser.scenario.airframe_file.read_airframe`."""

    dave_ml: DaveMl = part("its DAVE-ML files", "a table [dave_ml]")
    mass: Mass | None = part("mass and inertia in the place of a file's", "a table [mass]", None)
    surface: tuple[DaveMlSurface, ...] = tables(
        "control surfaces", "tables [[surface]], in double brackets", at_least=1
    )

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the surfaces."""
        return tuple(one.name for one in self.surface)

    @property
    def has_engine(self) -> bool:
        """Whether a file of propulsion or a table [engine] drives it."""
        return self.dave_ml.propulsion is not None or self.engine is not None

    def consistency_problems(self) -> list[Problem]:
        """Find what is given twice or not at all, and what is wrong between tables of the file."""
        found, of = [], self.dave_ml
        if (of.inertia is None) == (self.mass is None):
            arrived = (
                "nothing" if self.mass is None else f"{describe_value(of.inertia and of.inertia.file)} beside [mass]"
            )
            found.append(Problem("dave_ml.inertia", arrived, "either a file of inertia or a table [mass]"))
        if of.cg_offset_m is not None and self.mass is None:
            words = "nothing: the file of inertia says where the centre of mass is"
            found.append(Problem("dave_ml.cg_offset_m", str(list(of.cg_offset_m)), words))
        if of.propulsion is not None and self.engine is not None:
            arrived = f"{describe_value(of.propulsion.file)} beside [engine]"
            found.append(Problem("dave_ml.propulsion", arrived, "either a file of propulsion or a table [engine]"))
        if (of.propulsion is None) != (of.propulsion_lag_s is None):
            arrived = "nothing" if of.propulsion_lag_s is None else f"{of.propulsion_lag_s:g} without propulsion"
            words = "a time constant beside a file of propulsion, which has none"
            found.append(Problem("dave_ml.propulsion_lag_s", arrived, words))
        for k, one in enumerate(self.check.forces):
            if one.instead:
                words = "nothing: a DAVE-ML file has no derivatives to set"
                found.append(Problem(f"check.forces[{k}].instead", "a table", words))
        return [*found, *surface_problems(self.surface), *check_problems(self.check, self.surfaces)]
