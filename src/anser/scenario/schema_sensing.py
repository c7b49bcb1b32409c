"""Scenario tables for sensors and estimators, and the goal's uncertainty that follows from them."""

import functools
import json
import math
from importlib.resources import files
from typing import Annotated, Any, Literal

from pydantic import Field

from anser.config.errors import Problem, format_number
from anser.config.tables import Table, expects, number
from anser.scenario.schema_settings import Timing

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
    """Return the presets of goal sensors by name: dictionaries with values for keys of `GoalSensor`, and a source."""
    return json.loads(files("anser.scenario").joinpath("data/goal_sensors.json").read_text(encoding="utf-8"))


class Navigation(Table):
    """Sensors of the aircraft's own motion: exact; or satellite navigation, inertial sensors, air data with errors.

    All errors are standard deviations. The defaults represent satellite navigation with 2 m per axis, an attitude and
    heading reference of tactical grade, and an air data computer (RTCA DO-229, DO-334, SAE AS8002).
    """

    sensors: Literal["exact", "satellite-inertial"] = Field(
        default="exact", description="exact, or with the errors below"
    )
    position_m: float = number("slow error of satellite navigation, per axis", 0, 1000, "m", 2.0)
    correlation_s: float = number("correlation time of the slow error (Gauss-Markov)", 0.1, 1e5, "s", 60.0)
    noise_m: float = number("white noise of each fix, per axis", 0, 1000, "m", 0.3)
    velocity_m_s: float = number("white noise of the measured velocity, per axis", 0, 50, "m/s", 0.05)
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
    wind_time_s: float = number("time constant that separates the mean wind from gusts", 0.1, 1000, "s", 20.0)
    gust_time_s: float = number("time constant of the measurement of lateral gusts", 0.01, 100, "s", 0.3)


_Seconds = Annotated[float, Field(ge=0, le=60)]


class GoalSensor(Table):
    """Sensor of the goal: exact, or a preset; numbers in the table replace the preset's numbers.

    Errors are standard deviations.
    """

    preset: Literal["exact", "camera", "ais", "ads-b", "weather-radar", "beacon"] = Field(
        default="exact", description="which sensor"
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
        description="least and greatest latency of a measurement, uniformly distributed",
        json_schema_extra=expects("a list of two numbers from 0 to 60 (s), the first not above the second"),
    )
    half_angle_deg: float | None = number("half angle of the field of view around straight ahead", 1, 180, "deg", None)
    range_max_m: float | None = number("greatest range", 1, 1e6, "m", None)
    dropout_probability: float = number("probability that a single measurement fails", 0, 1, "", 0.0)
    outage_share: float = number("fraction of the time in outages", 0, 0.99, "", 0.0)
    outage_mean_s: float = number("mean duration of an outage", 0.001, 3600, "s", 1.0)

    def consistency_problems(self) -> list[Problem]:
        """List keys that the sensor does not use, and a `latency_s` whose least value is above the greatest value."""
        problems = []
        kind = None if self.preset == "exact" else goal_sensor_presets()[self.preset]["kind"]
        for key in sorted(self.model_fields_set - {"preset"}):
            unused = (
                kind is None or (kind == "sight" and key in _REPORT_KEYS) or (kind == "report" and key in _SIGHT_KEYS)
            )
            if unused and getattr(self, key) != type(self).model_fields[key].default:
                expected = f'no {key}, which the sensor "{self.preset}" does not have'
                if kind is None:
                    expected = 'preset other than "exact", whose numbers it can replace: ' + ", ".join(PRESETS)
                problems.append(
                    Problem(key, f'{_value_text(getattr(self, key))} with preset "{self.preset}"', expected)
                )
        if self.latency_s is not None and self.latency_s[0] > self.latency_s[1]:
            arrived = f"[{format_number(self.latency_s[0])}, {format_number(self.latency_s[1])}]"
            problems.append(Problem("latency_s", arrived, "a list of two numbers (s), the first not above the second"))
        return problems

    def number(self, key: str, default: Any = None) -> Any:
        """Return the first value of a key that exists: in the table, in the preset, or `default`."""
        value = getattr(self, key, None)
        return goal_sensor_presets()[self.preset].get(key, default) if value is None else value


def _value_text(value: Any) -> str:
    return format_number(value) if isinstance(value, int | float) else str(list(value))


