"""The file of one aircraft: derivatives, tables, engine, surfaces, validated, in the units of its file."""

import difflib

from anser.derivative_names import ARGUMENTS, COEFFICIENTS, place_of
from anser.scenario.airframe_file.schema_aerodynamics import Aerodynamics, CoefficientTable
from anser.scenario.airframe_file.schema_body import Geometry, Mass, Surface
from anser.scenario.airframe_file.schema_common import AnyAirframeFile, check_problems, surface_problems
from anser.scenario.errors import Problem, plain, show
from anser.scenario.schema_base import table as part
from anser.scenario.schema_base import tables

_STATIC = {
    "alpha": tuple(ARGUMENTS.index(one) for one in ("0", "_alpha", "_alpha2")),
    "beta": tuple(ARGUMENTS.index(one) for one in ("_beta", "_beta2")),
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

    def own_problems(self) -> list[Problem]:
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
