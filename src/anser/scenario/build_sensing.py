"""Construction of sensors and estimators from the scenario's sensing tables."""

import math

import numpy as np

from anser.aircraft.airframe import AbstractAirframe
from anser.numerics.arrays import as_array
from anser.parts.perception import AbstractEstimator, AbstractSensors
from anser.planning.goals import GoalMotion
from anser.scenario.schema import Scenario
from anser.scenario.schema_sensing import Estimator, Navigation
from anser.scenario.schema_sensing import GoalSensor as GoalSensorTable
from anser.sensing.estimators import Briefing, TrackingEstimator
from anser.sensing.goal_filters import GoalFilter
from anser.sensing.goal_sensors import FieldOfView, NoisyGoalSensor, queue_slots
from anser.sensing.ideal_sensors import IdealSensors
from anser.sensing.motion_models import AbstractMotionModel, CoordinatedTurn, SteadyMotion
from anser.sensing.navigation import AirFilter, NavigationFilter
from anser.sensing.noisy_sensors import NoisySensors
from anser.sensing.vehicle_sensors import AirDataSensors, Dropouts, InertialSensors, SatelliteNavigation, VehicleSensors
from anser.shapes import Vector3
from anser.units import DEG_RAD

_VERTICAL_SHARE = 0.1  # vertical part of a goal's acceleration
_NIS_MAX = 10.0  # mean normalised innovation squared above which a filter has diverged; 1 is consistent
_SIGMA_MAX_M = 5000.0
_UNMEASURED = 1.0  # placeholder standard deviation of components that are not measured
_GRAVITY_M_S2 = 9.81


def build_sensors(scenario: Scenario) -> AbstractSensors:
    """Build an aircraft's sensors; ideal sensors if the tables [navigation] and [goal_sensor] are both "exact"."""
    vehicle_sensors, goal_sensor = build_vehicle_sensors(scenario.navigation), build_goal_sensor(scenario.goal_sensor)
    is_ideal = vehicle_sensors is None and goal_sensor is None
    return IdealSensors() if is_ideal else NoisySensors(vehicle_sensors, goal_sensor)


def build_estimator(scenario: Scenario, goal: GoalMotion, model: AbstractAirframe | None = None) -> AbstractEstimator:
    """Build the estimator of an aircraft whose goal has the motion `goal`, with filters for inexact sensors and gusts.

    If sensors are exact and the air is smooth, the estimator has no filter. `model` is the airframe that the estimator
    assumes; None: the airframe that flies.
    """
    navigation, sensor, estimator = scenario.navigation, scenario.goal_sensor, scenario.estimator
    has_exact_navigation = navigation.sensors == "exact"
    has_exact_air = has_exact_navigation and not scenario.is_gusty and not scenario.gust
    navigation_filter = None if has_exact_navigation else _navigation_filter(navigation, scenario.timing.step_s)
    air = None if has_exact_air else AirFilter(as_array(navigation.wind_time_s), as_array(navigation.gust_time_s))
    if sensor.preset == "exact":
        return TrackingEstimator(navigation_filter, air, model=model)
    tracking = GoalFilter(
        models=_motion_models(estimator),
        sojourn=as_array(estimator.sojourn_s),
        kind=estimator.filter,
        nis_max=as_array(_NIS_MAX),
        sigma_max=as_array(_SIGMA_MAX_M),
        slots=_motion_history_slots(sensor, scenario.timing.step_s),
    )
    briefing = Briefing(
        position_n=as_array(np.asarray(goal.position_n(0.0))),
        velocity_n=as_array(np.asarray(goal.velocity_n(0.0))),
        position_sigma=as_array(estimator.briefed_position_m),
        velocity_sigma=as_array(estimator.briefed_velocity_m_s),
    )
    return TrackingEstimator(navigation_filter, air, tracking, briefing, model)


def build_navigation_estimator(
    navigation: Navigation, model: AbstractAirframe, step_s: float = 0.01
) -> AbstractEstimator:
    """Build the estimator of an aircraft without a goal, with filters for the errors in the table [navigation].

    `step_s` is the sampling period of the flight, s.
    """
    air = AirFilter(as_array(navigation.wind_time_s), as_array(navigation.gust_time_s))
    return TrackingEstimator(_navigation_filter(navigation, step_s), air, model=model)


def _motion_models(table: Estimator) -> tuple[AbstractMotionModel, ...]:
    density = as_array(table.acceleration_m_s2**2)
    density_up = as_array((_VERTICAL_SHARE * table.acceleration_m_s2) ** 2)
    turn_density = as_array((DEG_RAD * table.turn_rate_deg_s) ** 2)
    turning = CoordinatedTurn(density, density_up, turn_density)
    if table.motion == "turning":
        return (turning,)
    if table.motion == "changing":
        return SteadyMotion(density, density_up, turn_density), turning
    return (SteadyMotion(density, density_up),)


