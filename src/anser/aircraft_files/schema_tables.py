"""Tables of an aircraft file: mass, geometry, surfaces, ranges, check data, aerodynamics and engines."""

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model
from pydantic_core import PydanticUndefined

from anser.airframe_data import COEFFICIENTS, DERIVATIVE_ARGUMENTS, DERIVATIVES, body_faults
from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import Table, expects, number, table, tables
from anser.variables import is_free_surface_name

SURFACE_PATTERN = r"^[a-z][a-z0-9_]{0,31}$"
_SURFACE_NAME = "a name of 1 to 32 small letters, digits and underscores that begins with a letter"
_LAG_WAYS = "either lag_s, or frequency_rad_s and damping; not both"
_STOP_WAYS = "either limit_deg, or lower_deg and upper_deg; not both"
RESERVED_SURFACE_NAMES = {column.removeprefix("_") for column in DERIVATIVE_ARGUMENTS if column != "0"}
"""Forbidden surface names: a derivative by such a surface would have the name of another derivative."""

Range = Annotated[tuple[float, float], Field(strict=False)]
BodyVector = Annotated[tuple[float, float, float], Field(strict=False)]


def interval(description: str, unit: str, default: object = PydanticUndefined) -> Any:
    """Return a field for a range: a list of minimum and maximum, in `unit`."""
    expected = f"a list of two numbers, least first, {unit}".removesuffix(", ")
    return Field(default, description=description, json_schema_extra=expects(expected))


def positive(description: str, high: float, unit: str, default: object = PydanticUndefined) -> Any:
    """Return a field for a number above 0, at most `high`; `default` None makes the key optional."""
    return number(description, 0, high, unit, default, exclusive_minimum=True)


def text_field(description: str, default: object = PydanticUndefined, expected: str = "a text in quotes") -> Any:
    """Return a field for a text; `expected` completes the message for a wrong value."""
    return Field(default, description=description, json_schema_extra=expects(expected))


def body_vector(description: str, unit: str, default: object = PydanticUndefined) -> Any:
    """Return a field for three numbers in body axes (forward, right, down), in `unit`."""
    expected = f"a list of three numbers (forward, right, down), {unit}"
    return Field(default, description=description, json_schema_extra=expects(expected))


def unordered_range_problems(table: Table, *keys: str) -> list[Problem]:
    """List the ranges among `keys` whose minimum is not less than the maximum; a key without value is no problem."""
    ranges = [(key, getattr(table, key)) for key in keys if getattr(table, key) is not None]
    expected = "the lesser of two numbers first"
    return [Problem(key, format_range(bounds), expected) for key, bounds in ranges if not bounds[0] < bounds[1]]


def format_range(bounds: tuple[float, float]) -> str:
    """Return the text of a range: [minimum, maximum]."""
    return f"[{format_number(bounds[0])}, {format_number(bounds[1])}]"


class Mass(Table):
    """Mass, and inertia about the centre of gravity in body axes."""

    mass_kg: float = positive("mass", 1e6, "kg")
    Jxx_kg_m2: float = positive("moment of inertia in roll", 1e9, "kg m^2")
    Jyy_kg_m2: float = positive("moment of inertia in pitch", 1e9, "kg m^2")
    Jzz_kg_m2: float = positive("moment of inertia in yaw", 1e9, "kg m^2")
    Jxz_kg_m2: float = number("product of inertia, the integral of x z dm", -1e9, 1e9, "kg m^2", 0.0)
    Jxy_kg_m2: float = number("product of inertia, the integral of x y dm", -1e9, 1e9, "kg m^2", 0.0)
    Jyz_kg_m2: float = number("product of inertia, the integral of y z dm", -1e9, 1e9, "kg m^2", 0.0)
    spin_momentum_kg_m2_s: float = number("angular momentum of spinning parts about body x", -1e6, 1e6, "kg m^2/s", 0.0)

    @property
    def inertia(self) -> tuple[tuple[float, float, float], ...]:
        """Inertia matrix (3, 3) about the centre of gravity, body axes, kg m^2."""
        return (
            (self.Jxx_kg_m2, -self.Jxy_kg_m2, -self.Jxz_kg_m2),
            (-self.Jxy_kg_m2, self.Jyy_kg_m2, -self.Jyz_kg_m2),
            (-self.Jxz_kg_m2, -self.Jyz_kg_m2, self.Jzz_kg_m2),
        )

    def consistency_problems(self) -> list[Problem]:
        """List the moments and products of inertia that are impossible for a rigid body."""
        return [
            Problem(f"{fault.quantity}_kg_m2", format_number(fault.arrived), fault.expected)
            for fault in body_faults({}, self.inertia)
        ]


