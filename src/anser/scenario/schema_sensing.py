"""Tables of a scenario for sensors.

Their errors and the estimators, with the check of the stand-off under goal uncertainty.
"""

import functools
import json
import math
from collections.abc import Sequence
from importlib.resources import files
from typing import Annotated, Any, Literal

from pydantic import Field

from anser.config.errors import Problem, format_number
from anser.config.tables import Table, choice, expects, number
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_checks import label
from anser.scenario.schema_settings import Fleet, Timing, is_multiple, multiple_message

PRESETS = ("camera", "ais", "ads-b", "weather-radar", "beacon")
_SIGHT_KEYS = (
    "range_m",
    "angle_mrad",
    "range_rate_m_s",
    "angle_rate_mrad_s",
    "range_bias_m",
    "angle_bias_mrad",
    "half_angle_deg",
)
_REPORT_KEYS = ("position_m", "velocity_m_s")
_PERIOD_MAX_S = 600.0


@functools.cache
def goal_sensor_presets() -> dict[str, Any]:
    """Numbers of the sensors that can be named, and their sources."""
    return json.loads(files("anser.scenario").joinpath("data/goal_sensors.json").read_text(encoding="utf-8"))


class Navigation(Table):
    """How an aircraft knows itself: exactly, or by satellite navigation, inertial sensors and air data with errors.

    All are standard deviations. The defaults are those of satellite navigation with 2 m per axis, an attitude and
    heading reference of tactical grade, and an air data computer (RTCA DO-229, DO-334, SAE AS8002).
    """

    sensors: Literal["exact", "satellite-inertial"] = choice(
        "exact, or with the errors below", ("exact", "satellite-inertial"), "exact"
    )
    position_m: float = number("slow error of satellite navigation, per axis", 0, 1000, "m", 2.0)
    correlation_s: float = number("its correlation time (Gauss-Markov)", 0.1, 1e5, "s", 60.0)
    noise_m: float = number("what each fix has anew, per axis", 0, 1000, "m", 0.3)
    velocity_m_s: float = number("error of its velocity, per axis, anew at each fix", 0, 50, "m/s", 0.05)
    period_s: float = number("time between two fixes", 0.001, 60, "s", 0.1)
    attitude_deg: float = number("slow error of roll and pitch", 0, 10, "deg", 0.05)
    heading_deg: float = number("slow error of heading", 0, 10, "deg", 0.2)
    rates_bias_deg_s: float = number("bias of the gyros", 0, 5, "deg/s", 0.002)
    rates_noise_deg_s: float = number("noise of the gyros at each step", 0, 5, "deg/s", 0.03)
    force_bias_m_s2: float = number("bias of the accelerometers", 0, 5, "m/s^2", 0.01)
    force_noise_m_s2: float = number("noise of the accelerometers at each step", 0, 5, "m/s^2", 0.03)
    airspeed_bias_m_s: float = number("bias of the airspeed", 0, 20, "m/s", 0.5)
    airspeed_noise_m_s: float = number("noise of the airspeed at each step", 0, 20, "m/s", 0.3)
    vane_bias_deg: float = number("bias of angle of attack and sideslip", 0, 5, "deg", 0.1)
    vane_noise_deg: float = number("noise of angle of attack and sideslip at each step", 0, 5, "deg", 0.1)
    wind_time_s: float = number("time constant with which the mean wind is told from gusts", 0.1, 1000, "s", 20.0)
    gust_time_s: float = number("time constant with which gusts across the flight are measured", 0.01, 100, "s", 0.3)


_Seconds = Annotated[float, Field(ge=0, le=60)]


