"""What an aircraft weighs and measures, its surfaces, and the ranges that its data hold for."""

from typing import Annotated, Any

from pydantic import Field
from pydantic_core import PydanticUndefined

from anser.body_checks import body_faults
from anser.derivative_names import ARGUMENTS
from anser.scenario.errors import Problem, plain, show
from anser.scenario.schema_base import Table, expects, number

SURFACE_PATTERN = r"^[a-z][a-z0-9_]{0,31}$"
_SURFACE_NAME = "a name of 1 to 32 small letters, digits and underscores that begins with a letter"
_LAG_WAYS = "either lag_s, or frequency_rad_s and damping; not both"
_STOP_WAYS = "either limit_deg, or lower_deg and upper_deg; not both"
NEAR_ANGLES = {column.removeprefix("_") for column in ARGUMENTS if column != "0"}
"""Names that a surface cannot have, because derivatives by it would have another's name."""

Range = Annotated[tuple[float, float], Field(strict=False)]
Place = Annotated[tuple[float, float, float], Field(strict=False)]


def span(about: str, unit: str, default: object = PydanticUndefined) -> Any:
    """Declare a field that holds a least and a greatest value."""
    return Field(default, description=about, json_schema_extra=expects(f"a list of two numbers, least first, {unit}"))


def place(about: str, unit: str, default: object = PydanticUndefined) -> Any:
    """Declare a field that holds three numbers in body axes: forward, right, down."""
    words = f"a list of three numbers (forward, right, down), {unit}"
    return Field(default, description=about, json_schema_extra=expects(words))


def unordered(table: Table, *keys: str) -> list[Problem]:
    """Find ranges whose first value is not less than the second."""
    found = []
    for key in keys:
        ends = getattr(table, key)
        if ends is not None and not ends[0] < ends[1]:
            found.append(Problem(key, f"[{plain(ends[0])}, {plain(ends[1])}]", "the lesser of two numbers first"))
    return found


class Mass(Table):
    """Mass and inertia about the centre of gravity, body axes."""

    mass_kg: float = number("mass", 0, 1e6, "kg", above=True)
    Jxx_kg_m2: float = number("moment of inertia in roll", 0, 1e9, "kg m^2", above=True)
    Jyy_kg_m2: float = number("moment of inertia in pitch", 0, 1e9, "kg m^2", above=True)
    Jzz_kg_m2: float = number("moment of inertia in yaw", 0, 1e9, "kg m^2", above=True)
    Jxz_kg_m2: float = number("product of inertia, the integral of x z dm", -1e9, 1e9, "kg m^2", 0.0)
    Jxy_kg_m2: float = number("product of inertia, the integral of x y dm", -1e9, 1e9, "kg m^2", 0.0)
    Jyz_kg_m2: float = number("product of inertia, the integral of y z dm", -1e9, 1e9, "kg m^2", 0.0)
    spin_momentum_kg_m2_s: float = number("angular momentum of spinning parts about body x", -1e6, 1e6, "kg m^2/s", 0.0)

    @property
    def inertia(self) -> tuple[tuple[float, float, float], ...]:
        """Inertia matrix, kg m^2."""
        return (
            (self.Jxx_kg_m2, -self.Jxy_kg_m2, -self.Jxz_kg_m2),
            (-self.Jxy_kg_m2, self.Jyy_kg_m2, -self.Jyz_kg_m2),
            (-self.Jxz_kg_m2, -self.Jyz_kg_m2, self.Jzz_kg_m2),
        )

    def own_problems(self) -> list[Problem]:
        """Find a matrix of inertia that no body has."""
        return [
            Problem(f"{fault.quantity}_kg_m2", plain(fault.arrived), fault.expected)
            for fault in body_faults({}, self.inertia)
        ]


class Geometry(Table):
    """Reference lengths and area of the coefficients, and where the centre of gravity lies."""

    span_m: float = number("wing span b", 0, 200, "m", above=True)
    wing_area_m2: float = number("wing area S", 0, 5000, "m^2", above=True)
    mean_chord_m: float = number("mean chord c", 0, 100, "m", above=True)
    cg_offset_m: Place = place("centre of gravity seen from the point that the moments refer to", "m", (0.0, 0.0, 0.0))