class Geometry(Table):
    """Reference lengths and area of the coefficients, and position of the centre of gravity."""

    span_m: float = positive("wing span b", 200, "m")
    wing_area_m2: float = positive("wing area S", 5000, "m^2")
    mean_chord_m: float = positive("mean chord c", 100, "m")
    cg_offset_m: BodyVector = body_vector(
        "centre of gravity relative to the moment reference point", "m", (0.0, 0.0, 0.0)
    )


class ActuatedSurface(Table):
    """Control surface with its stops and actuator dynamics."""

    name: str = Field(pattern=SURFACE_PATTERN, description="name, unique", json_schema_extra=expects(_SURFACE_NAME))
    limit_deg: float | None = positive("stops on both sides", 120, "deg", None)
    lower_deg: float | None = number("lower stop, if the stops are not symmetric", -120, 120, "deg", None)
    upper_deg: float | None = number("upper stop, if the stops are not symmetric", -120, 120, "deg", None)
    rate_limit_deg_s: float = positive("greatest rate", 10_000, "deg/s")
    lag_s: float | None = positive("time constant of an actuator of first order", 5, "s", None)
    frequency_rad_s: float | None = positive("natural frequency of an actuator of second order", 1000, "rad/s", None)
    damping: float | None = positive("damping ratio of an actuator of second order", 5, "", None)

    @property
    def stops_deg(self) -> tuple[float, float]:
        """Lower and upper stop, deg; 0 for a stop that the file leaves out."""
        if self.limit_deg is not None:
            return -self.limit_deg, self.limit_deg
        return self.lower_deg or 0.0, self.upper_deg or 0.0

    def consistency_problems(self) -> list[Problem]:
        """List reserved names, and stops or actuator dynamics that are missing, in wrong order or defined twice."""
        problems = []
        stops, second_order = (self.lower_deg, self.upper_deg), (self.frequency_rad_s, self.damping)
        if self.name in RESERVED_SURFACE_NAMES:
            expected = f"another name than {', '.join(sorted(RESERVED_SURFACE_NAMES))}"
            problems.append(Problem("name", describe_value(self.name), expected))
        elif not is_free_surface_name(self.name):
            expected = "another name: a variable of flights has this name, or this name with _command"
            problems.append(Problem("name", describe_value(self.name), expected))
        if self.limit_deg is None and None in stops:
            problems.append(Problem("limit_deg", "nothing", _STOP_WAYS))
        elif self.limit_deg is not None and stops != (None, None):
            arrived = f"{format_number(self.limit_deg)} beside lower_deg or upper_deg"
            problems.append(Problem("limit_deg", arrived, _STOP_WAYS))
        elif not self.stops_deg[0] < self.stops_deg[1]:
            expected = f"less than upper_deg, which is {format_number(self.stops_deg[1])} deg"
            problems.append(Problem("lower_deg", format_number(self.stops_deg[0]), expected))
        if self.lag_s is None and None in second_order:
            problems.append(Problem("lag_s", "nothing", _LAG_WAYS))
        elif self.lag_s is not None and second_order != (None, None):
            arrived = f"{format_number(self.lag_s)} beside frequency_rad_s or damping"
            problems.append(Problem("lag_s", arrived, _LAG_WAYS))
        return problems