def build_vehicle_sensors(table: Navigation) -> VehicleSensors | None:
    """Build the vehicle sensors with the errors of the table [navigation]; None if they are exact."""
    if table.sensors == "exact":
        return None
    return VehicleSensors(
        satellite=SatelliteNavigation(
            position_sigma=_three_axes(table.position_m),
            correlation_time=as_array(table.correlation_s),
            noise_sigma=_three_axes(table.noise_m),
            velocity_sigma=_three_axes(table.velocity_m_s),
            period=as_array(table.period_s),
        ),
        inertial=InertialSensors(
            attitude_sigma=as_array([DEG_RAD * a for a in (table.attitude_deg, table.attitude_deg, table.heading_deg)]),
            attitude_time=as_array(table.correlation_s),
            rates_bias=as_array(DEG_RAD * table.rates_bias_deg_s),
            rates_noise=as_array(DEG_RAD * table.rates_noise_deg_s),
            force_bias=as_array(table.force_bias_m_s2),
            force_noise=as_array(table.force_noise_m_s2),
        ),
        air_data=AirDataSensors(
            airspeed_bias=as_array(table.airspeed_bias_m_s),
            airspeed_noise=as_array(table.airspeed_noise_m_s),
            vane_bias=as_array(DEG_RAD * table.vane_bias_deg),
            vane_noise=as_array(DEG_RAD * table.vane_noise_deg),
        ),
    )


def _acceleration_density(table: Navigation, step_s: float) -> float:
    """Return the spectral density, m^2/s^3, of white noise that the filter assumes for errors of the acceleration."""
    # Accelerometer bias, and gravity resolved with attitude errors, are nearly constant, with the variance s^2. With
    # noise of density q, and velocities measured every T seconds with the variance r, the filter has the gain
    # K = (q / (r T))^(1/2) and computes the variance K r T. The actual mean square is K r T / 2 + s^2 / K^2. The
    # density makes both equal, close to the least mean square; the noise of the accelerometers is added.
    tilt = (DEG_RAD * max(table.attitude_deg, table.heading_deg) * _GRAVITY_M_S2) ** 2
    steady = (2.0 * (tilt + table.force_bias_m_s2**2)) ** (2 / 3) * (table.velocity_m_s**2 * table.period_s) ** (1 / 3)
    return steady + table.force_noise_m_s2**2 * step_s


def _navigation_filter(table: Navigation, step_s: float) -> NavigationFilter:
    return NavigationFilter(
        slow_sigma=_three_axes(table.position_m),
        slow_time=as_array(table.correlation_s),
        noise_sigma=_three_axes(table.noise_m),
        velocity_sigma=_three_axes(table.velocity_m_s),
        acceleration_density=as_array(max(_acceleration_density(table, step_s), 1e-12)),
        period=as_array(table.period_s),
    )


def build_goal_sensor(table: GoalSensorTable) -> NoisyGoalSensor | None:
    """Build the goal sensor from the table's numbers, completed by the preset; None if the sensor is exact."""
    if table.preset == "exact":
        return None
    number = table.number
    report = number("kind") == "report"
    if report:
        sigmas = [number("position_m")] * 3 + [number("velocity_m_s")] * 3
        measured, biases = [True] * 6, [0.0] * 6
    else:
        angle, rate = 1e-3 * number("angle_mrad"), number("angle_rate_mrad_s")
        rate = rate and 1e-3 * rate
        standard_deviations = number("range_m"), angle, angle, number("range_rate_m_s"), rate, rate
        measured = [deviation is not None for deviation in standard_deviations]
        sigmas = [_UNMEASURED if deviation is None else deviation for deviation in standard_deviations]
        bias = 1e-3 * table.angle_bias_mrad
        biases = [table.range_bias_m, bias, bias, 0.0, 0.0, 0.0]
    azimuth, elevation = (DEG_RAD * a for a in number("axis_deg", (0.0, 0.0)))
    level = math.cos(elevation)
    axis_b = [level * math.cos(azimuth), level * math.sin(azimuth), -math.sin(elevation)]
    latency = number("latency_s")
    return NoisyGoalSensor(
        sigmas=as_array(sigmas),
        range_share=as_array(0.0),
        bias_sigmas=as_array(biases),
        measures=as_array(measured, bool),
        period=as_array(number("period_s")),
        latency=as_array(latency),
        view=FieldOfView(
            as_array(axis_b), as_array(DEG_RAD * number("half_angle_deg", 180.0)), as_array(number("range_max_m"))
        ),
        dropouts=Dropouts(
            as_array(table.dropout_probability), as_array(table.outage_share), as_array(table.outage_mean_s)
        ),
        kind="report" if report else "sight",
        slots=queue_slots(latency[1], number("period_s")),
    )


def _motion_history_slots(table: GoalSensorTable, step_s: float) -> int:
    """Return the number (0 or a power of two) of past samples of the aircraft's motion that late measurements need."""
    # the oldest measurement is one sample older than the greatest latency
    latest_s = table.number("latency_s")[1]
    return 0 if latest_s <= 0.0 else 2 ** math.ceil(math.log2(latest_s / step_s + 2.0))


def _three_axes(value: float) -> Vector3:
    return as_array([value] * 3)