class Estimator(Table):
    """Filter that tracks the goal; unused if the goal sensor is exact."""

    filter: Literal["ekf", "ukf"] = Field(default="ekf", description="extended or unscented Kalman filter")
    motion: Literal["steady", "turning", "changing"] = Field(
        default="steady",
        description="assumed motion of goals: steady, in a coordinated turn, or changing between both (interacting "
        "multiple model)",
    )
    acceleration_m_s2: float = number(
        "assumed acceleration of the goal, root mean square over a second", 0, 50, "m/s^2", 0.02, exclusive_minimum=True
    )
    turn_rate_deg_s: float = number("assumed change of the goal's turn rate in a second", 0, 30, "deg/s", 0.5)
    sojourn_s: float = number("mean time between changes of a goal's kind of motion", 0.1, 1e5, "s", 60.0)
    briefed_position_m: float = number(
        "standard deviation of the goal's briefed start position, per axis",
        *(0, 100_000, "m", 200.0),
        exclusive_minimum=True,
    )
    briefed_velocity_m_s: float = number(
        "standard deviation of the goal's briefed velocity, per axis", 0, 100, "m/s", 2.0, exclusive_minimum=True
    )
    margin_sigma: float = number(
        "standard deviations of the goal's position that the stand-off adds to its minimum", 0, 10, "", 3.0
    )


_MEASUREMENTS = 2000  # greatest number of measurements in the recursion; the filter has settled by then


def goal_sigma_m(
    sensor: GoalSensor,
    estimator: Estimator,
    navigation: Navigation,
    timing: Timing,
    speed_m_s: float,
    distance_m: float,
) -> float:
    """Compute the standard deviation (m) of the goal's position at the arrival, as predicted when the plan freezes.

    The value is for one axis of a goal in steady motion; 0 for an exact sensor. The Kalman filter's variance recursion
    starts from the briefed uncertainty, and ends with a prediction over the freeze time. Measurement errors are taken
    at the range in the middle of the freeze time; the freeze time is flown at `speed_m_s` and ends at the range
    `distance_m`. Errors that no filter removes are added in quadrature: biases of range and direction, or, if the goal
    reports its position, the slow error of the aircraft's satellite navigation.
    """
    if sensor.preset == "exact":
        return 0.0
    range_m = distance_m + 0.5 * speed_m_s * timing.freeze_s
    if sensor.number("kind") == "report":
        # the report is compared with the position of the aircraft, which has the same slow error
        measurement_m = math.hypot(
            sensor.number("position_m"), navigation.position_m if navigation.sensors != "exact" else 0.0
        )
        floor_m = 0.0 if navigation.sensors == "exact" else navigation.position_m
    else:
        measurement_m = max(sensor.number("range_m"), 1e-3 * sensor.number("angle_mrad") * range_m)
        floor_m = math.hypot(sensor.range_bias_m, 1e-3 * sensor.angle_bias_mrad * range_m)
    availability = (1.0 - sensor.outage_share) * (1.0 - sensor.dropout_probability)
    period_s = sensor.number("period_s") / max(availability, 1e-6)
    density = estimator.acceleration_m_s2**2
    position_variance, covariance, speed_variance = (
        estimator.briefed_position_m**2,
        0.0,
        estimator.briefed_velocity_m_s**2,
    )
    count = min(_MEASUREMENTS, int(timing.duration_s / period_s))
    for _ in range(count):
        position_variance, covariance, speed_variance = _predict_variances(
            position_variance, covariance, speed_variance, density, period_s
        )
        innovation_variance = position_variance + measurement_m**2
        position_variance, covariance, speed_variance = (
            position_variance - position_variance**2 / innovation_variance,
            covariance - position_variance * covariance / innovation_variance,
            speed_variance - covariance**2 / innovation_variance,
        )
    position_variance, _, _ = _predict_variances(
        position_variance, covariance, speed_variance, density, timing.freeze_s
    )
    return math.hypot(math.sqrt(max(position_variance, 0.0)), floor_m)


def _predict_variances(
    position_variance: float, covariance: float, speed_variance: float, density: float, span_s: float
) -> tuple[float, float, float]:
    """Predict position variance (m^2), covariance (m^2/s) and speed variance (m^2/s^2) over `span_s` seconds.

    The acceleration is white noise of the spectral density `density`, m^2/s^3.
    """
    return (
        position_variance + 2.0 * span_s * covariance + span_s**2 * speed_variance + density * span_s**3 / 3.0,
        covariance + span_s * speed_variance + density * span_s**2 / 2.0,
        speed_variance + density * span_s,
    )