class Surface(ActuatedSurface):
    """Control surface with its derivatives: change of each coefficient per deflection angle."""

    CL: float = number("lift per angle", -1e3, 1e3, "", 0.0)
    CD: float = number("drag per angle", -1e3, 1e3, "", 0.0)
    CY: float = number("side force per angle", -1e3, 1e3, "", 0.0)
    Cl: float = number("roll moment per angle", -1e3, 1e3, "", 0.0)
    Cm: float = number("pitch moment per angle", -1e3, 1e3, "", 0.0)
    Cn: float = number("yaw moment per angle", -1e3, 1e3, "", 0.0)


class Validity(Table):
    """Range of validity of the data. Flights must start inside; time outside is marked in the results."""

    airspeed_m_s: Range = interval("true airspeed", "m/s")
    alpha_deg: Range = interval("angle of attack", "deg")
    beta_deg: Range = interval("sideslip", "deg")
    altitude_m: Range | None = interval("altitude above sea level; left out: any", "m", None)
    mach: Range | None = interval("Mach number; left out: any", "", None)

    def consistency_problems(self) -> list[Problem]:
        """List ranges whose minimum is not less than the maximum, and ranges beyond physical limits."""
        problems = unordered_range_problems(self, "airspeed_m_s", "alpha_deg", "beta_deg", "altitude_m", "mach")
        for key, (lowest, highest), unit in (
            ("airspeed_m_s", (0.0, 1000.0), "m/s"),
            ("alpha_deg", (-180.0, 180.0), "deg"),
            ("beta_deg", (-90.0, 90.0), "deg"),
        ):
            bounds = getattr(self, key)
            if any(problem.path == key for problem in problems):
                continue
            if min(bounds) < lowest or max(bounds) > highest:
                expected = f"numbers from {format_number(lowest)} to {format_number(highest)} {unit}"
                problems.append(Problem(key, format_range(bounds), expected))
        return problems


_BY_SURFACE = "a table of numbers by the names of the surfaces"
ByName = Annotated[dict[str, float], Field(strict=False)]


def by_name(description: str, expected: str) -> Any:
    """Return a field for a table of values by name, empty by default; `expected` completes the message for an error."""
    return Field(default_factory=dict, description=description, json_schema_extra=expects(expected))


class ForceCheck(Table):
    """Check data: force, moment, thrust and torque in one flight condition, from the aircraft's source."""

    name: str = text_field("name of the check")
    airspeed_m_s: float = number("true airspeed", 0, 1000, "m/s")
    alpha_rad: float = number("angle of attack", -3.2, 3.2, "rad", 0.0)
    beta_rad: float = number("sideslip", -1.6, 1.6, "rad", 0.0)
    rates_rad_s: BodyVector = body_vector("body rates", "rad/s", (0.0, 0.0, 0.0))
    altitude_m: float = number("altitude above sea level", -1000, 30_000, "m", 0.0)
    density_kg_m3: float | None = positive(
        "density of the air; left out: of the standard atmosphere", 10, "kg/m^3", None
    )
    surfaces_rad: ByName = by_name("deflections by name; others 0", _BY_SURFACE)
    throttle: float = number("throttle of the engine in steady state", 0, 1, "", 0.0)
    gravity_m_s2: BodyVector | None = body_vector(
        "gravity in body axes; the force then includes the weight", "m/s^2", None
    )
    instead: ByName = by_name(
        "replacement values of derivatives in this check, where the source's check differs from the file",
        "a table of numbers by the names of derivatives, such as { CD0 = 0.0 }",
    )
    force_N: BodyVector | None = body_vector("total force", "N", None)
    moment_Nm: BodyVector | None = body_vector("total moment about the centre of gravity", "N m", None)
    thrust_N: float | None = number("thrust along body x", -1e7, 1e7, "N", None)
    torque_Nm: float | None = number("moment of the engine about body x", -1e7, 1e7, "N m", None)
    tolerance: float = positive("largest permitted difference, N and N m", 1e6, "")

    def consistency_problems(self) -> list[Problem]:
        """Return the problems of the check: no reference value is given, or `instead` names an unknown derivative."""
        problems = []
        if all(v is None for v in (self.force_N, self.moment_Nm, self.thrust_N, self.torque_Nm)):
            problems.append(Problem("force_N", "nothing", "one or more of force_N, moment_Nm, thrust_N and torque_Nm"))
        for name in self.instead:
            if name not in DERIVATIVES:
                expected = "the name of a derivative of [aerodynamics]"
                problems.append(Problem(f"instead.{name}", f"the unknown key {describe_value(name)}", expected))
        return problems