class GoalSensor(Table):
    """How an aircraft sees its goal: exactly, or as a sensor of a known kind does; numbers given replace its own.

    Errors are standard deviations.
    """

    preset: Literal["exact", "camera", "ais", "ads-b", "weather-radar", "beacon"] = choice(
        "which sensor", ("exact", *PRESETS), "exact"
    )
    range_m: float | None = number("error of the range", 0, 10_000, "m", None)
    angle_mrad: float | None = number("error of the direction, across the line of sight", 0, 500, "mrad", None)
    range_rate_m_s: float | None = number("error of the range rate; left out: not measured", 0, 100, "m/s", None)
    angle_rate_mrad_s: float | None = number(
        "error of the direction's rate; left out: not measured", 0, 500, "mrad/s", None
    )
    position_m: float | None = number("error of the reported position, per axis", 0, 10_000, "m", None)
    velocity_m_s: float | None = number("error of the reported velocity, per axis", 0, 100, "m/s", None)
    range_bias_m: float = number("bias of the range, drawn once in a flight", 0, 10_000, "m", 0.0)
    angle_bias_mrad: float = number("bias of the direction, drawn once in a flight", 0, 500, "mrad", 0.0)
    period_s: float | None = number("time between two measurements", 0.001, _PERIOD_MAX_S, "s", None)
    latency_s: tuple[_Seconds, _Seconds] | None = Field(
        default=None,
        strict=False,
        description="least and greatest time until a measurement is there, drawn evenly",
        json_schema_extra=expects("a list of two numbers from 0 to 60 (s), the first not above the second"),
    )
    half_angle_deg: float | None = number(
        "field of view, from its middle, straight ahead, to its edge", 1, 180, "deg", None
    )
    range_max_m: float | None = number("greatest range", 1, 1e6, "m", None)
    dropout_probability: float = number("with which a measurement fails by itself", 0, 1, "", 0.0)
    outage_share: float = number("part of the time that is spent in outages", 0, 0.99, "", 0.0)
    outage_mean_s: float = number("mean duration of an outage", 0.001, 3600, "s", 1.0)

    def consistency_problems(self) -> list[Problem]:
        """Find numbers that the sensor has no use for, and latencies out of order."""
        found = []
        kind = None if self.preset == "exact" else goal_sensor_presets()[self.preset]["kind"]
        for key in sorted(self.model_fields_set - {"preset"}):
            unused = (
                kind is None or (kind == "sight" and key in _REPORT_KEYS) or (kind == "report" and key in _SIGHT_KEYS)
            )
            if unused and getattr(self, key) != type(self).model_fields[key].default:
                words = f'no {key}, which the sensor "{self.preset}" does not have'
                if kind is None:
                    words = 'preset other than "exact", whose numbers it can replace: ' + ", ".join(PRESETS)
                found.append(Problem(key, f'{_shown(getattr(self, key))} with preset "{self.preset}"', words))
        if self.latency_s is not None and self.latency_s[0] > self.latency_s[1]:
            words = "a list of two numbers (s), the first not above the second"
            found.append(
                Problem("latency_s", f"[{format_number(self.latency_s[0])}, {format_number(self.latency_s[1])}]", words)
            )
        return found

    def number(self, key: str, otherwise: Any = None) -> Any:
        """A number of the sensor: the scenario's, else that of its preset."""
        own = getattr(self, key, None)
        return goal_sensor_presets()[self.preset].get(key, otherwise) if own is None else own


def _shown(value: Any) -> str:
    return format_number(value) if isinstance(value, int | float) else str(list(value))


class Estimator(Table):
    """The filter that follows a goal; it has no part where the goal's sensor is exact."""

    filter: Literal["ekf", "ukf"] = choice("extended or unscented Kalman filter", ("ekf", "ukf"), "ekf")
    motion: Literal["steady", "turning", "changing"] = choice(
        "how goals are taken to move: steadily, in a coordinated turn, or changing between both (interacting multiple "
        "model)",
        ("steady", "turning", "changing"),
        "steady",
    )
    acceleration_m_s2: float = number(
        "of the goal that the filter allows for, root mean square over a second",
        0,
        50,
        "m/s^2",
        0.02,
        exclusive_minimum=True,
    )
    turn_rate_deg_s: float = number(
        "change of the goal's turn rate that it allows for in a second", 0, 30, "deg/s", 0.5
    )
    sojourn_s: float = number("mean time for which a goal keeps its kind of motion", 0.1, 1e5, "s", 60.0)
    briefed_position_m: float = number(
        "how well the goal's first place is known beforehand, standard deviation per axis",
        0,
        100_000,
        "m",
        200.0,
        exclusive_minimum=True,
    )
    briefed_velocity_m_s: float = number("the same of its velocity", 0, 100, "m/s", 2.0, exclusive_minimum=True)
    margin_sigma: float = number(
        "how many standard deviations of the goal's place the stand-off keeps beyond its least distance", 0, 10, "", 3.0
    )


