"""What all aircraft files hold, whatever their aerodynamics come from."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from anser.scenario.airframe_file.schema_body import Actuated, Validity
from anser.scenario.airframe_file.schema_check import Check
from anser.scenario.airframe_file.schema_engine import Engine
from anser.scenario.errors import Problem, plain, show
from anser.scenario.schema_base import SLUG_EXPECTED, SLUG_PATTERN, Table, expects
from anser.scenario.schema_base import table as part

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
            found += [Problem(f"check.{kind}[{k}].{key}", f"the unknown key {show(n)}", known) for n in unknown]
    return found


def surface_problems(surface: Sequence[Actuated]) -> list[Problem]:
    """Find names given twice, and actuators of both orders."""
    found = []
    names = [one.name for one in surface]
    for k, one in enumerate(surface):
        if one.name in names[:k]:
            taken = f"{show(one.name)}, already the name of surface[{names.index(one.name)}]"
            found.append(Problem(f"surface[{k}].name", taken, "a name of its own"))
        if (one.lag_s is None) != (surface[0].lag_s is None):
            way = "frequency_rad_s and damping" if surface[0].lag_s is None else "lag_s"
            words = f"{way}, as of the first surface: all actuators are of one order"
            found.append(Problem(f"surface[{k}].lag_s", "nothing" if one.lag_s is None else plain(one.lag_s), words))
    return found
