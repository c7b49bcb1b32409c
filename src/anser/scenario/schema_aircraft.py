"""Scenario tables for goals and aircraft: airframe, start, rendezvous, and autopilot gains."""

import itertools
import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, WithJsonSchema

from anser.aircraft_files.deviations import F16_FACTORS, PRIMARY_SURFACES, Deviation
from anser.aircraft_files.schema import AirframeFile, DaveMlFile
from anser.aircraft_files.sources import (
    AIRFRAMES,
    ALTITUDE_MAX_M,
    LIBRARY_FILES,
    SPEED_MAX_M_S,
    AirframeRange,
    aircraft_types,
    airframe_range,
    is_aircraft_file,
    library_file,
    unknown_type_hint,
    validate_airframe,
)
from anser.airframe_data import BODY_COEFFICIENTS, DERIVATIVES
from anser.config.errors import Problem, describe_value, format_number, problem_error
from anser.config.tables import (
    Gain3,
    Table,
    Vector,
    expects,
    gain,
    identifier,
    interpolate,
    is_stored,
    number,
    optional_gain,
    table,
    tables,
    velocity_on_course,
)
from anser.scenario.schema_settings import (
    CALIBRATED_AIRSPEED,
    DURATION_MAX_S,
    EQUIVALENT_AIRSPEED,
    MACH,
    AirspeedTable,
    true_airspeed_key,
)

POSITION_MAX_M = 500_000.0
GROUND_MIN_M = -500.0  # the deepest dry land lies at -430 m

_WAYS = "either north_m and east_m (with speed_m_s and course_deg if it moves), or waypoints; not both"
_STEADY_KEYS = ("north_m", "east_m", "altitude_m", "speed_m_s", "course_deg", "climb_rate_m_s")


class Waypoint(Table):
    """A point on a goal's path with the time of passage."""

    time_s: float = number("time since the start of the flight", 0, 1e6, "s")
    north_m: float = number("north of the origin", -POSITION_MAX_M, POSITION_MAX_M, "m")
    east_m: float = number("east of the origin", -POSITION_MAX_M, POSITION_MAX_M, "m")
    altitude_m: float = number("height above sea level", GROUND_MIN_M, ALTITUDE_MAX_M, "m")

    @property
    def position_m(self) -> Vector:
        """Position (north, east, up), m."""
        return self.north_m, self.east_m, self.altitude_m


class Goal(Table):
    """Position, at rest or moving, near which aircraft arrive: a ship, a buoy, a point of a storm, a balloon."""

    name: str = identifier("name of the goal, unique")
    kind: Literal["surface", "airborne"] = Field(description="on the surface or in the air")
    north_m: float | None = number("north of the origin at time 0", -POSITION_MAX_M, POSITION_MAX_M, "m", None)
    east_m: float | None = number("east of the origin at time 0", -POSITION_MAX_M, POSITION_MAX_M, "m", None)
    altitude_m: float = number("height above sea level at time 0", GROUND_MIN_M, ALTITUDE_MAX_M, "m", 0.0)
    speed_m_s: float = number("horizontal speed over the ground", 0, SPEED_MAX_M_S, "m/s", 0.0)
    course_deg: float = number("direction of its motion over the ground", -360, 360, "deg", 0.0)
    climb_rate_m_s: float = number("rate of climb", -100, 100, "m/s", 0.0)
    waypoints: tuple[Waypoint, ...] | None = tables(
        "motion of the goal, instead of position and speed",
        "a list of waypoints, at least one",
        at_least=1,
        default=None,
    )

    @property
    def label(self) -> str:
        """Name for messages, such as ``goal "ship"``."""
        return f'goal "{self.name}"'

    def consistency_problems(self) -> list[Problem]:
        """List a motion that is missing or defined twice, and waypoint times that do not start at 0 or do not rise."""
        problems: list[Problem] = []
        if self.waypoints is None:
            missing = [key for key in ("north_m", "east_m") if getattr(self, key) is None]
            problems.extend(Problem(key, "nothing", f"a number (m): {_WAYS}") for key in missing)
        else:
            conflicting_keys = [key for key in _STEADY_KEYS if key in self.model_fields_set]
            problems.extend(
                Problem(key, f"{format_number(getattr(self, key))} beside waypoints", _WAYS) for key in conflicting_keys
            )
            problems.extend(_waypoint_order_problems(self.waypoints))
        return problems

    def velocity_m_s(self) -> Vector:
        """Return the velocity over the ground (north, east, up), m/s; zero for a goal with waypoints."""
        return velocity_on_course(self.speed_m_s, self.course_deg, self.climb_rate_m_s)

    def position_m(self, time_s: float) -> Vector:
        """Return the position (north, east, up), m, at a time since the start (s); constant after the last waypoint."""
        if self.waypoints is None:
            north, east, up = self.velocity_m_s()
            start_north_m, start_east_m = self.north_m or 0.0, self.east_m or 0.0
            return start_north_m + north * time_s, start_east_m + east * time_s, self.altitude_m + up * time_s
        return interpolate([(waypoint.time_s, waypoint.position_m) for waypoint in self.waypoints], time_s)


