"""Tables of an aircraft file for stability derivatives, coefficient tables and engines."""

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model

from anser.aircraft_files.schema_body import BodyVector, body_vector
from anser.airframe_data import COEFFICIENTS, DERIVATIVE_ARGUMENTS, DERIVATIVES
from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import Table, expects, number, table

_WHAT: dict[str, str] = dict(
    zip(COEFFICIENTS, ("lift", "drag", "side force", "roll moment", "pitch moment", "yaw moment"), strict=True)
)
_PER: dict[str, str] = dict(
    zip(
        DERIVATIVE_ARGUMENTS,
        (
            "at zero angles",
            "per angle of attack",
            "per sideslip",
            "per roll rate p b/2V",
            "per pitch rate q c/2V",
            "per yaw rate r b/2V",
            "per square of the angle of attack",
            "per square of the sideslip",
        ),
        strict=True,
    )
)
AXES_MAX = 3


class _Build(Table):
    """Aerodynamic options besides the derivatives."""

    per: Literal["rad", "deg"] = Field(
        default="rad",
        description="angle that the derivatives by alpha, beta and the surfaces are given per; rates are always in "
        "rad/s",
    )
    oswald: float | None = number(
        "e of the induced drag (CL0 + CL_alpha alpha)^2 / (pi e AR); left out: none",
        0,
        2,
        "",
        None,
        exclusive_minimum=True,
    )
    stall_alpha_deg: float | None = number(
        "alpha0, angle at which the lift changes to that of a flat plate; left out: no stall",
        0,
        90,
        "deg",
        None,
        exclusive_minimum=True,
    )
    stall_sharpness: float = number("M, sharpness of the stall", 1, 1000, "per rad", 50.0)


def _field(name: str) -> Any:
    coefficient, ending = name[:2], name[2:]
    return (float, number(f"{_WHAT[coefficient]} {_PER[ending]}", -1e4, 1e4, "", 0.0))


if TYPE_CHECKING:
    Aerodynamics = _Build
else:
    Aerodynamics = create_model(
        "Aerodynamics",
        __base__=_Build,
        __module__=__name__,
        __doc__="Stability derivatives: lift and drag turned into body axes by alpha alone, the others in body axes.",
        **{name: _field(name) for name in DERIVATIVES},
    )


