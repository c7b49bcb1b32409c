"""Scenario tables for the whole flight: time, fleet, limits, guidance, hold, requirements, network."""

import math
from typing import Any, Literal, Self

from pydantic import Field, PrivateAttr

from anser.aircraft_files.sources import ALTITUDE_MAX_M, SPEED_MAX_M_S, AirframeRange
from anser.config.errors import Problem, format_number
from anser.config.tables import Table, expects, number, ordering_problems
from anser.constants import STEP_MAX_S, STEP_MIN_S
from anser.environment.air import AIRSPEED_FORMS, AirspeedForm, Layers, air_in_layers, true_airspeed

DURATION_MAX_S = 7200.0


def is_multiple(period_s: float, step_s: float) -> bool:
    """Whether a period is a whole number of steps, at least one, within the rounding of decimal input."""
    steps = period_s / step_s
    return round(steps) >= 1 and math.isclose(steps, round(steps), rel_tol=1e-9)


def multiple_message(period_s: float, key: str, step_s: float) -> str:
    """Return the text after "expected" for a time that is no multiple of a step; `key` is the key of the step."""
    below = math.floor(period_s / step_s)
    nearest = " or ".join(format_number(round(steps * step_s, 9)) for steps in (below, below + 1) if steps >= 1)
    return f"a whole multiple of {key}, which is {format_number(step_s)} s, such as {nearest}"


_MACH_MAX = 1.2
_FORMS_EXPECTED = f"one of {', '.join(AIRSPEED_FORMS)}"


class AirspeedTable(Table):
    """Table with an airspeed in one of four forms: true, calibrated or equivalent airspeed, or Mach number.

    The scenario adds the true airspeed, whose computation needs the scenario's atmosphere.
    """

    _airspeed_m_s: float | None = PrivateAttr(None)

    @property
    def airspeed_forms(self) -> tuple[AirspeedForm, ...]:
        """Keys of the airspeeds that the table has; a valid table has at most one."""
        return tuple(form for form in AIRSPEED_FORMS if getattr(self, form) is not None)

    @property
    def airspeed_m_s(self) -> float:
        """True airspeed, m/s.

        Raises ValueError if the table has no airspeed, or if its airspeed is not a true airspeed and the table is not
        part of a scenario.
        """
        if self._airspeed_m_s is None:
            value = getattr(self, "speed_m_s", None)
            if value is None:
                raise ValueError("airspeed_m_s: arrived a table without a true airspeed; expected one of a scenario")
            return value
        return self._airspeed_m_s

    @property
    def airspeed_key(self) -> str:
        """Key of the airspeed that the table has, for messages; "speed_m_s" if the table has no airspeed."""
        return (*self.airspeed_forms, "speed_m_s")[0]

    @property
    def airspeed_text(self) -> str:
        """Airspeed for messages: the value in the table; if it is not a true airspeed, also the true airspeed, m/s."""
        value = format_number(getattr(self, self.airspeed_key))
        return value if self.airspeed_key == "speed_m_s" else f"{value} (true airspeed {self.airspeed_m_s:.1f} m/s)"

    def airspeed_name(self, table: str) -> str:
        """Return the true airspeed's name in messages, such as "fleet.mach (true airspeed)"; `table` is a key path."""
        name = f"{table}.{self.airspeed_key}"
        return name if self.airspeed_key == "speed_m_s" else f"{name} (true airspeed)"

    def with_airspeed(self, layers: Layers, altitude_m: float) -> Self:
        """Return the table with its airspeed as true airspeed in the air `layers` at a geometric altitude (m).

        A table without an airspeed, or with a true airspeed, is returned unchanged.
        """
        if self.airspeed_forms in ((), ("speed_m_s",)):
            return self
        form = self.airspeed_forms[0]
        table = self._with_values()
        table._airspeed_m_s = float(true_airspeed(form, getattr(self, form), air_in_layers(layers, altitude_m)))
        return table

    def airspeed_problems(self, *, required: bool) -> list[Problem]:
        """Return a problem if the table has more than one airspeed, or if an airspeed is `required` and missing."""
        forms = self.airspeed_forms
        if len(forms) > 1:
            values = " and ".join(f"{form} = {format_number(getattr(self, form))}" for form in forms)
            return [Problem(forms[1], values, _FORMS_EXPECTED)]
        if not forms and required:
            return [Problem("speed_m_s", "nothing", f"an airspeed: {_FORMS_EXPECTED}")]
        return []


