"""An aircraft whose numbers come from DAVE-ML files (ANSI/AIAA S-119): which, and what they do not tell."""

from typing import Annotated

from pydantic import Field

from anser.scenario.airframe_file.schema_body import Actuated, Mass, Place, place
from anser.scenario.airframe_file.schema_common import AnyAirframeFile, check_problems, surface_problems
from anser.scenario.errors import Problem, show
from anser.scenario.schema_base import Table, expects, number, tables
from anser.scenario.schema_base import table as part

PARTS = ("aerodynamics", "inertia", "propulsion")
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
        "time constant from throttle to power, with propulsion", 0, 60, "s", None, above=True
    )
    cg_offset_m: Place | None = place("centre of mass seen from the moment reference, with [mass]", "m", None)
    names: Annotated[dict[str, str], Field(strict=False)] = Field(
        default_factory=dict, description="names other than the standard ones", json_schema_extra=expects(_NAMES)
    )
    given: Annotated[dict[str, float], Field(strict=False)] = Field(
        default_factory=dict,
        description="inputs that stay as they are, such as the centre of gravity, a gear or a flap",
        json_schema_extra=expects(_GIVEN),
    )


class DaveMlSurface(Actuated):
    """A control surface: the input of the aerodynamics that it moves."""

    input: str | None = Field(
        None,
        description="name or varID of that input; left out: the surface's name and Deflection, as elevatorDeflection",
        json_schema_extra=expects("a text in quotes"),
    )

    @property
    def moves(self) -> str:
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

    def own_problems(self) -> list[Problem]:
        """Find what is given twice or not at all, and what is wrong between tables of the file."""
        found, of = [], self.dave_ml
        if (of.inertia is None) == (self.mass is None):
            arrived = "nothing" if self.mass is None else f"{show(of.inertia and of.inertia.file)} beside [mass]"
            found.append(Problem("dave_ml.inertia", arrived, "either a file of inertia or a table [mass]"))
        if of.cg_offset_m is not None and self.mass is None:
            words = "nothing: the file of inertia says where the centre of mass is"
            found.append(Problem("dave_ml.cg_offset_m", str(list(of.cg_offset_m)), words))
        if of.propulsion is not None and self.engine is not None:
            arrived = f"{show(of.propulsion.file)} beside [engine]"
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
