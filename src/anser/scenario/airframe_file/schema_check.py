"""Check data of an aircraft: what its source says comes out, which `anser aircraft check` computes."""

from typing import Annotated

from pydantic import Field

from anser.derivative_names import DERIVATIVES
from anser.scenario.airframe_file.schema_body import Place, place
from anser.scenario.errors import Problem, show
from anser.scenario.schema_base import Table, expects, number, tables

_BY_SURFACE = "a table of numbers by the names of the surfaces"
ByName = Annotated[dict[str, float], Field(strict=False)]


class ForceCheck(Table):
    """Force and moment of a condition."""

    name: str = Field(description="which", json_schema_extra=expects("a text in quotes"))
    airspeed_m_s: float = number("true airspeed", 0, 1000, "m/s")
    alpha_rad: float = number("angle of attack", -3.2, 3.2, "rad", 0.0)
    beta_rad: float = number("sideslip", -1.6, 1.6, "rad", 0.0)
    rates_rad_s: Place = place("body rates", "rad/s", (0.0, 0.0, 0.0))
    altitude_m: float = number("altitude above sea level", -1000, 30_000, "m", 0.0)
    density_kg_m3: float | None = number(
        "density of the air; left out: of the standard atmosphere", 0, 10, "kg/m^3", None, above=True
    )
    surfaces_rad: ByName = Field(
        default_factory=dict, description="deflections by name; others 0", json_schema_extra=expects(_BY_SURFACE)
    )
    throttle: float = number("at which the engine runs steadily", 0, 1, "", 0.0)
    gravity_m_s2: Place | None = place("in body axes; the force then holds the weight", "m/s^2", None)
    instead: ByName = Field(
        default_factory=dict,
        description="derivatives for which the source's check used other values than the file has",
        json_schema_extra=expects("a table of numbers by the names of derivatives, such as { CD0 = 0.0 }"),
    )
    force_N: Place | None = place("total force", "N", None)
    moment_Nm: Place | None = place("total moment about the centre of gravity", "N m", None)
    thrust_N: float | None = number("thrust along body x", -1e7, 1e7, "N", None)
    torque_Nm: float | None = number("moment of the engine about body x", -1e7, 1e7, "N m", None)
    tolerance: float = number("largest difference that agrees, N and N m", 0, 1e6, "", above=True)

    def own_problems(self) -> list[Problem]:
        """Find a check that says nothing, and values for derivatives that are none."""
        found = []
        if all(one is None for one in (self.force_N, self.moment_Nm, self.thrust_N, self.torque_Nm)):
            found.append(Problem("force_N", "nothing", "one or more of force_N, moment_Nm, thrust_N and torque_Nm"))
        for name in self.instead:
            if name not in DERIVATIVES:
                words = "the name of a derivative of [aerodynamics]"
                found.append(Problem(f"instead.{name}", f"the unknown key {show(name)}", words))
        return found


class TrimCheck(Table):
    """Steady flight."""

    name: str = Field(description="which", json_schema_extra=expects("a text in quotes"))
    airspeed_m_s: float = number("true airspeed", 0, 1000, "m/s", above=True)
    altitude_m: float = number("altitude above sea level", -1000, 30_000, "m", 0.0)
    path_angle_deg: float = number("climb angle", -60, 60, "deg", 0.0)
    alpha_deg: float | None = number("angle of attack", -180, 180, "deg", None)
    surfaces_deg: ByName = Field(
        default_factory=dict, description="deflections by name", json_schema_extra=expects(_BY_SURFACE)
    )
    throttle: float | None = number("throttle", 0, 1, "", None)
    tolerance_deg: float = number("largest difference of angles that agrees", 0, 30, "deg", 0.1, above=True)
    tolerance_throttle: float = number("largest difference of the throttle that agrees", 0, 1, "", 0.01, above=True)

    def own_problems(self) -> list[Problem]:
        """Find a check that says nothing."""
        if self.alpha_deg is None and self.throttle is None and not self.surfaces_deg:
            return [Problem("alpha_deg", "nothing", "one or more of alpha_deg, throttle and surfaces_deg")]
        return []


class Check(Table):
    """What comes out, by the aircraft's source."""

    forces: tuple[ForceCheck, ...] = tables(
        "force and moment of conditions", "tables [[check.forces]], in double brackets", at_least=0, default=()
    )
    trim: tuple[TrimCheck, ...] = tables(
        "steady flights", "tables [[check.trim]], in double brackets", at_least=0, default=()
    )