class TrimCheck(Table):
    """Check data: angle of attack, deflections and throttle of a steady flight, from the aircraft's source."""

    name: str = text_field("name of the check")
    airspeed_m_s: float = positive("true airspeed", 1000, "m/s")
    altitude_m: float = number("altitude above sea level", -1000, 30_000, "m", 0.0)
    path_angle_deg: float = number("climb angle", -60, 60, "deg", 0.0)
    alpha_deg: float | None = number("angle of attack", -180, 180, "deg", None)
    surfaces_deg: ByName = by_name("deflections by name", _BY_SURFACE)
    throttle: float | None = number("throttle", 0, 1, "", None)
    tolerance_deg: float = positive("largest permitted difference of angles", 30, "deg", 0.1)
    tolerance_throttle: float = positive("largest permitted difference of the throttle", 1, "", 0.01)

    def consistency_problems(self) -> list[Problem]:
        """Return the problem of the check if no reference value is given."""
        if self.alpha_deg is None and self.throttle is None and not self.surfaces_deg:
            return [Problem("alpha_deg", "nothing", "one or more of alpha_deg, throttle and surfaces_deg")]
        return []


class Check(Table):
    """Check data: results from the aircraft's source, for comparison with computed values."""

    forces: tuple[ForceCheck, ...] = tables(
        "force and moment of conditions", "tables [[check.forces]], in double brackets", at_least=0, default=()
    )
    trim: tuple[TrimCheck, ...] = tables(
        "steady flights", "tables [[check.trim]], in double brackets", at_least=0, default=()
    )


_QUANTITIES: dict[str, str] = dict(
    zip(COEFFICIENTS, ("lift", "drag", "side force", "roll moment", "pitch moment", "yaw moment"), strict=True)
)
_ARGUMENTS = {
    "0": "at zero angles",
    "_alpha": "per angle of attack",
    "_beta": "per sideslip",
    "_p": "per roll rate p b/2V",
    "_q": "per pitch rate q c/2V",
    "_r": "per yaw rate r b/2V",
    "_alpha2": "per square of the angle of attack",
    "_beta2": "per square of the sideslip",
}
AXES_MAX = 3


class _Build(Table):
    """Options of the aerodynamic model besides the derivatives: angle unit, induced drag, stall."""

    per: Literal["rad", "deg"] = Field(
        default="rad",
        description="angle that the derivatives by alpha, beta and the surfaces are given per; rates are always in "
        "rad/s",
    )
    oswald: float | None = positive(
        "e of the induced drag (CL0 + CL_alpha alpha)^2 / (pi e AR); left out: none", 2, "", None
    )
    stall_alpha_deg: float | None = positive(
        "alpha0, angle at which the lift changes to that of a flat plate; left out: no stall", 90, "deg", None
    )
    stall_sharpness: float = number("M, sharpness of the stall", 1, 1000, "per rad", 50.0)


