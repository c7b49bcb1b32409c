"""Sensors with errors: magnitudes, correlation times, delays and dropouts as specified."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AircraftState, air_data_and_forces
from anser.aircraft.actuators import Deflections
from anser.aircraft.engines import EnginePower
from anser.aircraft.motion import Disturbance
from anser.environment import standard_environment
from anser.environment.gusts import Gust
from anser.numerics import flight_randomness
from anser.parts import GoalState, Instant, Truth
from anser.parts.perception import Fix
from anser.scenario.build_sensing import (
    _motion_history_slots,
    _navigation_filter,
    build_goal_sensor,
    build_vehicle_sensors,
)
from anser.scenario.schema_sensing import GoalSensor, Navigation
from anser.sensing import IdealSensors, TrackingEstimator
from anser.sensing.navigation import AirFilter, NavigationFilter
from anser.sensing.vehicle_sensors import Dropouts, gauss_markov
from support.light_aircraft import light_aircraft

ENVIRONMENT = standard_environment()
STEP = 0.1
AIRFRAME = light_aircraft()


def truth_at(k, works=True, goal_position=(3000.0, 500.0, 0.0)):
    state = AircraftState(
        position_n=jnp.stack([100.0 * STEP * k, jnp.zeros_like(1.0 * k), jnp.asarray(-1000.0)]),
        velocity_b=jnp.array([100.0, 0.0, 0.0]),
        quaternion=jnp.array([1.0, 0.0, 0.0, 0.0]),
        rates_b=jnp.zeros(3),
        actuators=Deflections(jnp.zeros(3)),
        engine=EnginePower(jnp.asarray(20.0)),
    )
    goal = GoalState(jnp.array(goal_position), jnp.array([5.0, 0.0, 0.0]))
    return Truth(AIRFRAME, state, air_data_and_forces(AIRFRAME, ENVIRONMENT, 0.0, state), goal, jnp.asarray(works))


def instant_at(k, aircraft=0):
    source = flight_randomness(3).for_aircraft(jnp.asarray(aircraft))
    return Instant(ENVIRONMENT, jnp.asarray(k, dtype=jnp.int32), jnp.asarray(STEP), source)


@functools.partial(jax.jit, static_argnames="count")
def readings(sensor, count, aircraft=0, works=True, goal_position=(3000.0, 500.0, 0.0)):
    def one(memory, k):
        reading, memory = sensor.read(memory, truth_at(k, works, goal_position), instant_at(k, aircraft))
        return memory, reading

    initial_state = sensor.init(truth_at(jnp.asarray(0), works, goal_position), instant_at(0, aircraft))
    return jax.lax.scan(one, initial_state, jnp.arange(count, dtype=jnp.int32))[1]


@pytest.mark.parametrize(("sigma", "time"), [(2.0, 60.0), (0.3, 0.5)])
def test_gauss_markov_errors_are_stationary_with_their_correlation_time(sigma, time):
    normals = jnp.asarray(np.random.default_rng(0).normal(size=(2001, 200)))

    def step(error, normal):
        next_error = gauss_markov(error, sigma, time, 0.1, normal)
        return next_error, next_error

    errors = np.asarray(jax.lax.scan(step, sigma * normals[0], normals[1:])[1])
    np.testing.assert_allclose(errors.std(axis=1).mean(), sigma, rtol=0.05)
    lag = max(1, round(time / 0.1))
    if lag < 1000:
        correlation = np.mean(errors[lag:] * errors[:-lag]) / sigma**2
        np.testing.assert_allclose(correlation, np.exp(-1.0), atol=0.08)


def test_outages_come_in_bursts_of_the_mean_duration():
    drop = Dropouts(jnp.asarray(0.1), jnp.asarray(0.05), jnp.asarray(1.0))
    numbers = jnp.asarray(np.random.default_rng(1).random((40_000, 50, 2)))

    def step(outage, uniforms):
        next_outage = jax.vmap(drop.next_outage, in_axes=(0, None, 0))(outage, 0.1, uniforms[:, 0])
        return next_outage, (next_outage, jax.vmap(drop.is_lost)(next_outage, uniforms[:, 1]))

    outage, lost = (
        np.asarray(x) for x in jax.lax.scan(step, jax.vmap(drop.initial_outage)(numbers[0, :, 0]), numbers)[1]
    )
    np.testing.assert_allclose(outage.mean(), 0.05, rtol=0.1)
    begins = np.sum(outage[1:] & ~outage[:-1])
    np.testing.assert_allclose(outage.sum() * 0.1 / begins, 1.0, rtol=0.12)  # 0.05 of it is the sampling
    np.testing.assert_allclose(lost.mean(), 1.0 - 0.95 * 0.9, rtol=0.05)


def test_a_camera_measures_range_and_angles_with_its_errors():
    measurements = readings(
        build_goal_sensor(GoalSensor(preset="camera", range_bias_m=0.0)), 3000, goal_position=(50_000.0, 9000.0, 0.0)
    )
    assert not np.any(measurements.measured)  # out of range
    measurements = readings(build_goal_sensor(GoalSensor(preset="camera", range_max_m=1e5)), 400)
    assert np.all(np.asarray(measurements.measured)[:, :3])
    assert not np.any(np.asarray(measurements.measured)[:, 3:])
    north = 3000.0 - 10.0 * np.arange(400)
    expected = np.sqrt(north**2 + 500.0**2 + 1000.0**2)
    range_errors = np.asarray(measurements.values[:, 0]) - expected
    np.testing.assert_allclose(range_errors.std(), 10.0, rtol=0.12)
    azimuth = np.asarray(measurements.values[:, 1]) - np.arctan2(500.0, north)
    across = azimuth * np.hypot(north, 500.0) / expected
    np.testing.assert_allclose(across.std(), 3e-3, rtol=0.12)
    elevation = np.asarray(measurements.values[:, 2]) + np.arctan2(1000.0, np.hypot(north, 500.0))
    np.testing.assert_allclose(elevation.std(), 3e-3, rtol=0.12)


def test_a_bias_across_the_line_of_sight_is_greater_in_azimuth():
    biased = {"angle_mrad": 0.0, "range_m": 0.0, "angle_bias_mrad": 20.0, "range_max_m": 1e5}
    measurements = readings(build_goal_sensor(GoalSensor(preset="camera", **biased)), 200)
    north = 3000.0 - 10.0 * np.arange(200)
    errors = np.asarray(measurements.values[:, 1]) - np.arctan2(500.0, north)
    across = errors * np.hypot(north, 500.0) / np.sqrt(north**2 + 500.0**2 + 1000.0**2)
    assert np.ptp(errors) > 0.1 * np.abs(errors).max()
    np.testing.assert_allclose(across, across[0], rtol=1e-9)


def test_field_of_view_failure_and_period():
    camera = build_goal_sensor(GoalSensor(preset="camera", half_angle_deg=30.0, range_max_m=1e5, period_s=0.5))
    is_measured = np.asarray(readings(camera, 400).measured).any(axis=1)
    assert np.all(np.flatnonzero(is_measured) % 5 == 0)
    north = 3000.0 - 10.0 * np.arange(400)
    inside = np.arccos(north / np.sqrt(north**2 + 500.0**2 + 1000.0**2)) <= np.deg2rad(30.0)
    np.testing.assert_array_equal(is_measured, inside & (np.arange(400) % 5 == 0))
    assert not np.any(readings(camera, 50, works=False).measured)


def test_delayed_measurements_arrive_on_time_with_their_sample_numbers():
    delayed_sensor = build_goal_sensor(GoalSensor(preset="ads-b", latency_s=(0.5, 2.0), period_s=0.5))
    measurements = readings(delayed_sensor, 600)
    is_measured = np.asarray(measurements.measured).any(axis=1)
    delay = (np.arange(600) - np.asarray(measurements.number))[is_measured] * STEP
    assert delay.min() >= 0.5 - 1e-9
    assert delay.max() <= 2.0 + 0.2  # two that are due at once come one after the other
    sample_numbers = np.asarray(measurements.number)[is_measured]
    assert len(set(sample_numbers.tolist())) == sample_numbers.size
    assert np.any(np.diff(sample_numbers) < 0)  # some overtake others
    assert sample_numbers.size > 100


def test_measurements_at_every_sample_are_never_older_than_the_stored_motion():
    """Random latency up to 30 samples: the motion of 32 samples is stored."""
    table = GoalSensor(preset="ads-b", latency_s=(0.0, 3.0), period_s=STEP)
    measurements = readings(build_goal_sensor(table), 2000)
    is_measured = np.asarray(measurements.measured).any(axis=1)
    delays = (np.arange(2000) - np.asarray(measurements.number))[is_measured]
    assert delays.max() == 31 < _motion_history_slots(table, STEP)
    assert abs(delays.mean() - 15.0) < 3.0
    assert delays.size > 0.94 * 2000


def test_satellite_navigation_and_inertial_sensors():
    sensors = build_vehicle_sensors(
        Navigation(sensors="satellite-inertial", noise_m=0.5, period_s=1.0, correlation_s=20.0)
    )
    flights = [readings(sensors, 300, aircraft=k) for k in range(40)]
    true = 10.0 * np.arange(300)
    new = np.asarray(flights[0].fix.is_new)
    assert np.all(np.flatnonzero(new) % 10 == 0)
    position_errors = np.stack([np.asarray(flight.fix.position_n[:, 0])[new] - true[new] for flight in flights])
    np.testing.assert_allclose(position_errors.std(), np.hypot(2.0, 0.5), rtol=0.12)
    np.testing.assert_allclose(
        np.diff(position_errors, axis=1).std(), np.hypot(2.0 * np.sqrt(2 * (1 - np.exp(-1 / 20))), 0.7), rtol=0.1
    )
    rates = np.stack([np.asarray(flight.rates_b[:, 0]) for flight in flights])
    np.testing.assert_allclose(rates.std(axis=1).mean(), np.deg2rad(0.03), rtol=0.05)
    np.testing.assert_allclose(rates.mean(axis=1).std(), np.deg2rad(0.002), rtol=0.6)
    air = np.stack([np.asarray(flight.velocity_air_b[:, 0]) for flight in flights])
    np.testing.assert_allclose(air.mean(axis=1).std(), 0.5, rtol=0.35)


def test_the_errors_match_the_covariances_of_the_navigation_filter():
    """Errors over standard deviations of many flights: satellite fixes with a slow error and noisy accelerometers."""
    density, steps, flights = 0.03**2 * STEP, 300, 300
    axes = jnp.full(3, 1.0)
    tracker = NavigationFilter(
        2.0 * axes, jnp.asarray(60.0), 0.3 * axes, 0.05 * axes, jnp.asarray(density), jnp.asarray(STEP)
    )
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(flights, steps + 1, 4, 3))

    def simulate_flight(noise):
        def step(carry, normals):
            memory, slow = carry
            slow = gauss_markov(slow, 2.0, 60.0, STEP, normals[0])
            fix = Fix(slow + 0.3 * normals[1], 0.05 * normals[2], jnp.asarray(True))
            felt = 0.03 * normals[3]
            memory = tracker.step(memory, fix, felt, jnp.ones(3), STEP)
            return (memory, slow), (memory.position_n, memory.velocity_n, memory.covariance)

        first_fix = Fix(2.0 * noise[0, 0] + 0.3 * noise[0, 1], 0.05 * noise[0, 2], jnp.asarray(True))
        memory = tracker.init(first_fix, jnp.zeros(3))
        return jax.lax.scan(step, (memory, 2.0 * noise[0, 0]), noise[1:])[1]

    position_error, speed, covariance = (
        np.asarray(x) for x in jax.jit(jax.vmap(simulate_flight))(jnp.asarray(normals))
    )
    ratio = position_error[:, -1] / np.sqrt(covariance[:, -1, :, 0, 0])
    np.testing.assert_allclose(ratio.std(), 1.0, rtol=0.1)
    ratio = speed[:, -1] / np.sqrt(covariance[:, -1, :, 1, 1])
    np.testing.assert_allclose(ratio.std(), 1.0, rtol=0.2)
    # within a correlation time, what is slow cannot be told from the position
    assert np.sqrt(covariance[:, -1, :, 0, 0]).min() > 1.3


@pytest.mark.parametrize(("velocity_m_s", "period_s"), [(0.05, 0.1), (0.5, 1.0)])
def test_the_covariances_of_the_scenario_s_filter_contain_bias_and_tilt(velocity_m_s, period_s):
    """Steady flight: constant errors of accelerometers and attitude, of which the filter knows the variance alone."""
    step_s, flights = 0.05, 60
    table = Navigation(sensors="satellite-inertial", velocity_m_s=velocity_m_s, period_s=period_s)
    tracker, every = _navigation_filter(table, step_s), round(period_s / step_s)
    rng = np.random.default_rng(7)
    tilt = np.deg2rad(table.attitude_deg) * 9.81 * rng.normal(size=(flights, 3)) * [1.0, 1.0, 0.0]
    constant = jnp.asarray(table.force_bias_m_s2 * rng.normal(size=(flights, 3)) + tilt)
    normals = jnp.asarray(rng.normal(size=(flights, 2401, 4, 3)))

    def simulate_flight(error_n, noise):
        def fix(slow, normal, is_new):
            return Fix(slow + table.noise_m * normal[1], velocity_m_s * normal[2], is_new)

        def step(carry, inputs):
            (memory, slow), (number, normal) = carry, inputs
            is_new = number % every == 0
            moved = gauss_markov(slow, table.position_m, table.correlation_s, period_s, normal[0])
            slow = jnp.where(is_new, moved, slow)
            felt = error_n + table.force_noise_m_s2 * normal[3]
            memory = tracker.step(memory, fix(slow, normal, is_new), felt, jnp.ones(3), step_s)
            return (memory, slow), None

        slow = table.position_m * noise[0, 0]
        start = tracker.init(fix(slow, noise[0], jnp.asarray(True)), error_n)
        return jax.lax.scan(step, (start, slow), (jnp.arange(1, 2401), noise[1:]))[0][0]

    memory = jax.jit(jax.vmap(simulate_flight))(constant, normals)
    for k, error in enumerate((memory.position_n, memory.velocity_n)):
        claimed = float(np.sqrt(memory.covariance[0, 0, k, k]))
        rms = np.sqrt(np.mean(np.asarray(error) ** 2))
        # 180 independent values: 5 % of the rms; the errors of the heading, which steady flight does not feel, are
        # claimed too.
        assert 0.6 * claimed < rms < 1.15 * claimed, (k, rms, claimed)


def test_the_air_filter_finds_a_steady_wind_and_gusts_across():
    air = AirFilter(jnp.asarray(5.0), jnp.asarray(0.3))
    wind_n, gust_b = jnp.array([6.0, -3.0, 0.5]), jnp.array([0.0, 0.0, 2.0])
    memory = air.init(jnp.zeros(3))
    velocity_n = jnp.array([150.0, 0.0, 0.0])
    step = jax.jit(lambda *arguments: air.step(*arguments))
    for _ in range(400):
        memory = step(memory, jnp.eye(3), velocity_n, velocity_n - wind_n, STEP)
    np.testing.assert_allclose(memory.wind_n, wind_n, atol=0.01)
    for _ in range(10):
        memory = step(memory, jnp.eye(3), velocity_n, velocity_n - wind_n - gust_b, STEP)
    assert 1.5 < float(memory.gust_b[2]) < 2.0


def test_exact_air_data_hold_the_gust():
    """The angle of attack of the autopilot's model follows that of the aircraft in a gust, as with measured air data."""
    truth = truth_at(jnp.asarray(0))
    gust = Disturbance(Gust(jnp.array([0.0, 3.0, 5.0]), jnp.zeros(3)), jnp.asarray(1.0))
    condition = air_data_and_forces(AIRFRAME, ENVIRONMENT, 0.0, truth.state, disturbance=gust)
    truth = dataclasses.replace(truth, condition=condition)
    sensors, estimator = IdealSensors(), TrackingEstimator(air=AirFilter(jnp.asarray(20.0), jnp.asarray(0.3)))
    reading, _ = sensors.read(sensors.init(truth, instant_at(0)), truth, instant_at(0))

    @jax.jit
    def believed(estimator_state, k):
        belief, estimator_state = estimator.estimate(estimator_state, reading, AIRFRAME, instant_at(k))
        return estimator_state, (belief.condition.air_data.alpha, belief.condition.air_data.beta)

    start = estimator.init(reading, AIRFRAME, instant_at(0))
    alpha, beta = jax.lax.scan(believed, start, jnp.arange(20))[1]
    for angle, true in ((alpha, condition.air_data.alpha), (beta, condition.air_data.beta)):
        assert abs(float(true)) > 0.02
        assert float(angle[-1]) == pytest.approx(float(true), rel=0.1)
