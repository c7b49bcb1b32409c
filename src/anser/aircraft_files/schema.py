"""Schema of the two kinds of aircraft file: by stability derivatives, or by DAVE-ML files (ANSI/AIAA S-119).

Values are validated and stay in the units of the file.
"""

import difflib
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from anser.aircraft_files.schema_tables import (
    ActuatedSurface,
    Aerodynamics,
    BodyVector,
    ByName,
    Check,
    CoefficientTable,
    Engine,
    Geometry,
    Mass,
    Surface,
    Validity,
    body_vector,
    by_name,
    positive,
    text_field,
)
from anser.airframe_data import COEFFICIENTS, DERIVATIVE_ARGUMENTS, derivative_index
from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import Table, expects, slug, tables
from anser.config.tables import table as part


class AnyAirframeFile(Table):
    """Keys common to both kinds of aircraft file: name, source, engine, valid ranges and check data."""

    format: Literal[1] = Field(
        description="version of the file format", json_schema_extra=expects("1, the format that this anser reads")
    )
    name: str = slug("name of the aircraft")
    description: str = text_field("short description", "")
    source: str = Field(
        min_length=1, description="source of the numbers", json_schema_extra=expects("a text in quotes")
    )
    assumed: str = text_field("assumed numbers that the source does not give, with reasons", "")
    engine: Engine | None = part("engine; left out: none", "a table [engine]", None)
    validity: Validity = part("range of validity of the data", "a table [validity]")
    check: Check = part("check data", "a table [check]", Check())

    @property
    def has_engine(self) -> bool:
        """Whether the aircraft has an engine."""
        return self.engine is not None


def check_problems(check: Check, surfaces: Sequence[str]) -> list[Problem]:
    """List the deflections in check data whose surface is not among the aircraft's `surfaces`."""
    problems = []
    expected = f"names of surfaces of this file ({', '.join(surfaces)})"
    for kind, checks in (("forces", check.forces), ("trim", check.trim)):
        for k, check_case in enumerate(checks):
            key = "surfaces_rad" if kind == "forces" else "surfaces_deg"
            unknown = [name for name in getattr(check_case, key) if name not in surfaces]
            problems += [
                Problem(f"check.{kind}[{k}].{key}", f"the unknown key {describe_value(n)}", expected) for n in unknown
            ]
    return problems


def surface_problems(surface: Sequence[ActuatedSurface]) -> list[Problem]:
    """List repeated surface names, and surfaces with actuators of another order than the first surface's."""
    problems = []
    names = [item.name for item in surface]
    for k, item in enumerate(surface):
        if item.name in names[:k]:
            arrived = f"{describe_value(item.name)}, already the name of surface[{names.index(item.name)}]"
            problems.append(Problem(f"surface[{k}].name", arrived, "a name of its own"))
        if (item.lag_s is None) != (surface[0].lag_s is None):
            arrived = "nothing" if item.lag_s is None else format_number(item.lag_s)
            expected_keys = "frequency_rad_s and damping" if surface[0].lag_s is None else "lag_s"
            expected = f"{expected_keys}, as of the first surface: all actuators are of one order"
            problems.append(Problem(f"surface[{k}].lag_s", arrived, expected))
    return problems


_STATIC = {
    "alpha": tuple(DERIVATIVE_ARGUMENTS.index(column) for column in ("0", "_alpha", "_alpha2")),
    "beta": tuple(DERIVATIVE_ARGUMENTS.index(column) for column in ("_beta", "_beta2")),
}