def sensing_problems(navigation: Navigation, sensor: GoalSensor, timing: Timing) -> list[Problem]:
    """Find periods that are no whole number of steps."""
    found = []
    key, step_s = "timing.step_s", timing.step_s
    if navigation.sensors != "exact" and not is_multiple(navigation.period_s, timing.step_s):
        period_s = navigation.period_s
        found.append(Problem("navigation.period_s", format_number(period_s), multiple_message(period_s, key, step_s)))
    if sensor.preset != "exact" and not is_multiple(sensor.number("period_s"), timing.step_s):
        period_s = sensor.number("period_s")
        found.append(Problem("goal_sensor.period_s", format_number(period_s), multiple_message(period_s, key, step_s)))
    return found


_MEASUREMENTS = 2000  # after which the filter is taken to be settled, at most


def goal_sigma_m(
    sensor: GoalSensor, estimator: Estimator, navigation: Navigation, timing: Timing, fleet: Fleet, distance_m: float
) -> float:
    """Standard deviation with which a goal's place at the arrival is known when the plan comes to stand still, m.

    That of the steadily moving goal in one axis, by the recursion of the Kalman filter from what is known beforehand,
    predicted over the freeze; measurements are as good as on the way through it. A goal's own report is compared with
    the own position, so that the error of satellite navigation adds to it.
    """
    if sensor.preset == "exact":
        return 0.0
    range_m = distance_m + 0.5 * fleet.speed_m_s * timing.freeze_s
    if sensor.number("kind") == "report":
        one_m = math.hypot(sensor.number("position_m"), navigation.position_m if navigation.sensors != "exact" else 0.0)
        floor_m = 0.0 if navigation.sensors == "exact" else navigation.position_m
    else:
        one_m = max(sensor.number("range_m"), 1e-3 * sensor.number("angle_mrad") * range_m)
        floor_m = math.hypot(sensor.range_bias_m, 1e-3 * sensor.angle_bias_mrad * range_m)
    working = (1.0 - sensor.outage_share) * (1.0 - sensor.dropout_probability)
    period_s = sensor.number("period_s") / max(working, 1e-6)
    density = estimator.acceleration_m_s2**2
    place, both, speed = estimator.briefed_position_m**2, 0.0, estimator.briefed_velocity_m_s**2
    count = min(_MEASUREMENTS, int(timing.duration_s / period_s))
    for _ in range(count):
        place, both, speed = _predicted(place, both, speed, density, period_s)
        spread = place + one_m**2
        place, both, speed = place - place**2 / spread, both - place * both / spread, speed - both**2 / spread
    place, _, _ = _predicted(place, both, speed, density, timing.freeze_s)
    return math.hypot(math.sqrt(max(place, 0.0)), floor_m)


def _predicted(place: float, both: float, speed: float, density: float, span_s: float) -> tuple[float, float, float]:
    """Variances of place and speed and their covariance a time later, with white noise of acceleration."""
    return (
        place + 2.0 * span_s * both + span_s**2 * speed + density * span_s**3 / 3.0,
        both + span_s * speed + density * span_s**2 / 2.0,
        speed + density * span_s,
    )


def margin_problems(
    aircraft: Sequence[Aircraft],
    goals: Sequence[Goal],
    sensor: GoalSensor,
    estimator: Estimator,
    navigation: Navigation,
    timing: Timing,
    fleet: Fleet,
) -> list[Problem]:
    """Find rendezvous points that an uncertain goal may come nearer to than is allowed; all goals exist."""
    kinds = {goal.name: goal.kind for goal in goals}
    found = []
    for index, one in enumerate(aircraft):
        least_m = AIRBORNE_STAND_OFF_MIN_M if kinds[one.goal] == "airborne" else SURFACE_STAND_OFF_MIN_M
        distance_m = one.rendezvous.stand_off_distance_m
        sigma_m = goal_sigma_m(sensor, estimator, navigation, timing, fleet, distance_m)
        needed_m = least_m + estimator.margin_sigma * sigma_m
        # nearer than the scope allows is told by itself
        if sigma_m > 0.0 and least_m <= distance_m < needed_m:
            words = (
                f"a stand-off of {math.ceil(needed_m)} m or more: the {format_number(least_m)} m of the scope and "
                f"estimator.margin_sigma = {format_number(estimator.margin_sigma)} standard "
                "deviations of the goal's place at "
                f"the arrival, which the sensor leaves at {sigma_m:.1f} m"
            )
            found.append(Problem(f"aircraft[{index}].rendezvous", f"{distance_m:.1f} m", words, label("aircraft", one)))
    return found
