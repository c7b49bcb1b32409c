"""Tables of an aircraft file for mass, geometry, control surfaces, validity ranges and check data."""

from typing import Annotated, Any

from pydantic import Field
from pydantic_core import PydanticUndefined

from anser.airframe_data import DERIVATIVE_ARGUMENTS, DERIVATIVES, body_faults
from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import Table, expects, number, tables

SURFACE_PATTERN = r"^[a-z][a-z0-9_]{0,31}$"
_SURFACE_NAME = "a name of 1 to 32 small letters, digits and underscores that begins with a letter"
_LAG_WAYS = "either lag_s, or frequency_rad_s and damping; not both"
_STOP_WAYS = "either limit_deg, or lower_deg and upper_deg; not both"
RESERVED_SURFACE_NAMES = {column.removeprefix("_") for column in DERIVATIVE_ARGUMENTS if column != "0"}
"""Forbidden surface names: derivatives by the surface would coincide with other derivatives."""

Range = Annotated[tuple[float, float], Field(strict=False)]
BodyVector = Annotated[tuple[float, float, float], Field(strict=False)]


def interval(description: str, unit: str, default: object = PydanticUndefined) -> Any:
    """Declare a field for a range: a list of minimum and maximum."""
    return Field(
        default, description=description, json_schema_extra=expects(f"a list of two numbers, least first, {unit}")
    )


def body_vector(description: str, unit: str, default: object = PydanticUndefined) -> Any:
    """Declare a field for three numbers in body axes: forward, right, down."""
    expected = f"a list of three numbers (forward, right, down), {unit}"
    return Field(default, description=description, json_schema_extra=expects(expected))


def unordered_range_problems(table: Table, *keys: str) -> list[Problem]:
    """Report ranges whose minimum is not less than the maximum."""
    problems = []
    for key in keys:
        bounds = getattr(table, key)
        if bounds is not None and not bounds[0] < bounds[1]:
            problems.append(
                Problem(
                    key, f"[{format_number(bounds[0])}, {format_number(bounds[1])}]", "the lesser of two numbers first"
                )
            )
    return problems


class Mass(Table):
    """Mass, and inertia about the centre of gravity in body axes."""

    mass_kg: float = number("mass", 0, 1e6, "kg", exclusive_minimum=True)
    Jxx_kg_m2: float = number("moment of inertia in roll", 0, 1e9, "kg m^2", exclusive_minimum=True)
    Jyy_kg_m2: float = number("moment of inertia in pitch", 0, 1e9, "kg m^2", exclusive_minimum=True)
    Jzz_kg_m2: float = number("moment of inertia in yaw", 0, 1e9, "kg m^2", exclusive_minimum=True)
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
        """Report an inertia matrix that is impossible for a rigid body."""
        return [
            Problem(f"{fault.quantity}_kg_m2", format_number(fault.arrived), fault.expected)
            for fault in body_faults({}, self.inertia)
        ]


class Geometry(Table):
    """Reference lengths and area of the coefficients, and position of the centre of gravity."""

    span_m: float = number("wing span b", 0, 200, "m", exclusive_minimum=True)
    wing_area_m2: float = number("wing area S", 0, 5000, "m^2", exclusive_minimum=True)
    mean_chord_m: float = number("mean chord c", 0, 100, "m", exclusive_minimum=True)
    cg_offset_m: BodyVector = body_vector(
        "centre of gravity relative to the moment reference point", "m", (0.0, 0.0, 0.0)
    )


class ActuatedSurface(Table):
    """Control surface with its stops and actuator dynamics."""

    name: str = Field(pattern=SURFACE_PATTERN, description="name, unique", json_schema_extra=expects(_SURFACE_NAME))
    limit_deg: float | None = number("stops on both sides", 0, 120, "deg", None, exclusive_minimum=True)
    lower_deg: float | None = number("lower stop, if the stops are not symmetric", -120, 120, "deg", None)
    upper_deg: float | None = number("upper stop, if the stops are not symmetric", -120, 120, "deg", None)
    rate_limit_deg_s: float = number("greatest rate", 0, 10_000, "deg/s", exclusive_minimum=True)
    lag_s: float | None = number("time constant of an actuator of first order", 0, 5, "s", None, exclusive_minimum=True)
    frequency_rad_s: float | None = number(
        "natural frequency of an actuator of second order", 0, 1000, "rad/s", None, exclusive_minimum=True
    )
    damping: float | None = number(
        "damping ratio of an actuator of second order", 0, 5, "", None, exclusive_minimum=True
    )

    @property
    def stops_deg(self) -> tuple[float, float]:
        """Lower and upper stop, deg."""
        if self.limit_deg is not None:
            return -self.limit_deg, self.limit_deg
        return self.lower_deg or 0.0, self.upper_deg or 0.0

    def consistency_problems(self) -> list[Problem]:
        """Report stops or actuator dynamics that are missing or given in two ways."""
        problems = []
        stops, second_order = (self.lower_deg, self.upper_deg), (self.frequency_rad_s, self.damping)
        if self.name in RESERVED_SURFACE_NAMES:
            problems.append(
                Problem(
                    "name", describe_value(self.name), f"another name than {', '.join(sorted(RESERVED_SURFACE_NAMES))}"
                )
            )
        if self.limit_deg is None and None in stops:
            problems.append(
                Problem("limit_deg", "nothing" if self.limit_deg is None else format_number(self.limit_deg), _STOP_WAYS)
            )
        elif self.limit_deg is not None and stops != (None, None):
            problems.append(
                Problem("limit_deg", f"{format_number(self.limit_deg)} beside lower_deg or upper_deg", _STOP_WAYS)
            )
        elif not self.stops_deg[0] < self.stops_deg[1]:
            expected = f"less than upper_deg, which is {format_number(self.stops_deg[1])} deg"
            problems.append(Problem("lower_deg", format_number(self.stops_deg[0]), expected))
        if (self.lag_s is None) == (None in second_order) or (self.lag_s is not None and second_order != (None, None)):
            arrived = (
                "nothing" if self.lag_s is None else f"{format_number(self.lag_s)} beside frequency_rad_s or damping"
            )
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
        """Report empty ranges, and ranges beyond physical limits."""
        problems = unordered_range_problems(self, "airspeed_m_s", "alpha_deg", "beta_deg", "altitude_m", "mach")
        for key, low, high, unit in (
            ("airspeed_m_s", 0.0, 1000.0, "m/s"),
            ("alpha_deg", -180.0, 180.0, "deg"),
            ("beta_deg", -90.0, 90.0, "deg"),
        ):
            bounds = getattr(self, key)
            if min(bounds) < low or max(bounds) > high:
                arrived = f"[{format_number(bounds[0])}, {format_number(bounds[1])}]"
                problems.append(
                    Problem(key, arrived, f"numbers from {format_number(low)} to {format_number(high)} {unit}")
                )
        return problems