class AirframeFile(AnyAirframeFile):
    """Aircraft file with stability derivatives, read by :func:`anser.aircraft_files.sources.read_airframe`."""

    mass: Mass = part("mass and inertia", "a table [mass]")
    geometry: Geometry = part("reference lengths and area", "a table [geometry]")
    aerodynamics: Aerodynamics = part("stability derivatives", "a table [aerodynamics]")
    table: tuple[CoefficientTable, ...] = tables(
        "tables over angles that replace derivatives", "tables [[table]], in double brackets", at_least=0, default=()
    )
    surface: tuple[Surface, ...] = tables("control surfaces", "tables [[surface]], in double brackets", at_least=1)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the control surfaces, in the order of the file."""
        return tuple(surface.name for surface in self.surface)

    def consistency_problems(self) -> list[Problem]:
        """List contradictions between surfaces, coefficient tables, derivatives and check data."""
        problems = [*surface_problems(self.surface), *self._table_problems(), *self._replacement_problems()]
        return [*problems, *check_problems(self.check, self.surfaces)]

    def _replacement_problems(self) -> list[Problem]:
        """List the derivatives under `instead` in [[check.forces]] that a table of the file already replaces."""
        replaced: dict[str, str] = {}
        for j, table in enumerate(self.table):
            index = coefficient_index(table.replaces, self.surfaces)
            for column in () if index is None else replaced_columns(table, index):
                if index is not None and column < len(DERIVATIVE_ARGUMENTS):
                    name = COEFFICIENTS[index[0]] + DERIVATIVE_ARGUMENTS[column]
                    replaced[name] = f"nothing: table[{j}] of {table.replaces} takes its place"
        return [
            Problem(f"check.forces[{k}].instead.{name}", format_number(value), replaced[name])
            for k, force_check in enumerate(self.check.forces)
            for name, value in force_check.instead.items()
            if name in replaced
        ]

    def _table_problems(self) -> list[Problem]:
        problems = []
        inputs = ("alpha", "beta", *self.surfaces)
        for k, table in enumerate(self.table):
            for j, name in enumerate(table.over):
                if name not in inputs or name in table.over[:j]:
                    expected = f"one of {', '.join(inputs)}, each once"
                    problems.append(Problem(f"table[{k}].over[{j}]", describe_value(name), expected))
            index = coefficient_index(table.replaces, self.surfaces)
            if index is None:
                matches = difflib.get_close_matches(table.replaces, _replaceable(self.surfaces), n=1)
                expected = "a coefficient (CL, CD, CY, Cl, Cm, Cn) or one of its derivatives, such as Cm_q"
                guess = f'perhaps "{matches[0]}"; ' if matches else ""
                problems.append(Problem(f"table[{k}].replaces", describe_value(table.replaces), guess + expected))
            else:
                problems += self._overridden_derivatives(k, table, index)
        return problems

    def _overridden_derivatives(self, k: int, table: CoefficientTable, index: tuple[int, int]) -> list[Problem]:
        """List nonzero derivatives of the file that table number `k` replaces; `index` is from `coefficient_index`."""
        coefficient, argument_count = COEFFICIENTS[index[0]], len(DERIVATIVE_ARGUMENTS)
        expected = f"nothing, or 0: table[{k}] of {table.replaces} takes its place"
        columns = list(replaced_columns(table, index))
        if table.replaces in COEFFICIENTS:
            columns += [argument_count + self.surfaces.index(name) for name in table.over if name in self.surfaces]
        problems = []
        for column in columns:
            if column < argument_count:
                name = coefficient + DERIVATIVE_ARGUMENTS[column]
                key, value = f"aerodynamics.{name}", getattr(self.aerodynamics, name)
            else:
                n = column - argument_count
                key, value = f"surface[{n}].{coefficient}", getattr(self.surface[n], coefficient)
            if value != 0.0:
                problems.append(Problem(key, format_number(value), expected))
        return problems


def coefficient_index(name: str, surfaces: tuple[str, ...]) -> tuple[int, int] | None:
    """Return row and column of a coefficient or derivative in the array of derivatives; None for an unknown name.

    A whole coefficient such as `Cm` has the column of `Cm0`.
    """
    return derivative_index(f"{name}0" if name in COEFFICIENTS else name, surfaces)


def replaced_columns(table: CoefficientTable, index: tuple[int, int]) -> tuple[int, ...]:
    """Return the columns of the derivatives that a table replaces; `index` is from `coefficient_index`.

    A table of a whole coefficient replaces the constant, and the derivatives by alpha and beta if these angles are
    arguments of the table. Columns of surfaces are not included.
    """
    if table.replaces not in COEFFICIENTS:
        return (index[1],)
    return (0, *(column for name in table.over for column in _STATIC.get(name, ()) if column))


def _replaceable(surfaces: tuple[str, ...]) -> list[str]:
    return [
        coefficient + column
        for coefficient in COEFFICIENTS
        for column in ("", *DERIVATIVE_ARGUMENTS[1:], *(f"_{s}" for s in surfaces))
    ]


DAVE_ML_PARTS = ("aerodynamics", "inertia", "propulsion")
"""Parts of an aircraft that DAVE-ML files may define."""
_PATH = 'the path of a DAVE-ML file, seen from the aircraft file, such as "my_aero.dml"'
_NAMES = 'a table such as { aeroBodyForceCoefficient_X = "CX" }: standard name = name or varID in the file'
_INERTIA_WAYS = "either a file of inertia or a table [mass]"
_GIVEN = "a table of numbers by name or varID, in the units of the file, such as { vrsPositionOfCM = 25.0 }"


class DaveMlText(Table):
    """DAVE-ML file by name and text: a scenario's results contain the text, so the file is not needed again."""

    file: str = text_field("name of the file")
    text: str = text_field("text of the file", expected="the text of a DAVE-ML file")