def true_airspeed_key(description: str) -> Any:
    """Declare the optional key `speed_m_s` (true airspeed, m/s) of an `AirspeedTable`."""
    return number(description, 1, SPEED_MAX_M_S, "m/s", None)


CALIBRATED_AIRSPEED = number("the same as a calibrated airspeed", 1, SPEED_MAX_M_S, "m/s", None, omit_default=True)
EQUIVALENT_AIRSPEED = number("the same as an equivalent airspeed", 1, SPEED_MAX_M_S, "m/s", None, omit_default=True)
MACH = number("the same as a Mach number", 0.005, _MACH_MAX, "", None, omit_default=True)


class Timing(Table):
    """Duration of the flight, and the periods of integration, recording and planning."""

    duration_s: float = number("duration of the flight", 1, DURATION_MAX_S, "s")
    step_s: float = number("step of the integration", STEP_MIN_S, STEP_MAX_S, "s", 0.01)
    record_period_s: float = number("time between two recorded states", 0.001, 60, "s", 0.1)
    replan_period_s: float = number("time between two plans; 0 plans once, at the start", 0, 600, "s", 1.0)
    freeze_s: float = number("time before arrival during which the plan is frozen", 0, 600, "s", 4.0)

    @property
    def latest_arrival_s(self) -> float:
        """Latest arrival time of a certified plan, s: one second before the end of the flight."""
        return self.duration_s - 1.0

    def consistency_problems(self) -> list[Problem]:
        """List a duration or period that is no whole number of steps, and a freeze time not below the duration."""
        problems = []
        for key in ("duration_s", "record_period_s", "replan_period_s"):
            period_s = getattr(self, key)
            allowed_zero = key == "replan_period_s" and period_s == 0
            if not allowed_zero and not is_multiple(period_s, self.step_s):
                arrived = format_number(period_s)
                arrived = arrived if key in self.model_fields_set else f"the default {arrived}"
                problems.append(Problem(key, arrived, multiple_message(period_s, "step_s", self.step_s)))
        return [*problems, *ordering_problems(self, "freeze_s", "duration_s", "s")]


class Fleet(AirspeedTable):
    """Settings common to the whole fleet."""

    speed_m_s: float | None = true_airspeed_key(
        "mean true airspeed of the plan, equal for all aircraft; higher if the farthest cannot descend so slowly "
        "(certified: preferred airspeed); or one of the three keys below"
    )
    speed_cas_m_s: float | None = CALIBRATED_AIRSPEED
    speed_eas_m_s: float | None = EQUIVALENT_AIRSPEED
    mach: float | None = MACH
    speed_profile: Literal["even", "published"] = Field(
        default="even", description="airspeed along a path: even, or by the published polynomials in time"
    )
    planner: Literal["published", "certified", "decentralised"] = Field(
        default="certified",
        description="planner: the published method, paths with proven limits and separation, or such paths planned by "
        "each aircraft without a centre",
    )
    reserve: float = number(
        "fraction of each limit reserved for the autopilot; of the airspeed window on each side of speed_m_s",
        *(0, 0.5, "", 0.1),
    )

    def consistency_problems(self) -> list[Problem]:
        """Return a problem if the fleet has no airspeed or more than one."""
        return self.airspeed_problems(required=True)

    @property
    def is_certified(self) -> bool:
        """Whether the planner proves the limits and the separation of its paths (certified or decentralised)."""
        return self.planner != "published"

    @property
    def is_central(self) -> bool:
        """Whether one planner plans for the whole fleet (published or certified)."""
        return self.planner != "decentralised"