def _waypoint_order_problems(points: tuple[Waypoint, ...]) -> list[Problem]:
    """List the waypoints at which the times do not start at 0 or do not increase."""
    times_s, expected = [point.time_s for point in points], "0: the first waypoint is where it starts"
    problems = [] if times_s[0] == 0 else [Problem("waypoints[0].time_s", format_number(times_s[0]), expected)]
    for index, (previous_s, time_s) in enumerate(itertools.pairwise(times_s), 1):
        if time_s <= previous_s:
            expected = f"more than the {format_number(previous_s)} s of the waypoint before"
            problems.append(Problem(f"waypoints[{index}].time_s", format_number(time_s), expected))
    return problems


STAND_OFF_MAX_M = 20_000.0
PATH_ANGLE_MAX_DEG = 60.0
DAMPING_MIN = 0.1
_GAIN_WAYS = "either proportional and integral, or bandwidth_rad_s and damping; not both"


class Start(AirspeedTable):
    """Initial condition of an aircraft; speed and course are relative to the air."""

    north_m: float = number("north of the origin", -POSITION_MAX_M, POSITION_MAX_M, "m")
    east_m: float = number("east of the origin", -POSITION_MAX_M, POSITION_MAX_M, "m")
    altitude_m: float = number("height above sea level", 0, ALTITUDE_MAX_M, "m")
    speed_m_s: float | None = true_airspeed_key("true airspeed, or one of the three keys below")
    speed_cas_m_s: float | None = CALIBRATED_AIRSPEED
    speed_eas_m_s: float | None = EQUIVALENT_AIRSPEED
    mach: float | None = MACH
    course_deg: float = number("direction of flight, clockwise from north", -360, 360, "deg")
    path_angle_deg: float = number("climb angle", -PATH_ANGLE_MAX_DEG, PATH_ANGLE_MAX_DEG, "deg", 0.0)

    @property
    def position_m(self) -> Vector:
        """Position (north, east, up), m."""
        return self.north_m, self.east_m, self.altitude_m

    def consistency_problems(self) -> list[Problem]:
        """Return a problem if the start has no airspeed or more than one."""
        return self.airspeed_problems(required=True)


class Rendezvous(Table):
    """The rendezvous point relative to the goal, and the direction of arrival."""

    stand_off_up_m: float = number("height above the goal", -STAND_OFF_MAX_M, STAND_OFF_MAX_M, "m", 300.0)
    stand_off_north_m: float = number("distance north of the goal", -STAND_OFF_MAX_M, STAND_OFF_MAX_M, "m", 0.0)
    stand_off_east_m: float = number("distance east of the goal", -STAND_OFF_MAX_M, STAND_OFF_MAX_M, "m", 0.0)
    course_deg: float | None = number(
        "final course over the ground; left out: any (published planner: along the line from the start)",
        *(-360, 360, "deg", None),
    )
    path_angle_deg: float | None = number(
        "final climb angle over the ground; left out: the climb rate of the goal, or any with a spline (published "
        "planner: along the line from the start)",
        *(-PATH_ANGLE_MAX_DEG, PATH_ANGLE_MAX_DEG, "deg", None),
    )

    @property
    def stand_off_m(self) -> Vector:
        """Vector from the goal to the rendezvous point (north, east, up), m."""
        return self.stand_off_north_m, self.stand_off_east_m, self.stand_off_up_m

    @property
    def stand_off_distance_m(self) -> float:
        """Distance of the rendezvous point from the goal, m."""
        return math.hypot(*self.stand_off_m)