def _field(name: str) -> Any:
    return float, number(f"{_QUANTITIES[name[:2]]} {_ARGUMENTS[name[2:]]}", -1e4, 1e4, "", 0.0)


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

    The table replaces one or more derivatives of the file.
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
        """Number of breakpoints of each argument, in the order of `over`."""
        return tuple(len(points) for points in self.breakpoints_deg)

    def consistency_problems(self) -> list[Problem]:
        """List axes that do not rise, and values whose shape does not fit the breakpoints."""
        if len(self.breakpoints_deg) != len(self.over):
            expected = f"a list of {len(self.over)} lists, one for each of over"
            return [Problem("breakpoints_deg", f"a list of {len(self.breakpoints_deg)}", expected)]
        problems = []
        for k, points in enumerate(self.breakpoints_deg):
            if len(points) < 2:
                problems.append(Problem(f"breakpoints_deg[{k}]", f"a list of {len(points)}", "two numbers or more"))
            for i, (previous, point) in enumerate(pairwise(points)):
                if not previous < point:
                    expected = f"a number greater than the one before it, {format_number(previous)}"
                    problems.append(Problem(f"breakpoints_deg[{k}][{i + 1}]", format_number(point), expected))
        return problems or shape_problems(self.values, self.shape, "values")


def shape_problems(values: object, shape: tuple[int, ...], path: str) -> list[Problem]:
    """List the faults of nested lists: lengths that differ from `shape`, and entries that are not finite numbers.

    `path` is the key of `values` in the problems.
    """
    if not shape:
        is_number = isinstance(values, int | float) and not isinstance(values, bool) and math.isfinite(values)
        return [] if is_number else [Problem(path, describe_value(values), "a finite number")]
    if not isinstance(values, list | tuple) or len(values) != shape[0]:
        return [Problem(path, describe_value(values), f"a list of {shape[0]}, one for each breakpoint")]
    return [problem for k, item in enumerate(values) for problem in shape_problems(item, shape[1:], f"{path}[{k}]")]


def _flat(values: Any) -> list[float]:
    return [x for item in values for x in _flat(item)] if isinstance(values, list | tuple) else [values]


Polynomial = Annotated[tuple[float, float, float], Field(strict=False)]


def _polynomial(description: str) -> Any:
    return Field(description=description, json_schema_extra=expects("a list of three numbers, factors of 1, J and J^2"))


def _point() -> Any:
    return body_vector("point of action of the thrust, relative to the centre of gravity", "m", (0.0, 0.0, 0.0))


def _thrust(description: str, default: object = PydanticUndefined) -> Any:
    expected = "a number of newtons, or a list over altitude_m of lists over mach"
    return Field(default, description=description, json_schema_extra=expects(expected))


def _axis(description: str, unit: str) -> Any:
    expected = f"a list of two rising numbers or more, {unit}".removesuffix(", ")
    return Field((), description=description, json_schema_extra=expects(expected))


_Numbers = Annotated[tuple[float, ...], Field(strict=False)]