class Limits(Table):
    """Flight envelope for plans and autopilot.

    The defaults are the F-16's. For other aircraft, the limits that the file leaves out follow from the aircraft:
    airspeeds, bank and climb rate from its performance and data. Angles of attack keep to the data of every aircraft.
    """

    speed_min_m_s: float = number("minimum airspeed", 1, SPEED_MAX_M_S, "m/s", 90.0)
    speed_max_m_s: float = number("maximum airspeed", 1, SPEED_MAX_M_S, "m/s", 240.0)
    bank_max_deg: float = number("largest bank angle", 5, 85, "deg", 60.0)
    climb_rate_max_m_s: float = number("largest rate of climb or descent", 1, 300, "m/s", 80.0)
    altitude_min_m: float = number("lowest altitude", 0, ALTITUDE_MAX_M, "m", 100.0)
    altitude_max_m: float = number("highest altitude", 0, ALTITUDE_MAX_M, "m", ALTITUDE_MAX_M)
    load_factor_min: float = number("lowest load factor", -3, 0.9, "", -1.0)
    load_factor_max: float = number("highest load factor", 1.1, 9, "", 5.0)
    alpha_min_deg: float = number("lowest angle of attack", -10, 45, "deg", -5.0)
    alpha_max_deg: float = number("highest angle of attack", -10, 45, "deg", 25.0)
    roll_rate_max_deg_s: float | None = number(
        "greatest rate of the bank angle, in a plan and in the autopilot's commands, which the aircraft passes by up "
        "to a third while it catches up; left out: plans roll at 20 deg/s on the mean, the autopilot as fast as it can",
        *(1, 90, "deg/s", None),
    )
    acceleration_max_m_s2: float | None = number(
        "greatest surplus of thrust over drag, per mass, that a plan asks for; left out: that of its start",
        *(0, 50, "m/s^2", None),
        exclusive_minimum=True,
    )
    deceleration_max_m_s2: float | None = number(
        "greatest surplus of drag over thrust, per mass, that a plan asks for; left out: its own at each airspeed",
        *(0, 50, "m/s^2", None),
        exclusive_minimum=True,
    )

    def consistency_problems(self) -> list[Problem]:
        """Return a problem if the minimum altitude is not below the maximum altitude."""
        return ordering_problems(self, "altitude_min_m", "altitude_max_m", "m")

    def within(self, data_range: AirframeRange) -> Self:
        """Return the limits of an aircraft whose data have the ranges `data_range`.

        If the scenario omits limits of airspeed, the range of the aircraft file replaces them. If the scenario omits
        limits of the angle of attack, the defaults are reduced to the range of the data.
        """
        speeds, alphas = data_range.airspeed_m_s, data_range.alpha_deg
        values: dict[str, float] = {}
        if data_range.is_from_file and speeds is not None:
            values = {"speed_min_m_s": speeds[0], "speed_max_m_s": speeds[1]}
        if alphas is not None:
            values["alpha_min_deg"] = max(alphas[0], self.alpha_min_deg)
            values["alpha_max_deg"] = min(alphas[1], self.alpha_max_deg)
        return self.with_defaults(**values)


class Guidance(Table):
    """Settings of the path following, with which an aircraft keeps to its plan."""

    position_gain_per_s: float = number(
        "correction of the commanded velocity per metre of error; 0 = velocity commands alone", 0, 5, "1/s", 0.3
    )


class Hold(Table):
    """The circle flown by every aircraft after the arrival."""

    radius_m: float = number("radius of the circle", 20, 100_000, "m", 4000.0)
    direction: Literal["right", "left"] = Field(default="right", description="sense of the turn")


class Requirements(Table):
    """Requirements that a flight must meet to pass.

    The airspeed up to the arrival, without gusts, must be within `[limits]` too: within the values of the file, or, if
    the file leaves the values out, within the range of the aircraft's data (F-16: the defaults). The tighter limits
    that follow from an aircraft's performance are for plans and autopilot alone.
    """

    miss_max_m: float = number(
        "largest distance from the rendezvous point at arrival", 0, 10_000, "m", 3.0, exclusive_minimum=True
    )
    arrival_spread_max_s: float = number(
        "largest time between the first arrival and the last", 0, 3600, "s", 0.05, exclusive_minimum=True
    )
    position_error_max_m: float | None = number(
        "largest distance from the planned point up to the arrival; left out: any",
        *(0, 10_000, "m", None),
        exclusive_minimum=True,
    )
    separation_min_m: float | None = number(
        "least distance between two aircraft; left out: any", 0, 10_000, "m", None, exclusive_minimum=True
    )


