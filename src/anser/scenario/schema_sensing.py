"""The tables of a scenario for what the aircraft know: sensors, their errors, and the filters behind them."""

import functools
import json
from importlib.resources import files
from typing import Annotated, Any, Literal

from pydantic import Field

from anser.scenario.errors import Problem, plain
from anser.scenario.schema_base import Table, choice, expects, number
from anser.scenario.schema_settings import Timing, is_multiple, multiple_words

PRESETS = ("camera", "ais", "ads-b", "weather-radar", "beacon")
_OF_SIGHT = (
    "range_m",
    "angle_mrad",
    "range_rate_m_s",
    "angle_rate_mrad_s",
    "range_bias_m",
    "angle_bias_mrad",
    "half_angle_deg",
)
_OF_REPORT = ("position_m", "velocity_m_s")
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

    def own_problems(self) -> list[Problem]:
        """Find numbers that the sensor has no use for, and latencies out of order."""
        found = []
        kind = None if self.preset == "exact" else goal_sensor_presets()[self.preset]["kind"]
        for key in sorted(self.model_fields_set - {"preset"}):
            unused = kind is None or (kind == "sight" and key in _OF_REPORT) or (kind == "report" and key in _OF_SIGHT)
            if unused and getattr(self, key) != type(self).model_fields[key].default:
                words = f'no {key}, which the sensor "{self.preset}" does not have'
                if kind is None:
                    words = 'preset other than "exact", whose numbers it can replace: ' + ", ".join(PRESETS)
                found.append(Problem(key, f'{_shown(getattr(self, key))} with preset "{self.preset}"', words))
        if self.latency_s is not None and self.latency_s[0] > self.latency_s[1]:
            words = "a list of two numbers (s), the first not above the second"
            found.append(Problem("latency_s", f"[{plain(self.latency_s[0])}, {plain(self.latency_s[1])}]", words))
        return found

    def number(self, key: str, otherwise: Any = None) -> Any:
        """A number of the sensor: the scenario's, else that of its preset."""
        own = getattr(self, key, None)
        return goal_sensor_presets()[self.preset].get(key, otherwise) if own is None else own


def _shown(value: Any) -> str:
    return plain(value) if isinstance(value, int | float) else str(list(value))


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
        "of the goal that the filter allows for, root mean square over a second", 0, 50, "m/s^2", 0.02, above=True
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
        above=True,
    )
    briefed_velocity_m_s: float = number("the same of its velocity", 0, 100, "m/s", 2.0, above=True)
    margin_sigma: float = number(
        "how many standard deviations of the goal's place the stand-off keeps beyond its least distance", 0, 10, "", 3.0
    )


def sensing_problems(navigation: Navigation, sensor: GoalSensor, timing: Timing) -> list[Problem]:
    """Find periods that are no whole number of steps."""
    found = []
    key, step_s = "timing.step_s", timing.step_s
    if navigation.sensors != "exact" and not is_multiple(navigation.period_s, timing.step_s):
        period_s = navigation.period_s
        found.append(Problem("navigation.period_s", plain(period_s), multiple_words(period_s, key, step_s)))
    if sensor.preset != "exact" and not is_multiple(sensor.number("period_s"), timing.step_s):
        period_s = sensor.number("period_s")
        found.append(Problem("goal_sensor.period_s", plain(period_s), multiple_words(period_s, key, step_s)))
    return found