class DaveMl(Table):
    """DAVE-ML files of an aircraft, variables whose names differ from the standard, and constant inputs."""

    aerodynamics: DaveMlText = part("coefficients in body axes and reference lengths", _PATH)
    inertia: DaveMlText | None = part("mass, inertia and centre of mass; left out: [mass]", _PATH, None)
    propulsion: DaveMlText | None = part("thrust by power lever; left out: [engine], or no engine", _PATH, None)
    propulsion_lag_s: float | None = positive("time constant from throttle to power, with propulsion", 60, "s", None)
    cg_offset_m: BodyVector | None = body_vector(
        "centre of mass relative to the moment reference, with [mass]", "m", None
    )
    names: Annotated[dict[str, str], Field(strict=False)] = by_name("names other than the standard ones", _NAMES)
    given: ByName = by_name("constant inputs, such as the centre of gravity, a gear or a flap", _GIVEN)


class DaveMlSurface(ActuatedSurface):
    """Control surface, and the input of the aerodynamic model that receives the deflection."""

    input: str | None = text_field(
        "name or varID of the input; left out: the surface's name and Deflection, as elevatorDeflection", None
    )

    @property
    def input_name(self) -> str:
        """Name or varID of the aerodynamic input for the deflection; by default `name` + "Deflection"."""
        return f"{self.name}Deflection" if self.input is None else self.input


class DaveMlFile(AnyAirframeFile):
    """Aircraft file with DAVE-ML models, read by :func:`anser.aircraft_files.sources.read_airframe`."""

    dave_ml: DaveMl = part("DAVE-ML files", "a table [dave_ml]")
    mass: Mass | None = part("mass and inertia, instead of a DAVE-ML file", "a table [mass]", None)
    surface: tuple[DaveMlSurface, ...] = tables(
        "control surfaces", "tables [[surface]], in double brackets", at_least=1
    )

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the control surfaces, in the order of the file."""
        return tuple(surface.name for surface in self.surface)

    @property
    def has_engine(self) -> bool:
        """Whether a DAVE-ML propulsion file or a table [engine] is present."""
        return self.dave_ml.propulsion is not None or self.engine is not None

    def consistency_problems(self) -> list[Problem]:
        """List quantities that are missing or defined twice, and contradictions between surfaces and check data."""
        problems, dave_ml = [], self.dave_ml
        if dave_ml.inertia is None and self.mass is None:
            problems.append(Problem("dave_ml.inertia", "nothing", _INERTIA_WAYS))
        if dave_ml.inertia is not None and self.mass is not None:
            arrived = f"{describe_value(dave_ml.inertia.file)} beside [mass]"
            problems.append(Problem("dave_ml.inertia", arrived, _INERTIA_WAYS))
        if dave_ml.cg_offset_m is not None and self.mass is None:
            expected = "nothing: the file of inertia says where the centre of mass is"
            problems.append(Problem("dave_ml.cg_offset_m", str(list(dave_ml.cg_offset_m)), expected))
        if dave_ml.propulsion is not None and self.engine is not None:
            arrived = f"{describe_value(dave_ml.propulsion.file)} beside [engine]"
            problems.append(Problem("dave_ml.propulsion", arrived, "either a file of propulsion or a table [engine]"))
        if (dave_ml.propulsion is None) != (dave_ml.propulsion_lag_s is None):
            lag_s = dave_ml.propulsion_lag_s
            arrived = "nothing" if lag_s is None else f"{lag_s:g} without propulsion"
            expected = "a time constant beside a file of propulsion, which has none"
            problems.append(Problem("dave_ml.propulsion_lag_s", arrived, expected))
        for k, force_check in enumerate(self.check.forces):
            if force_check.instead:
                expected = "nothing: a DAVE-ML file has no derivatives to set"
                problems.append(Problem(f"check.forces[{k}].instead", "a table", expected))
        return [*problems, *surface_problems(self.surface), *check_problems(self.check, self.surfaces)]
