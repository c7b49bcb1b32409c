"""The file of one aircraft: derivatives, tables, engine, surfaces, validated, in the units of its file."""

import difflib
from typing import Any, Literal

from pydantic import Field, ValidationError

from anser.derivative_names import ARGUMENTS, COEFFICIENTS, place_of
from anser.scenario.airframe_file.schema_aerodynamics import Aerodynamics, CoefficientTable
from anser.scenario.airframe_file.schema_body import Geometry, Mass, Surface, Validity
from anser.scenario.airframe_file.schema_check import Check
from anser.scenario.airframe_file.schema_engine import Engine
from anser.scenario.errors import Problem, ScenarioError, plain, show
from anser.scenario.schema_base import SLUG_EXPECTED, SLUG_PATTERN, Table, expects, tables
from anser.scenario.schema_base import table as part
from anser.scenario.schema_problems import problems_from

_TEXT = "a text in quotes"
_STATIC = {
    "alpha": tuple(ARGUMENTS.index(one) for one in ("0", "_alpha", "_alpha2")),
    "beta": tuple(ARGUMENTS.index(one) for one in ("_beta", "_beta2")),
}
_RATES = {f"{row}_{kind}dot" for row in COEFFICIENTS for kind in ("alpha", "beta")}


class AirframeFile(Table):
    """An aircraft; read one with :func:`anser.scenario.airframe_file.read_airframe`, whose messages are plain."""

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
    mass: Mass = part("mass and inertia", "a table [mass]")
    geometry: Geometry = part("reference lengths and area", "a table [geometry]")
    aerodynamics: Aerodynamics = part("stability derivatives", "a table [aerodynamics]")
    table: tuple[CoefficientTable, ...] = tables(
        "values over angles in the place of derivatives", "tables [[table]], in double brackets", at_least=0, default=()
    )
    surface: tuple[Surface, ...] = tables("control surfaces", "tables [[surface]], in double brackets", at_least=1)
    engine: Engine | None = part("engine; left out: none", "a table [engine]", None)
    validity: Validity = part("where the data hold", "a table [validity]")
    check: Check = part("what must come out", "a table [check]", Check())

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of the surfaces."""
        return tuple(one.name for one in self.surface)

    def own_problems(self) -> list[Problem]:
        """Find what is wrong between tables of the file."""
        found = [*self._surface_problems(), *self._table_problems()]
        known = f"names of surfaces of this file ({', '.join(self.surfaces)})"
        for kind, checks in (("forces", self.check.forces), ("trim", self.check.trim)):
            for k, one in enumerate(checks):
                key = "surfaces_rad" if kind == "forces" else "surfaces_deg"
                unknown = [name for name in getattr(one, key) if name not in self.surfaces]
                found += [Problem(f"check.{kind}[{k}].{key}", f"the unknown key {show(n)}", known) for n in unknown]
        return found

    def _surface_problems(self) -> list[Problem]:
        found = []
        for k, one in enumerate(self.surface):
            if one.name in self.surfaces[:k]:
                taken = f"{show(one.name)}, already the name of surface[{self.surfaces.index(one.name)}]"
                found.append(Problem(f"surface[{k}].name", taken, "a name of its own"))
            if (one.lag_s is None) != (self.surface[0].lag_s is None):
                way = "frequency_rad_s and damping" if self.surface[0].lag_s is None else "lag_s"
                words = f"{way}, as of the first surface: all actuators are of one order"
                found.append(
                    Problem(f"surface[{k}].lag_s", "nothing" if one.lag_s is None else plain(one.lag_s), words)
                )
        return found

    def _table_problems(self) -> list[Problem]:
        found = []
        inputs = ("alpha", "beta", *self.surfaces)
        for k, one in enumerate(self.table):
            for j, name in enumerate(one.over):
                if name not in inputs or name in one.over[:j]:
                    words = f"one of {', '.join(inputs)}, each once"
                    found.append(Problem(f"table[{k}].over[{j}]", show(name), words))
            place = place_of_table(one.replaces, self.surfaces)
            if place is None:
                near = difflib.get_close_matches(one.replaces, _replaceable(self.surfaces), n=1)
                words = "a coefficient (CL, CD, CY, Cl, Cm, Cn) or one of its derivatives, such as Cm_q"
                guess = f'perhaps "{near[0]}"; ' if near else ""
                found.append(Problem(f"table[{k}].replaces", show(one.replaces), guess + words))
            else:
                found += self._doubled(k, one, place)
        return found

    def _doubled(self, k: int, one: CoefficientTable, place: tuple[int, int]) -> list[Problem]:
        """Find derivatives that stand beside a table that takes their place."""
        found = []
        row = COEFFICIENTS[place[0]]
        words = f"nothing, or 0: table[{k}] of {one.replaces} takes its place"
        for column in replaced_columns(one, place):
            if column < len(ARGUMENTS):
                path, value = (
                    f"aerodynamics.{row}{ARGUMENTS[column]}",
                    getattr(self.aerodynamics, row + ARGUMENTS[column]),
                )
            else:
                n = column - len(ARGUMENTS)
                path, value = f"surface[{n}].{row}", getattr(self.surface[n], row)
            if value != 0.0:
                found.append(Problem(path, plain(value), words))
        surfaces = [name for name in one.over if name in self.surfaces] if one.replaces in COEFFICIENTS else []
        for name in surfaces:
            n = self.surfaces.index(name)
            if getattr(self.surface[n], row) != 0.0:
                found.append(Problem(f"surface[{n}].{row}", plain(getattr(self.surface[n], row)), words))
        return found


def place_of_table(name: str, surfaces: tuple[str, ...]) -> tuple[int, int] | None:
    """Row and column of what a table gives: `Cm` as a whole is that without a factor, as `Cm0`."""
    return place_of(f"{name}0" if name in COEFFICIENTS else name, surfaces)


def replaced_columns(one: CoefficientTable, place: tuple[int, int]) -> tuple[int, ...]:
    """Columns of the derivatives in whose place a table stands, surfaces of a whole coefficient left aside."""
    if one.replaces not in COEFFICIENTS:
        return (place[1],)
    return (0, *(column for name in one.over for column in _STATIC.get(name, ()) if column))


def _replaceable(surfaces: tuple[str, ...]) -> list[str]:
    return [row + column for row in COEFFICIENTS for column in ("", *ARGUMENTS[1:], *(f"_{s}" for s in surfaces))]


def validate_airframe(values: dict[str, Any], source: str) -> AirframeFile:
    """Validate an aircraft that is at hand as nested dictionaries and lists, as its TOML file would hold them.

    Raises
    ------
    ScenarioError
        If it is no valid one; the message names file, key, what arrived and what would be right.
    """
    version = values.get("format")
    if "format" in values and version != 1:
        raise ScenarioError(source, [Problem("format", show(version), "1, the format that this anser reads")])
    try:
        return AirframeFile.model_validate(values)
    except ValidationError as error:
        problems = problems_from(error, AirframeFile, values)
        raise ScenarioError(source, [_plainer(problem) for problem in problems]) from None


def _plainer(problem: Problem) -> Problem:
    """Say more of a derivative that this model cannot have."""
    key = problem.path.rpartition(".")[2]
    if key not in _RATES:
        return problem
    words = (
        f"no derivative by the rate of an angle: added to {key[:2]}_q (or _r), it acts nearly the same in slow motion"
    )
    return Problem(problem.path, problem.arrived, words, problem.whom)
