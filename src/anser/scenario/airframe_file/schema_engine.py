"""Engines of an aircraft by file: jet, electric motor or piston engine with a propeller."""

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field

from anser.scenario.airframe_file.schema_aerodynamics import misshapen
from anser.scenario.airframe_file.schema_body import Place, place
from anser.scenario.errors import Problem, plain
from anser.scenario.schema_base import Table, choice, expects, number, table

Polynomial = Annotated[tuple[float, float, float], Field(strict=False)]


def _polynomial(about: str) -> Any:
    return Field(description=about, json_schema_extra=expects("a list of three numbers, factors of 1, J and J^2"))


def _point() -> Any:
    return place("where the thrust acts, seen from the centre of gravity", "m", (0.0, 0.0, 0.0))


def _thrust(about: str, default: float | None = None) -> Any:
    words = "a number of newtons, or a list over altitude_m of lists over mach"
    if default is None:
        return Field(description=about, json_schema_extra=expects(words))
    return Field(default, description=about, json_schema_extra=expects(words))


def _axis(about: str, unit: str) -> Any:
    return Field((), description=about, json_schema_extra=expects(f"a list of two rising numbers or more, {unit}"))


class Jet(Table):
    """Thrust of a jet engine, one number or a table over altitude and Mach number."""

    idle_N: Any = _thrust("thrust at idle", 0.0)
    full_N: Any = _thrust("thrust at full throttle")
    altitude_m: Annotated[tuple[float, ...], Field(strict=False)] = _axis("of the tables; left out: no table", "m")
    mach: Annotated[tuple[float, ...], Field(strict=False)] = _axis("of the tables; left out: no table", "")
    lag_s: float = number("time constant from throttle to thrust", 0, 60, "s", above=True)
    point_m: Place = _point()

    def own_problems(self) -> list[Problem]:
        """Find axes that do not rise, and thrust that has not their shape."""
        found = []
        if bool(self.altitude_m) != bool(self.mach):
            lacks = "mach" if self.altitude_m else "altitude_m"
            return [Problem(lacks, "nothing", "both altitude_m and mach, or none of them")]
        for key in ("altitude_m", "mach"):
            points = getattr(self, key)
            if len(points) == 1 or any(not low < high for low, high in pairwise(points)):
                found.append(Problem(key, f"[{', '.join(map(plain, points))}]", "two numbers or more that rise"))
        shape = (len(self.altitude_m), len(self.mach)) if self.mach else ()
        return found or [one for key in ("idle_N", "full_N") for one in misshapen(getattr(self, key), shape, key)]


class ElectricPropeller(Table):
    """Brushless motor with a propeller of fixed pitch; J = V / (n D), n in revolutions per second."""

    diameter_m: float = number("diameter D of the propeller", 0, 10, "m", above=True)
    thrust_coefficients: Polynomial = _polynomial("C_T(J): thrust / (rho n^2 D^4)")
    torque_coefficients: Polynomial = _polynomial("C_Q(J): torque / (rho n^2 D^5)")
    speed_constant_rpm_V: float = number("K_V of the motor", 0, 1e5, "rpm per volt", above=True)
    resistance_ohm: float = number("R of the windings", 0, 100, "ohm", above=True)
    no_load_current_A: float = number("i0, which friction takes", 0, 1000, "A", 0.0)
    voltage_V: float = number("of the battery, at full throttle", 0, 10_000, "V", above=True)
    direction: Literal["right", "left"] = choice(
        "sense of rotation seen from behind; the reaction rolls the aircraft the other way", ("right", "left"), "right"
    )
    lag_s: float = number("time constant from throttle to voltage", 0, 60, "s", above=True)
    point_m: Place = _point()

    def own_problems(self) -> list[Problem]:
        """Find a propeller that pulls nothing at rest, or takes no torque."""
        words = "a positive first number: what the propeller does at rest"
        return [
            Problem(key, plain(getattr(self, key)[0]), words)
            for key in ("thrust_coefficients", "torque_coefficients")
            if not getattr(self, key)[0] > 0.0
        ]


class PistonPropeller(Table):
    """Piston engine without supercharger, with a propeller of constant efficiency and constant speed."""

    shaft_power_W: float = number("of the engine at full throttle at sea level", 0, 1e8, "W", above=True)
    efficiency: float = number("of the propeller in fast flight", 0, 1, "", 0.8, above=True)
    static_thrust_N: float = number("at rest at sea level", 0, 1e6, "N", above=True)
    speed_rpm: float | None = number(
        "of the propeller, for the reaction to its torque; left out: no reaction", 0, 1e5, "rpm", None, above=True
    )
    direction: Literal["right", "left"] = choice(
        "sense of rotation seen from behind; the reaction rolls the aircraft the other way", ("right", "left"), "right"
    )
    lag_s: float = number("time constant from throttle to power", 0, 60, "s", above=True)
    point_m: Place = _point()


class Engine(Table):
    """One of three kinds of engine."""

    jet: Jet | None = table("a jet engine", "a table [engine.jet]", None)
    electric_propeller: ElectricPropeller | None = table(
        "an electric motor with its propeller", "a table [engine.electric_propeller]", None
    )
    piston_propeller: PistonPropeller | None = table(
        "a piston engine with its propeller", "a table [engine.piston_propeller]", None
    )

    @property
    def kind(self) -> str:
        """Name of the one that is given."""
        return next(name for name in type(self).model_fields if getattr(self, name) is not None)

    def own_problems(self) -> list[Problem]:
        """Find two engines, and an engine of no kind."""
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) == 1:
            return []
        words = "one of the tables [engine.jet], [engine.electric_propeller], [engine.piston_propeller]"
        return [Problem("", " and ".join(given) or "nothing", f"{words}; without an engine, no table [engine] at all")]