class CoefficientTable(Table):
    """Table of a coefficient or derivative over one to three angles, linear between breakpoints.

    It replaces one or more derivatives of the file.
    """

    replaces: str = Field(
        description="a coefficient, such as Cm, or a derivative, such as Cm_q or Cl_aileron",
        json_schema_extra=expects('the name of a coefficient or derivative, such as "Cm" or "Cm_q"'),
    )
    over: Annotated[tuple[str, ...], Field(strict=False)] = Field(
        min_length=1,
        max_length=AXES_MAX,
        description='arguments of the table: "alpha", "beta" and names of surfaces',
        json_schema_extra=expects(f'a list of one to {AXES_MAX} of "alpha", "beta" and names of surfaces'),
    )
    breakpoints_deg: Annotated[tuple[Annotated[tuple[float, ...], Field(strict=False)], ...], Field(strict=False)] = (
        Field(
            description="breakpoints of each argument, rising",
            json_schema_extra=expects("a list of lists of rising numbers, one list for each of over, deg"),
        )
    )
    values: Annotated[tuple[Any, ...], Field(strict=False)] = Field(
        description="values at the breakpoints, in nested lists",
        json_schema_extra=expects("a list of numbers as long as the breakpoints; for two axes, a list of such lists"),
    )
    beyond: Literal["hold", "extend"] = Field(
        default="hold", description="extrapolation: hold the end value, or extend the end slope"
    )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of breakpoints on each axis."""
        return tuple(len(points) for points in self.breakpoints_deg)

    def consistency_problems(self) -> list[Problem]:
        """Report axes that do not rise, and values that do not fit the breakpoints."""
        if len(self.breakpoints_deg) != len(self.over):
            expected = f"a list of {len(self.over)} lists, one for each of over"
            return [Problem("breakpoints_deg", f"a list of {len(self.breakpoints_deg)}", expected)]
        problems = []
        for k, points in enumerate(self.breakpoints_deg):
            if len(points) < 2:
                problems.append(Problem(f"breakpoints_deg[{k}]", f"a list of {len(points)}", "two numbers or more"))
            for i, (low, high) in enumerate(pairwise(points)):
                if not low < high:
                    expected = f"a number greater than the one before it, {format_number(low)}"
                    problems.append(Problem(f"breakpoints_deg[{k}][{i + 1}]", format_number(high), expected))
        return problems or shape_problems(self.values, self.shape, "values")


def shape_problems(values: object, shape: tuple[int, ...], path: str) -> list[Problem]:
    """Report nested lists of the wrong shape, and entries that are not finite numbers."""
    if not shape:
        is_number = isinstance(values, int | float) and not isinstance(values, bool) and math.isfinite(values)
        return [] if is_number else [Problem(path, describe_value(values), "a finite number")]
    if not isinstance(values, list | tuple) or len(values) != shape[0]:
        return [Problem(path, describe_value(values), f"a list of {shape[0]}, one for each breakpoint")]
    return [problem for k, item in enumerate(values) for problem in shape_problems(item, shape[1:], f"{path}[{k}]")]


Polynomial = Annotated[tuple[float, float, float], Field(strict=False)]


def _polynomial(description: str) -> Any:
    return Field(description=description, json_schema_extra=expects("a list of three numbers, factors of 1, J and J^2"))


def _point() -> Any:
    return body_vector("point of action of the thrust, relative to the centre of gravity", "m", (0.0, 0.0, 0.0))


def _thrust(description: str, default: float | None = None) -> Any:
    expected = "a number of newtons, or a list over altitude_m of lists over mach"
    if default is None:
        return Field(description=description, json_schema_extra=expects(expected))
    return Field(default, description=description, json_schema_extra=expects(expected))


def _axis(description: str, unit: str) -> Any:
    return Field(
        (), description=description, json_schema_extra=expects(f"a list of two rising numbers or more, {unit}")
    )


class Jet(Table):
    """Jet engine thrust: a number, or a table over altitude and Mach number."""

    idle_N: Any = _thrust("thrust at idle", 0.0)
    full_N: Any = _thrust("thrust at full throttle")
    altitude_m: Annotated[tuple[float, ...], Field(strict=False)] = _axis(
        "altitudes of the tables; left out: no table", "m"
    )
    mach: Annotated[tuple[float, ...], Field(strict=False)] = _axis(
        "Mach numbers of the tables; left out: no table", ""
    )
    lag_s: float = number("time constant from throttle to thrust", 0, 60, "s", exclusive_minimum=True)
    point_m: BodyVector = _point()

    def consistency_problems(self) -> list[Problem]:
        """Report axes that do not rise, and a thrust table whose shape does not fit the axes."""
        problems = []
        if bool(self.altitude_m) != bool(self.mach):
            missing_key = "mach" if self.altitude_m else "altitude_m"
            return [Problem(missing_key, "nothing", "both altitude_m and mach, or none of them")]
        for key in ("altitude_m", "mach"):
            points = getattr(self, key)
            if len(points) == 1 or any(not low < high for low, high in pairwise(points)):
                problems.append(
                    Problem(key, f"[{', '.join(map(format_number, points))}]", "two numbers or more that rise")
                )
        shape = (len(self.altitude_m), len(self.mach)) if self.mach else ()
        return problems or [
            problem for key in ("idle_N", "full_N") for problem in shape_problems(getattr(self, key), shape, key)
        ]


class ElectricPropeller(Table):
    """Brushless motor with fixed-pitch propeller.

    Thrust and torque coefficients are polynomials in J = V / (n D), n in revolutions per second.
    """

    diameter_m: float = number("diameter D of the propeller", 0, 10, "m", exclusive_minimum=True)
    thrust_coefficients: Polynomial = _polynomial("C_T(J): thrust / (rho n^2 D^4)")
    torque_coefficients: Polynomial = _polynomial("C_Q(J): torque / (rho n^2 D^5)")
    speed_constant_rpm_V: float = number("K_V of the motor", 0, 1e5, "rpm per volt", exclusive_minimum=True)
    resistance_ohm: float = number("R of the windings", 0, 100, "ohm", exclusive_minimum=True)
    no_load_current_A: float = number("i0, no-load current, for friction", 0, 1000, "A", 0.0)
    voltage_V: float = number("voltage of the battery, at full throttle", 0, 10_000, "V", exclusive_minimum=True)
    direction: Literal["right", "left"] = Field(
        default="right", description="sense of rotation seen from behind; the reaction rolls the aircraft the other way"
    )
    lag_s: float = number("time constant from throttle to voltage", 0, 60, "s", exclusive_minimum=True)
    point_m: BodyVector = _point()

    def consistency_problems(self) -> list[Problem]:
        """Report zero or negative static thrust or torque."""
        expected = "a positive first number: what the propeller does at rest"
        return [
            Problem(key, format_number(getattr(self, key)[0]), expected)
            for key in ("thrust_coefficients", "torque_coefficients")
            if not getattr(self, key)[0] > 0.0
        ]


class PistonPropeller(Table):
    """Normally aspirated piston engine with a propeller of constant efficiency and constant speed."""

    shaft_power_W: float = number("shaft power at full throttle at sea level", 0, 1e8, "W", exclusive_minimum=True)
    efficiency: float = number("efficiency of the propeller in fast flight", 0, 1, "", 0.8, exclusive_minimum=True)
    static_thrust_N: float = number("static thrust at sea level", 0, 1e6, "N", exclusive_minimum=True)
    speed_rpm: float | None = number(
        "speed of the propeller, for its torque reaction; left out: no reaction",
        0,
        1e5,
        "rpm",
        None,
        exclusive_minimum=True,
    )
    direction: Literal["right", "left"] = Field(
        default="right", description="sense of rotation seen from behind; the reaction rolls the aircraft the other way"
    )
    lag_s: float = number("time constant from throttle to power", 0, 60, "s", exclusive_minimum=True)
    point_m: BodyVector = _point()


class Engine(Table):
    """Engine of the aircraft: exactly one of the kinds."""

    jet: Jet | None = table("a jet engine", "a table [engine.jet]", None)
    electric_propeller: ElectricPropeller | None = table(
        "an electric motor with its propeller", "a table [engine.electric_propeller]", None
    )
    piston_propeller: PistonPropeller | None = table(
        "a piston engine with its propeller", "a table [engine.piston_propeller]", None
    )

    @property
    def kind(self) -> str:
        """Name of the kind of engine, such as "jet"."""
        return next(name for name in type(self).model_fields if getattr(self, name) is not None)

    def consistency_problems(self) -> list[Problem]:
        """Report a table [engine] with several kinds of engine or without any."""
        kinds = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(kinds) == 1:
            return []
        expected = "one of the tables [engine.jet], [engine.electric_propeller], [engine.piston_propeller]"
        return [
            Problem("", " and ".join(kinds) or "nothing", f"{expected}; without an engine, no table [engine] at all")
        ]