class Network(Table):
    """Communication in a fleet without a central planner (fleet.planner = "decentralised"), and coupling of clocks.

    An aircraft runs through its planned path by its own clock; messages make the clocks converge.
    """

    range_m: float = number(
        "greatest distance over which two aircraft hear each other", 0, 1e7, "m", 50_000.0, exclusive_minimum=True
    )
    period_s: float = number("time between two broadcasts of an aircraft", 0, 10, "s", 0.1, exclusive_minimum=True)
    delay_s: float = number("delay of a message", 0, 10, "s", 0.0)
    loss: float = number("fraction of the messages between two aircraft that are lost, independently", 0, 1, "", 0.0)
    outage_share: float = number("fraction of the time in which a link is out", 0, 0.99, "", 0.0)
    outage_mean_s: float = number("mean duration of a link outage", 0, 600, "s", 5.0, exclusive_minimum=True)
    agree_within_s: float = number("time before the start for agreement on the first plan", 1, 600, "s", 60.0)
    coupling_per_s: float = number(
        "rate of convergence of the clocks if all aircraft hear each other", 0, 2, "1/s", 0.2, exclusive_minimum=True
    )
    damping_per_s: float = number("rate at which a clock rate returns to 1", 0, 10, "1/s", 1.0, exclusive_minimum=True)
    waiting_per_s2: float = number("slowdown of a clock for each second behind the path", 0, 1, "1/s^2", 0.1)
    rate_range: float = number("greatest deviation of a clock rate from 1", 0, 0.1, "", 0.03, exclusive_minimum=True)
    skew_max_s: float = number(
        "greatest difference of two clocks, allowed for in the separation", 0, 5, "s", 0.5, exclusive_minimum=True
    )
    tube_m: float = number(
        "greatest deviation of an aircraft from its last broadcast path", 0, 1_000, "m", 25.0, exclusive_minimum=True
    )
    window_s: float = number(
        "time window for the network's quality of service", 0, 600, "s", 5.0, exclusive_minimum=True
    )

    def consistency_problems(self) -> list[Problem]:
        """Return a problem if the coupling of the clocks is above a quarter of the damping: they would oscillate."""
        greatest = 0.25 * self.damping_per_s
        if self.coupling_per_s <= greatest:
            return []
        expected = f"at most {format_number(greatest)} 1/s, a quarter of damping_per_s: beyond that the clocks swing"
        return [Problem("coupling_per_s", format_number(self.coupling_per_s), expected)]


def rate_range_problems(rate_range: float, reserve: float, greatest: float) -> list[Problem]:
    """Refuse a `rate_range` above the `greatest` one that the reserve of the plan allows (`fleet.reserve`)."""
    if rate_range <= greatest or greatest < 0.0:  # below 0: an airspeed beyond its limits, which is refused itself
        return []
    expected = (
        f"at most {format_number(math.floor(1e4 * greatest) / 1e4)}: what fleet.reserve = {format_number(reserve)} "
        "leaves of the limits, for a path that is flown faster or more slowly"
    )
    return [Problem("network.rate_range", format_number(rate_range), expected)]


def greatest_rate_range(reserve: float, speed: float, limits: Limits, wind_m_s: float) -> float:
    """Return the greatest deviation of a clock rate from 1 for which a plan with a reserve keeps an aircraft's limits.

    The clock rate is the rate at which an aircraft runs through its planned path. `reserve` is `fleet.reserve`, `speed`
    is the preferred airspeed (m/s), and `wind_m_s` is the greatest wind speed (m/s).
    """
    # Velocities over the ground scale with the clock rate, accelerations with its square. The tangent of the bank angle
    # grows at least in proportion to the angle.
    turning = math.sqrt(1.0 / (1.0 - reserve)) - 1.0
    slow = limits.speed_min_m_s + reserve * (speed - limits.speed_min_m_s)
    fast = limits.speed_max_m_s - reserve * (limits.speed_max_m_s - speed)
    slower = (slow - limits.speed_min_m_s) / (slow + wind_m_s)
    faster = (limits.speed_max_m_s - fast) / (fast + wind_m_s)
    return min(turning, slower, faster, reserve)


_PART_NAME = r"^[A-Za-z_][A-Za-z0-9_.]*:[A-Za-z_][A-Za-z0-9_.]*$"


def _part(description: str) -> Any:
    expected = 'the name of a class without arguments, or of an object: "my_package:MyController"'
    return Field(None, pattern=_PART_NAME, description=description, json_schema_extra=expects(expected))


class Parts(Table):
    """User-defined parts of the closed loop, imported by name when the flight is built."""

    controller: str | None = _part("controller of every aircraft, in place of the autopilot")
    guidance: str | None = _part("guidance of every aircraft, in place of path following")
    sensors: str | None = _part("sensors of every aircraft")
    estimator: str | None = _part("estimator of every aircraft")
    planner: str | None = _part("planner of the fleet, in place of fleet.planner")