class Jet(Table):
    """Jet engine; idle and full thrust are numbers, or tables over altitude and Mach number."""

    idle_N: Any = _thrust("thrust at idle", 0.0)
    full_N: Any = _thrust("thrust at full throttle")
    altitude_m: _Numbers = _axis("altitudes of the tables; left out: no table", "m")
    mach: _Numbers = _axis("Mach numbers of the tables; left out: no table", "")
    lag_s: float = positive("time constant from throttle to thrust", 60, "s")
    point_m: BodyVector = _point()

    def consistency_problems(self) -> list[Problem]:
        """List faults of axes and values, and a full thrust that nowhere exceeds the idle thrust."""
        if bool(self.altitude_m) != bool(self.mach):
            missing_key = "mach" if self.altitude_m else "altitude_m"
            return [Problem(missing_key, "nothing", "both altitude_m and mach, or none of them")]
        problems = [
            Problem(key, f"[{', '.join(map(format_number, points))}]", "two numbers or more that rise")
            for key, points in (("altitude_m", self.altitude_m), ("mach", self.mach))
            if len(points) == 1 or any(not previous < point for previous, point in pairwise(points))
        ]
        shape = (len(self.altitude_m), len(self.mach)) if self.mach else ()
        thrusts = {"idle_N": self.idle_N, "full_N": self.full_N}
        problems = problems or [
            problem
            for key, thrust in thrusts.items()
            for problem in shape_problems(thrust, () if isinstance(thrust, int | float) else shape, key)
        ]
        if not problems:
            # a number is the thrust at every breakpoint
            idle_N, full_N = (flat * (math.prod(shape) // len(flat)) for flat in map(_flat, thrusts.values()))
            greatest_N = max(full - idle for idle, full in zip(idle_N, full_N, strict=True))
            if greatest_N <= 0.0:
                problems.append(Problem("full_N", f"{greatest_N:g} N more than idle_N", "more thrust than idle_N"))
        return problems


class ElectricPropeller(Table):
    """Brushless motor with fixed-pitch propeller.

    Thrust and torque coefficients are polynomials in J = V / (n D), n in revolutions per second.
    """

    diameter_m: float = positive("diameter D of the propeller", 10, "m")
    thrust_coefficients: Polynomial = _polynomial("C_T(J): thrust / (rho n^2 D^4)")
    torque_coefficients: Polynomial = _polynomial("C_Q(J): torque / (rho n^2 D^5)")
    speed_constant_rpm_V: float = positive("K_V of the motor", 1e5, "rpm per volt")
    resistance_ohm: float = positive("R of the windings", 100, "ohm")
    no_load_current_A: float = number("i0, no-load current, for friction", 0, 1000, "A", 0.0)
    voltage_V: float = positive("voltage of the battery, at full throttle", 10_000, "V")
    direction: Literal["right", "left"] = Field(
        default="right", description="sense of rotation seen from behind; the reaction rolls the aircraft the other way"
    )
    lag_s: float = positive("time constant from throttle to voltage", 60, "s")
    point_m: BodyVector = _point()

    def consistency_problems(self) -> list[Problem]:
        """List coefficients of thrust or torque at J = 0 that are not above 0."""
        expected = "a positive first number: what the propeller does at rest"
        return [
            Problem(key, format_number(getattr(self, key)[0]), expected)
            for key in ("thrust_coefficients", "torque_coefficients")
            if not getattr(self, key)[0] > 0.0
        ]


class PistonPropeller(Table):
    """Normally aspirated piston engine with a propeller of constant efficiency and constant speed."""

    shaft_power_W: float = positive("shaft power at full throttle at sea level", 1e8, "W")
    efficiency: float = positive("efficiency of the propeller in fast flight", 1, "", 0.8)
    static_thrust_N: float = positive("static thrust at sea level", 1e6, "N")
    speed_rpm: float | None = positive(
        "speed of the propeller, for its torque reaction; left out: no reaction", 1e5, "rpm", None
    )
    direction: Literal["right", "left"] = Field(
        default="right", description="sense of rotation seen from behind; the reaction rolls the aircraft the other way"
    )
    lag_s: float = positive("time constant from throttle to power", 60, "s")
    point_m: BodyVector = _point()


class Engine(Table):
    """Engine of the aircraft: exactly one of the tables for a jet, an electric propeller and a piston propeller."""

    jet: Jet | None = table("a jet engine", "a table [engine.jet]", None)
    electric_propeller: ElectricPropeller | None = table(
        "an electric motor with its propeller", "a table [engine.electric_propeller]", None
    )
    piston_propeller: PistonPropeller | None = table(
        "a piston engine with its propeller", "a table [engine.piston_propeller]", None
    )

    @property
    def kind(self) -> str:
        """Key of the engine's table: "jet", "electric_propeller" or "piston_propeller"."""
        return next(name for name in type(self).model_fields if getattr(self, name) is not None)

    def consistency_problems(self) -> list[Problem]:
        """Return the problem of the table [engine] if not exactly one kind of engine is given."""
        kinds = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(kinds) == 1:
            return []
        tables = "[engine.jet], [engine.electric_propeller], [engine.piston_propeller]"
        expected = f"one of the tables {tables}; without an engine, no table [engine] at all"
        return [Problem("", " and ".join(kinds) or "nothing", expected)]
