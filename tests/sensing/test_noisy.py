"""Sensors with errors: as large, as slow, as late and as often absent as they are said to be."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AircraftState, flight_condition
from anser.aircraft.actuators import Deflections
from anser.aircraft.engines import EnginePower
from anser.environment import standard_environment
from anser.numerics import flight_randomness
from anser.parts import GoalState, Instant, Truth
from anser.parts.perception import Fix
from anser.scenario.build_sensing import build_goal_sensor, build_vehicle_sensors
from anser.scenario.schema_sensing import GoalSensor, Navigation
from anser.sensing.navigation import AirFilter, NavigationFilter
from anser.sensing.vehicle_sensors import Dropouts, gauss_markov
from support.light_aircraft import light_aircraft

ENVIRONMENT = standard_environment()
STEP = 0.1
AIRFRAME = light_aircraft()


def truth_at(k, works=True, place=(3000.0, 500.0, 0.0)):
    state = AircraftState(
        position_n=jnp.stack([100.0 * STEP * k, jnp.zeros_like(1.0 * k), jnp.asarray(-1000.0)]),
        velocity_b=jnp.array([100.0, 0.0, 0.0]),
        quaternion=jnp.array([1.0, 0.0, 0.0, 0.0]),
        rates_b=jnp.zeros(3),
        actuators=Deflections(jnp.zeros(3)),
        engine=EnginePower(jnp.asarray(20.0)),
    )
    goal = GoalState(jnp.array(place), jnp.array([5.0, 0.0, 0.0]))
    return Truth(AIRFRAME, state, flight_condition(AIRFRAME, ENVIRONMENT, 0.0, state), goal, jnp.asarray(works))


def instant_at(k, aircraft=0):
    source = flight_randomness(3).for_aircraft(jnp.asarray(aircraft))
    return Instant(ENVIRONMENT, jnp.asarray(k, dtype=jnp.int32), jnp.asarray(STEP), source)


def readings(sensor, count, aircraft=0, **of_truth):
    def one(memory, k):
        reading, memory = sensor.read(memory, truth_at(k, **of_truth), instant_at(k, aircraft))
        return memory, reading

    first = sensor.init(truth_at(jnp.asarray(0), **of_truth), instant_at(0, aircraft))
    return jax.lax.scan(one, first, jnp.arange(count, dtype=jnp.int32))[1]


@pytest.mark.parametrize(("sigma", "time"), [(2.0, 60.0), (0.3, 0.5)])
def test_gauss_markov_errors_are_stationary_and_forget(sigma, time):
    normals = jnp.asarray(np.random.default_rng(0).normal(size=(2001, 200)))

    def step(error, drawn):
        after = gauss_markov(error, sigma, time, 0.1, drawn)
        return after, after

    rows = np.asarray(jax.lax.scan(step, sigma * normals[0], normals[1:])[1])
    np.testing.assert_allclose(rows.std(axis=1).mean(), sigma, rtol=0.05)
    lag = max(1, round(time / 0.1))
    if lag < 1000:
        kept = np.mean(rows[lag:] * rows[:-lag]) / sigma**2
        np.testing.assert_allclose(kept, np.exp(-1.0), atol=0.08)


def test_outages_come_in_bursts_of_the_mean_duration():
    drop = Dropouts(jnp.asarray(0.1), jnp.asarray(0.05), jnp.asarray(1.0))
    numbers = jnp.asarray(np.random.default_rng(1).random((40_000, 50, 2)))

    def step(outage, u):
        after = jax.vmap(drop.next_outage, in_axes=(0, None, 0))(outage, 0.1, u[:, 0])
        return after, (after, jax.vmap(drop.is_lost)(after, u[:, 1]))

    outage, lost = (
        np.asarray(x) for x in jax.lax.scan(step, jax.vmap(drop.initial_outage)(numbers[0, :, 0]), numbers)[1]
    )
    np.testing.assert_allclose(outage.mean(), 0.05, rtol=0.1)
    begins = np.sum(outage[1:] & ~outage[:-1])
    np.testing.assert_allclose(outage.sum() * 0.1 / begins, 1.0, rtol=0.12)  # 0.05 of it is the sampling
    np.testing.assert_allclose(lost.mean(), 1.0 - 0.95 * 0.9, rtol=0.05)


def test_a_camera_measures_range_and_angles_with_its_errors():
    found = readings(
        build_goal_sensor(GoalSensor(preset="camera", range_bias_m=0.0)), 3000, place=(50_000.0, 9000.0, 0.0)
    )
    assert not np.any(found.measured)  # out of range
    found = readings(build_goal_sensor(GoalSensor(preset="camera", range_max_m=1e5)), 400)
    assert np.all(np.asarray(found.measured)[:, :3])
    assert not np.any(np.asarray(found.measured)[:, 3:])
    north = 3000.0 - 10.0 * np.arange(400)
    expected = np.sqrt(north**2 + 500.0**2 + 1000.0**2)
    off = np.asarray(found.values[:, 0]) - expected
    np.testing.assert_allclose(off.std(), 10.0, rtol=0.12)
    azimuth = np.asarray(found.values[:, 1]) - np.arctan2(500.0, north)
    across = azimuth * np.hypot(north, 500.0) / expected
    np.testing.assert_allclose(across.std(), 3e-3, rtol=0.12)
    elevation = np.asarray(found.values[:, 2]) + np.arctan2(1000.0, np.hypot(north, 500.0))
    np.testing.assert_allclose(elevation.std(), 3e-3, rtol=0.12)


def test_field_of_view_failure_and_period():
    ahead = build_goal_sensor(GoalSensor(preset="camera", half_angle_deg=30.0, range_max_m=1e5, period_s=0.5))
    found = np.asarray(readings(ahead, 400).measured).any(axis=1)
    assert np.all(np.flatnonzero(found) % 5 == 0)
    north = 3000.0 - 10.0 * np.arange(400)
    inside = np.arccos(north / np.sqrt(north**2 + 500.0**2 + 1000.0**2)) <= np.deg2rad(30.0)
    np.testing.assert_array_equal(found, inside & (np.arange(400) % 5 == 0))
    assert not np.any(readings(ahead, 50, works=False).measured)


def test_late_measurements_arrive_when_they_are_due_and_say_when_they_were_made():
    late = build_goal_sensor(GoalSensor(preset="ads-b", latency_s=(0.5, 2.0), period_s=0.5))
    found = readings(late, 600)
    here = np.asarray(found.measured).any(axis=1)
    delay = (np.arange(600) - np.asarray(found.number))[here] * STEP
    assert delay.min() >= 0.5 - 1e-9
    assert delay.max() <= 2.0 + 0.2  # two that are due at once come one after the other
    made = np.asarray(found.number)[here]
    assert len(set(made.tolist())) == made.size
    assert np.any(np.diff(made) < 0)  # some overtake others
    assert made.size > 100


def test_satellite_navigation_and_inertial_sensors():
    sensors = build_vehicle_sensors(
        Navigation(sensors="satellite-inertial", noise_m=0.5, period_s=1.0, correlation_s=20.0)
    )
    read = jax.jit(lambda k: readings(sensors, 300, aircraft=k))
    rows = [read(k) for k in range(40)]
    true = 10.0 * np.arange(300)
    new = np.asarray(rows[0].fix.is_new)
    assert np.all(np.flatnonzero(new) % 10 == 0)
    off = np.stack([np.asarray(r.fix.position_n[:, 0])[new] - true[new] for r in rows])
    np.testing.assert_allclose(off.std(), np.hypot(2.0, 0.5), rtol=0.12)
    np.testing.assert_allclose(
        np.diff(off, axis=1).std(), np.hypot(2.0 * np.sqrt(2 * (1 - np.exp(-1 / 20))), 0.7), rtol=0.1
    )
    rates = np.stack([np.asarray(r.rates_b[:, 0]) for r in rows])
    np.testing.assert_allclose(rates.std(axis=1).mean(), np.deg2rad(0.03), rtol=0.05)
    np.testing.assert_allclose(rates.mean(axis=1).std(), np.deg2rad(0.002), rtol=0.6)
    air = np.stack([np.asarray(r.velocity_air_b[:, 0]) for r in rows])
    np.testing.assert_allclose(air.mean(axis=1).std(), 0.5, rtol=0.35)


def test_the_navigation_filter_knows_how_wrong_it_is():
    """Errors over standard deviations of many flights: satellite fixes with a slow error and noisy accelerometers."""
    density, steps, flights = 0.03**2 * STEP, 300, 300
    axes = jnp.full(3, 1.0)
    tracker = NavigationFilter(
        2.0 * axes, jnp.asarray(60.0), 0.3 * axes, 0.05 * axes, jnp.asarray(density), jnp.asarray(STEP)
    )
    rng = np.random.default_rng(5)
    drawn = rng.normal(size=(flights, steps + 1, 4, 3))

    def one(noise):
        def step(carry, drawn):
            memory, slow = carry
            slow = gauss_markov(slow, 2.0, 60.0, STEP, drawn[0])
            fix = Fix(slow + 0.3 * drawn[1], 0.05 * drawn[2], jnp.asarray(True))
            felt = 0.03 * drawn[3]
            memory = tracker.step(memory, fix, felt, jnp.ones(3), STEP)
            return (memory, slow), (memory.position_n, memory.velocity_n, memory.covariance)

        first = Fix(2.0 * noise[0, 0] + 0.3 * noise[0, 1], 0.05 * noise[0, 2], jnp.asarray(True))
        memory = tracker.init(first, jnp.zeros(3))
        return jax.lax.scan(step, (memory, 2.0 * noise[0, 0]), noise[1:])[1]

    place, speed, covariance = (np.asarray(x) for x in jax.jit(jax.vmap(one))(jnp.asarray(drawn)))
    ratio = place[:, -1] / np.sqrt(covariance[:, -1, :, 0, 0])
    np.testing.assert_allclose(ratio.std(), 1.0, rtol=0.1)
    ratio = speed[:, -1] / np.sqrt(covariance[:, -1, :, 1, 1])
    np.testing.assert_allclose(ratio.std(), 1.0, rtol=0.2)
    # what is slow cannot be told from the position
    assert np.sqrt(covariance[:, -1, :, 0, 0]).min() > 1.3


def test_the_air_filter_finds_a_steady_wind_and_gusts_across():
    air = AirFilter(jnp.asarray(5.0), jnp.asarray(0.3))
    wind_n, gust_b = jnp.array([6.0, -3.0, 0.5]), jnp.array([0.0, 0.0, 2.0])
    memory = air.init(jnp.zeros(3))
    velocity_n = jnp.array([150.0, 0.0, 0.0])
    for _ in range(400):
        memory = air.step(memory, jnp.eye(3), velocity_n, velocity_n - wind_n, STEP)
    np.testing.assert_allclose(memory.wind_n, wind_n, atol=0.01)
    for _ in range(10):
        memory = air.step(memory, jnp.eye(3), velocity_n, velocity_n - wind_n - gust_b, STEP)
    assert 1.5 < float(memory.gust_b[2]) < 2.0