_BY_SURFACE = "a table of numbers by the names of the surfaces"
ByName = Annotated[dict[str, float], Field(strict=False)]


class ForceCheck(Table):
    """Check data: force, moment, thrust and torque from the source, in one flight condition."""

    name: str = Field(description="name of the check", json_schema_extra=expects("a text in quotes"))
    airspeed_m_s: float = number("true airspeed", 0, 1000, "m/s")
    alpha_rad: float = number("angle of attack", -3.2, 3.2, "rad", 0.0)
    beta_rad: float = number("sideslip", -1.6, 1.6, "rad", 0.0)
    rates_rad_s: BodyVector = body_vector("body rates", "rad/s", (0.0, 0.0, 0.0))
    altitude_m: float = number("altitude above sea level", -1000, 30_000, "m", 0.0)
    density_kg_m3: float | None = number(
        "density of the air; left out: of the standard atmosphere", 0, 10, "kg/m^3", None, exclusive_minimum=True
    )
    surfaces_rad: ByName = Field(
        default_factory=dict, description="deflections by name; others 0", json_schema_extra=expects(_BY_SURFACE)
    )
    throttle: float = number("throttle of the engine in steady state", 0, 1, "", 0.0)
    gravity_m_s2: BodyVector | None = body_vector(
        "gravity in body axes; the force then includes the weight", "m/s^2", None
    )
    instead: ByName = Field(
        default_factory=dict,
        description="replacement values of derivatives in this check, where the source's check differs from the file",
        json_schema_extra=expects("a table of numbers by the names of derivatives, such as { CD0 = 0.0 }"),
    )
    force_N: BodyVector | None = body_vector("total force", "N", None)
    moment_Nm: BodyVector | None = body_vector("total moment about the centre of gravity", "N m", None)
    thrust_N: float | None = number("thrust along body x", -1e7, 1e7, "N", None)
    torque_Nm: float | None = number("moment of the engine about body x", -1e7, 1e7, "N m", None)
    tolerance: float = number("largest permitted difference, N and N m", 0, 1e6, "", exclusive_minimum=True)

    def consistency_problems(self) -> list[Problem]:
        """Report a check without reference values, and replacement values for unknown derivatives."""
        problems = []
        if all(v is None for v in (self.force_N, self.moment_Nm, self.thrust_N, self.torque_Nm)):
            problems.append(Problem("force_N", "nothing", "one or more of force_N, moment_Nm, thrust_N and torque_Nm"))
        for name in self.instead:
            if name not in DERIVATIVES:
                expected = "the name of a derivative of [aerodynamics]"
                problems.append(Problem(f"instead.{name}", f"the unknown key {describe_value(name)}", expected))
        return problems


class TrimCheck(Table):
    """Check data: a trim in steady flight from the source."""

    name: str = Field(description="name of the check", json_schema_extra=expects("a text in quotes"))
    airspeed_m_s: float = number("true airspeed", 0, 1000, "m/s", exclusive_minimum=True)
    altitude_m: float = number("altitude above sea level", -1000, 30_000, "m", 0.0)
    path_angle_deg: float = number("climb angle", -60, 60, "deg", 0.0)
    alpha_deg: float | None = number("angle of attack", -180, 180, "deg", None)
    surfaces_deg: ByName = Field(
        default_factory=dict, description="deflections by name", json_schema_extra=expects(_BY_SURFACE)
    )
    throttle: float | None = number("throttle", 0, 1, "", None)
    tolerance_deg: float = number("largest permitted difference of angles", 0, 30, "deg", 0.1, exclusive_minimum=True)
    tolerance_throttle: float = number(
        "largest permitted difference of the throttle", 0, 1, "", 0.01, exclusive_minimum=True
    )

    def consistency_problems(self) -> list[Problem]:
        """Report a check without reference values."""
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