class _LoopGains(Table):
    """Keys common to the gains of all loops: bandwidth and damping, from which gains may be computed."""

    bandwidth_rad_s: Gain3 | None = optional_gain("required bandwidth, instead of proportional and integral", "rad/s")
    damping: Gain3 | None = optional_gain("required damping of the pair of poles; left out: no integral")

    def consistency_problems(self) -> list[Problem]:
        """List gains given with a bandwidth, a damping without a bandwidth, and a damping below `DAMPING_MIN`."""
        problems = []
        if self.bandwidth_rad_s is not None:
            conflicting_keys = [key for key in ("proportional", "integral") if key in self.model_fields_set]
            problems = [
                Problem(key, f"{format_number(getattr(self, key)[0])} beside bandwidth_rad_s", _GAIN_WAYS)
                for key in conflicting_keys
            ]
        elif self.damping is not None:
            problems = [Problem("damping", f"{format_number(self.damping[0])} without bandwidth_rad_s", _GAIN_WAYS)]
        if self.damping is not None and min(self.damping) < DAMPING_MIN:
            problems.append(Problem("damping", format_number(min(self.damping)), f"a number from {DAMPING_MIN:g}"))
        return problems


class RateGains(_LoopGains):
    """Gains of the fast loop, one for each axis: roll rate P, pitch rate Q, yaw rate R."""

    proportional: Gain3 = gain("of the error, 1/s", 10.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.25)
    derivative: Gain3 = gain("of the error's rate", 1.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class AttitudeGains(_LoopGains):
    """Gains of the middle loop, one for each axis: bank mu, angle of attack alpha, sideslip beta."""

    proportional: Gain3 = gain("of the error, 1/s", 2.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.0)
    derivative: Gain3 = gain("of the error's rate", 0.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class VelocityGains(_LoopGains):
    """Gains of the slow loop, one for each axis: airspeed V, path angle gamma, course chi."""

    proportional: Gain3 = gain("of the error, 1/s", 1.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.025)
    derivative: Gain3 = gain("of the error's rate", 0.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class Gains(Table):
    """Gains of the autopilot's loops, by default published (F-16) or derived, and the type of dynamic inversion."""

    inversion: Literal["model", "incremental", "adaptive"] = Field(
        default="model",
        description="inversion of the model, of increments from measured accelerations, or of increments with a model "
        "that is corrected in flight",
    )
    sensor_bandwidth_rad_s: float = number(
        "bandwidth of the sensor filter of the incremental and the adaptive inversion", 1, 100, "rad/s", 20.0
    )

    rates: RateGains = table("fast loop", "a table [aircraft.gains.rates]", RateGains())
    attitude: AttitudeGains = table("middle loop", "a table [aircraft.gains.attitude]", AttitudeGains())
    velocity: VelocityGains = table("slow loop", "a table [aircraft.gains.velocity]", VelocityGains())


def _validated_file(value: object, info: ValidationInfo) -> object:
    """Validate the contents of an aircraft file; None and validated contents are returned unchanged."""
    if value is None or is_aircraft_file(value):
        return value
    if isinstance(value, dict):
        return validate_airframe(value, "", is_stored=is_stored(info))
    raise problem_error("", describe_value(value), _AIRFRAME_PATH)


_AIRFRAME_PATH = 'the path of an aircraft file, seen from the scenario, such as "my-uav.toml"'
_Airframe = Annotated[
    AirframeFile | DaveMlFile | None, BeforeValidator(_validated_file), WithJsonSchema({"type": ["string", "object"]})
]


LEARNING_S = 6.0
"""Default of `Adaptation.learning_s` for an aircraft whose autopilot does not know the aerodynamics, s."""
PROBING_DEG = 1.0
"""Default of `Adaptation.probing_deg` for an aircraft whose autopilot does not know the aerodynamics, deg."""


class Adaptation(Table):
    """Estimation of the aerodynamic coefficients in flight, for the adaptive inversion."""

    method: Literal["least-squares", "gradient"] = Field(
        default="least-squares",
        description="recursive least squares of all derivatives, or gradient steps of the control effectiveness",
    )
    aerodynamics_known: bool = Field(
        default=True,
        description="false: the autopilot knows mass, inertia, geometry and engine alone",
        json_schema_extra=expects("true or false"),
    )
    probing_deg: float | None = number(
        f"amplitude of test inputs to the surfaces, while their effectiveness is uncertain; left out: 0, or "
        f"{PROBING_DEG:g} without known aerodynamics",
        *(0, 5, "deg", None),
    )
    learning_s: float | None = number(
        f"time from the start in which the aircraft moves its surfaces to learn; left out: 0, or {LEARNING_S:g} "
        "without known aerodynamics",
        *(0, 60, "s", None),
    )

    @property
    def probing(self) -> float:
        """Amplitude of the test inputs to the surfaces, deg: `probing_deg` or its default; 0: no test inputs."""
        default = 0.0 if self.aerodynamics_known else PROBING_DEG
        return default if self.probing_deg is None else self.probing_deg

    @property
    def learning(self) -> float:
        """Time from the start in which the aircraft moves its surfaces to learn, s: `learning_s` or its default."""
        default = 0.0 if self.aerodynamics_known else LEARNING_S
        return default if self.learning_s is None else self.learning_s

    def consistency_problems(self) -> list[Problem]:
        """List a learning time without test inputs, and keys that prevent the learning of unknown aerodynamics."""
        problems = []
        if not self.aerodynamics_known and self.learning < LEARNING_MIN_S:
            expected = f"{LEARNING_MIN_S:g} or more without known aerodynamics"
            problems.append(Problem("learning_s", format_number(self.learning), expected))
        if self.learning > 0.0 and self.probing == 0.0:
            problems.append(Problem("probing_deg", "0", "above 0 with a time of learning"))
        if not self.aerodynamics_known and self.method == "gradient":
            expected = '"least-squares": gradient steps need a model to start from'
            problems.append(Problem("method", '"gradient" without known aerodynamics', expected))
        return problems


LEARNING_MIN_S = 1.0


class Aircraft(AirspeedTable):
    """One aircraft of the fleet."""

    name: str = identifier("name of the aircraft, unique")
    type: str = Field(
        "f16",
        description="airframe of the library or of an entry point",
        json_schema_extra=expects(f"the name of an airframe: {', '.join(AIRFRAMES)}, or that of an entry point"),
    )
    airframe: _Airframe = table("an aircraft file in the place of type", _AIRFRAME_PATH, None)
    variant: Literal["textbook", "s119", "founding", "tp1538", "global"] = Field(
        default="textbook", description="published set of the F-16's aerodynamic tables, or its smooth global model"
    )
    x_cg_over_c: float | None = number("centre of mass; left out: the variant's own", 0.1, 0.5, "of the chord", None)
    goal: str = identifier("name of the goal to meet")
    bend: Literal["auto", "left", "right"] = Field(
        default="auto",
        description="side of a detour, seen along the flight; of the certified planner's paths, detours and racetracks "
        "alone have a side, and other paths are searched with auto only",
    )
    speed_m_s: float | None = true_airspeed_key("preferred true airspeed, instead of fleet.speed_m_s (certified)")
    speed_cas_m_s: float | None = CALIBRATED_AIRSPEED
    speed_eas_m_s: float | None = EQUIVALENT_AIRSPEED
    mach: float | None = MACH
    arrive_s: float | None = number('time of arrival, with arrival.rule "times"', 1, DURATION_MAX_S, "s", None)
    arrive_from_s: float | None = number('earliest arrival, with arrival.rule "windows"', 0, DURATION_MAX_S, "s", None)
    arrive_to_s: float | None = number('latest arrival, with arrival.rule "windows"', 1, DURATION_MAX_S, "s", None)
    start: Start = table("initial condition", "a table [aircraft.start]")
    rendezvous: Rendezvous = table("rendezvous point", "a table [aircraft.rendezvous]", Rendezvous())
    gains: Gains = table("gains of the autopilot", "tables [aircraft.gains.rates] and so on", Gains())
    adaptation: Adaptation = table(
        "estimation in flight, for the adaptive inversion", "a table [aircraft.adaptation]", Adaptation()
    )
    deviation: Deviation = table(
        "deviation of the flown aircraft from the nominal one of autopilot and planner",
        "a table [aircraft.deviation]",
        Deviation(),
    )

    @property
    def label(self) -> str:
        """Name for messages, such as ``aircraft "north"``."""
        return f'aircraft "{self.name}"'

    @property
    def range(self) -> AirframeRange:
        """Ranges of airspeed (m/s), altitude (m) and angle of attack (deg) that the aircraft's data cover."""
        return airframe_range(self.type, self.airframe, self.variant)

    @property
    def is_library_f16(self) -> bool:
        """Whether the airframe is the library's F-16, whose gains are published and whose limits are not derived."""
        return self.airframe is None and self.type == "f16"

    @property
    def file(self) -> AirframeFile | DaveMlFile | None:
        """Contents of the aircraft file, from the key `airframe` or the library; None for F-16 and entry points."""
        if self.airframe is not None:
            return self.airframe
        return library_file(self.type) if self.type in LIBRARY_FILES else None

    @property
    def surfaces(self) -> tuple[str, ...] | None:
        """Names of the commanded surfaces; None for an entry point, whose airframe is unknown before it is built."""
        file = self.file
        return tuple(file.surfaces) if file is not None else PRIMARY_SURFACES if self.type == "f16" else None

    def consistency_problems(self) -> list[Problem]:
        """List an unknown or twice defined airframe, keys that only the F-16 has, and a start outside the data."""
        if self.type not in AIRFRAMES and self.type not in aircraft_types():
            return [Problem("type", describe_value(self.type), unknown_type_hint(self.type))]
        problems = self.airspeed_problems(required=False)
        expected_reason = "the library's F-16 alone has this key"
        if self.airframe is not None and self.type != "f16":
            problems.append(Problem("airframe", f'a file beside type = "{self.type}"', "one of the two, not both"))
        if not self.is_library_f16 and self.variant != "textbook":
            problems.append(Problem("variant", describe_value(self.variant), f"nothing: {expected_reason}"))
        if not self.is_library_f16 and self.x_cg_over_c is not None:
            problems.append(Problem("x_cg_over_c", format_number(self.x_cg_over_c), f"nothing: {expected_reason}"))
        return [*problems, *self._start_problems(), *self._deviation_problems()]

    def change_problems(self, deviation: Deviation) -> list[Problem]:
        """List keys of a deviation for a surface or an engine that the aircraft does not have."""
        file, problems = self.file, []
        if file is None:  # the F-16 has all; an airframe in code is checked when it is built
            return []
        for name in PRIMARY_SURFACES:
            factor = getattr(deviation.surface_effectiveness, name)
            if factor != 1.0 and name not in file.surfaces:
                expected = f"1: {file.name} has the surfaces {', '.join(file.surfaces)}"
                problems.append(Problem(f"deviation.surface_effectiveness.{name}", format_number(factor), expected))
        if not file.has_engine and deviation.thrust != 1.0:
            problems.append(
                Problem("deviation.thrust", format_number(deviation.thrust), f"1: {file.name} has no engine")
            )
        return problems

    def _start_problems(self) -> list[Problem]:
        problems, data_range = [], self.range
        for key, bounds, unit in (
            ("speed_m_s", data_range.airspeed_m_s, "m/s"),
            ("altitude_m", data_range.altitude_m, "m"),
        ):
            value = getattr(self.start, key)
            if bounds is not None and value is not None and not bounds[0] <= value <= bounds[1]:
                expected = (
                    f"from {format_number(bounds[0])} to {format_number(bounds[1])} {unit}, where the data of "
                    f"{data_range.name} hold"
                )
                problems.append(Problem(f"start.{key}", format_number(value), expected))
        return problems

    def _deviation_problems(self) -> list[Problem]:
        """List deviations of coefficients, surfaces or an engine that the airframe does not have."""
        file, factors = self.file, self.deviation.coefficients
        if file is None and self.type != "f16":
            if self.deviation == Deviation():
                return []
            expected = f"none: of {self.type}, an airframe in code, anser knows no coefficients to vary"
            return [Problem("deviation", "a table", expected)]
        names = F16_FACTORS if file is None else _factor_names(file)
        expected = f"a coefficient of {self.range.name}: {', '.join(names)}"
        unknown = [name for name in type(factors).model_fields if name not in names and getattr(factors, name) != 1.0]
        problems = [
            Problem(f"deviation.coefficients.{key}", format_number(getattr(factors, key)), expected) for key in unknown
        ]
        return [*problems, *self.change_problems(self.deviation)]


def _factor_names(file: AirframeFile | DaveMlFile) -> tuple[str, ...]:
    """Return the names of a file's derivatives or coefficients on which a deviation may set a factor."""
    if isinstance(file, DaveMlFile):
        return BODY_COEFFICIENTS
    derivatives = [name for name in DERIVATIVES if getattr(file.aerodynamics, name) != 0.0]
    tables = [
        f"{table_row.replaces}0" if len(table_row.replaces) == 2 else table_row.replaces for table_row in file.table
    ]
    surfaces = [
        f"{coefficient}_{surface.name}"
        for surface in file.surface
        if surface.name in PRIMARY_SURFACES
        for coefficient in ("CL", "CD", "CY", "Cl", "Cm", "Cn")
        if getattr(surface, coefficient) != 0.0
    ]
    return tuple(dict.fromkeys([*derivatives, *tables, *surfaces]))