class Actuated(Table):
    """A control surface as its actuator moves it: stops and dynamics."""

    name: str = Field(pattern=SURFACE_PATTERN, description="name, unique", json_schema_extra=expects(_SURFACE_NAME))
    limit_deg: float | None = number("stops on both sides", 0, 120, "deg", None, above=True)
    lower_deg: float | None = number("stop, where the two differ", -120, 120, "deg", None)
    upper_deg: float | None = number("stop, where the two differ", -120, 120, "deg", None)
    rate_limit_deg_s: float = number("greatest speed", 0, 10_000, "deg/s", above=True)
    lag_s: float | None = number("time constant of an actuator of first order", 0, 5, "s", None, above=True)
    frequency_rad_s: float | None = number(
        "natural frequency of one of second order", 0, 1000, "rad/s", None, above=True
    )
    damping: float | None = number("its damping ratio", 0, 5, "", None, above=True)

    @property
    def stops_deg(self) -> tuple[float, float]:
        """Lower and upper stop."""
        if self.limit_deg is not None:
            return -self.limit_deg, self.limit_deg
        return self.lower_deg or 0.0, self.upper_deg or 0.0

    def own_problems(self) -> list[Problem]:
        """Find stops and lags given in both ways or in none."""
        found = []
        ends, second = (self.lower_deg, self.upper_deg), (self.frequency_rad_s, self.damping)
        if self.name in NEAR_ANGLES:
            found.append(Problem("name", show(self.name), f"another name than {', '.join(sorted(NEAR_ANGLES))}"))
        if self.limit_deg is None and None in ends:
            found.append(
                Problem("limit_deg", "nothing" if self.limit_deg is None else plain(self.limit_deg), _STOP_WAYS)
            )
        elif self.limit_deg is not None and ends != (None, None):
            found.append(Problem("limit_deg", f"{plain(self.limit_deg)} beside lower_deg or upper_deg", _STOP_WAYS))
        elif not self.stops_deg[0] < self.stops_deg[1]:
            words = f"less than upper_deg, which is {plain(self.stops_deg[1])} deg"
            found.append(Problem("lower_deg", plain(self.stops_deg[0]), words))
        if (self.lag_s is None) == (None in second) or (self.lag_s is not None and second != (None, None)):
            arrived = "nothing" if self.lag_s is None else f"{plain(self.lag_s)} beside frequency_rad_s or damping"
            found.append(Problem("lag_s", arrived, _LAG_WAYS))
        return found


class Surface(Actuated):
    """A control surface, and what it does, per angle of deflection."""

    CL: float = number("lift per angle", -1e3, 1e3, "", 0.0)
    CD: float = number("drag per angle", -1e3, 1e3, "", 0.0)
    CY: float = number("side force per angle", -1e3, 1e3, "", 0.0)
    Cl: float = number("roll moment per angle", -1e3, 1e3, "", 0.0)
    Cm: float = number("pitch moment per angle", -1e3, 1e3, "", 0.0)
    Cn: float = number("yaw moment per angle", -1e3, 1e3, "", 0.0)


class Validity(Table):
    """Where the data hold; outside it a flight is marked, and no flight starts there."""

    airspeed_m_s: Range = span("true airspeed", "m/s")
    alpha_deg: Range = span("angle of attack", "deg")
    beta_deg: Range = span("sideslip", "deg")
    altitude_m: Range | None = span("altitude above sea level; left out: any", "m", None)
    mach: Range | None = span("Mach number; left out: any", "", None)

    def own_problems(self) -> list[Problem]:
        """Find ranges without a width or beyond what angles and speeds can be."""
        found = unordered(self, "airspeed_m_s", "alpha_deg", "beta_deg", "altitude_m", "mach")
        for key, low, high, unit in (
            ("airspeed_m_s", 0.0, 1000.0, "m/s"),
            ("alpha_deg", -180.0, 180.0, "deg"),
            ("beta_deg", -90.0, 90.0, "deg"),
        ):
            ends = getattr(self, key)
            if min(ends) < low or max(ends) > high:
                arrived = f"[{plain(ends[0])}, {plain(ends[1])}]"
                found.append(Problem(key, arrived, f"numbers from {plain(low)} to {plain(high)} {unit}"))
        return found
