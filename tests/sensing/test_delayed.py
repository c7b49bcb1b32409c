"""Delayed sensors: the ring buffer and the readings."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AircraftState, air_data_and_forces
from anser.aircraft.actuators import Deflections
from anser.aircraft.engines import EnginePower
from anser.aircraft_files import load_airframe
from anser.environment import standard_environment
from anser.parts import GoalState, Instant, Truth
from anser.sensing import DelayedSensors, IdealSensors
from anser.sensing.goal_filters import hand_over_goal
from anser.sensing.ideal_sensors import SampleRing, SensorSample, true_line_of_sight
from anser.spatial import quaternion_from_euler

AIRFRAME, ENVIRONMENT = load_airframe(), standard_environment()
STEP, DELAY_MAX = 0.01, 0.1


@jax.jit
def true_at(k):
    """Truth and instant of sample k: 150 m/s to the North, a boat ahead."""
    x = 1.0 * k
    state = AircraftState(
        position_n=jnp.array([150.0 * STEP * x, 0.0, -1000.0]),
        velocity_b=jnp.array([150.0, 0.0, 0.0]),
        quaternion=jnp.array([1.0, 0.0, 0.0, 0.0]),
        rates_b=jnp.zeros(3),
        actuators=Deflections(jnp.zeros(3)),
        engine=EnginePower(jnp.asarray(20.0)),
    )
    instant = Instant(ENVIRONMENT, jnp.asarray(k, dtype=jnp.int32), jnp.asarray(STEP))
    goal = GoalState(jnp.array([3000.0, 500.0, 0.0]), jnp.array([5.0, 0.0, 0.0]))
    return Truth(AIRFRAME, state, air_data_and_forces(AIRFRAME, ENVIRONMENT, 0.0, state), goal), instant


def steady(delay_max):
    """Ring buffer of an aircraft in steady flight."""
    return DelayedSensors(jnp.asarray(0.0), delay_max, STEP).init(*true_at(0))


def ring():
    """Ring buffer for the longest delay, filled with sample 0."""
    return SampleRing(jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (12, *jnp.shape(leaf))), sample_at(0)))


@jax.jit
def sample_at(k):
    """A sample that changes in every number, linear in time except for the attitude."""
    x = 1.0 * k
    return SensorSample(
        AircraftState(
            position_n=jnp.array([x, 2 * x, -1000.0]),
            velocity_b=jnp.array([100.0 + x, x, -x]),
            quaternion=quaternion_from_euler(0.0, 0.0, 0.04 * x),
            rates_b=jnp.array([0.1 * x, 0.0, -0.1 * x]),
            actuators=Deflections(jnp.array([x, -x, 3 * x])),
            engine=EnginePower(jnp.asarray(5 * x)),
        ),
        jnp.array([x, 0.0, -9.8]),
        None,
    )


@pytest.fixture(scope="module")
def delayed():
    """Delayed readings after each of 30 samples, from a ring buffer for 0.1 s at 10 ms."""
    samples = jax.vmap(sample_at)(jnp.arange(30))

    @jax.jit
    def all_of(periods):
        def one(readings, k):
            readings = readings.with_sample(k, jax.tree.map(lambda leaf: leaf[k], samples))
            return readings, readings.delayed_sample(k, periods)

        return jax.lax.scan(one, ring(), jnp.arange(30))[1]

    return lambda periods: jax.tree.map(np.asarray, all_of(jnp.asarray(float(periods)))), samples


@pytest.mark.parametrize("periods", [0, 1, 3, 10])
def test_whole_delays_are_a_shift(delayed, periods):
    delayed_readings, samples = delayed
    readings = delayed_readings(periods)
    shifted = np.maximum(np.arange(30) - periods, 0)  # before the start: the first
    for ours, sample_leaf in zip(jax.tree.leaves(readings), jax.tree.leaves(samples), strict=True):
        np.testing.assert_array_equal(ours, np.asarray(sample_leaf)[shifted])


def test_readings_between_samples_are_interpolated_linearly(delayed):
    delayed_readings, _ = delayed
    readings = delayed_readings(2.25)
    times = np.arange(30) - 2.25
    inside = times >= 0
    np.testing.assert_allclose(readings.state.position_n[inside, 0], times[inside], atol=1e-12)
    np.testing.assert_allclose(readings.specific_force_b[inside, 0], times[inside], atol=1e-12)
    np.testing.assert_allclose(readings.state.power[inside], 5 * times[inside], atol=1e-12)
    # a point of the chord of half the angle, 0.02 rad, is seen 0.02^3 / 30 off that of the arc at most
    directions = readings.state.quaternion / np.linalg.norm(readings.state.quaternion, axis=1, keepdims=True)
    expected = jax.vmap(lambda x: sample_at(x).state.quaternion)(jnp.asarray(times[inside]))
    np.testing.assert_allclose(directions[inside], expected, atol=1e-6)


def test_the_ring_buffer_holds_the_largest_delay():
    """Whole and fractional delays up to the largest need the sample before the oldest reading."""
    for delay_max, row_count in ((0.0, 2), (0.1, 12), (0.105, 13), (0.2, 22)):
        assert steady(delay_max).buffer.specific_force_b.shape == (row_count, 3)


@pytest.mark.parametrize("periods", [0.0, 3.0, 2.5])
def test_readings_are_the_truth_of_the_delayed_time(periods):
    """In steady flight past a boat, state, air data and line of sight are those of `periods` samples ago."""
    truths, instants = zip(*(true_at(k) for k in range(12)), strict=True)
    sensors = DelayedSensors(jnp.asarray(periods * STEP), DELAY_MAX, STEP)
    memory = eqx.filter_jit(sensors.init)(truths[0], instants[0])
    read = eqx.filter_jit(sensors.read)
    for truth, instant in zip(truths, instants, strict=True):
        reading, memory = read(memory, truth, instant)
    sample_number = 11 - periods
    np.testing.assert_allclose(reading.state.position_n[0], 150.0 * STEP * sample_number, atol=1e-9)
    np.testing.assert_allclose(float(jnp.linalg.norm(reading.state.quaternion)), 1.0, atol=1e-15)
    np.testing.assert_allclose(reading.condition.air_data.V, 150.0, rtol=1e-12)
    ideal_reading, _ = eqx.filter_jit(IdealSensors().read)(None, true_at(sample_number)[0], instants[0])
    for ours, ideal in zip(jax.tree.leaves(reading.sight), jax.tree.leaves(ideal_reading.sight), strict=True):
        np.testing.assert_allclose(ours, ideal, rtol=1e-12)


def test_a_goal_taken_over_is_seen_at_once_as_it_was_before_the_delay():
    sensors, (truth, instant) = DelayedSensors(jnp.asarray(3 * STEP), DELAY_MAX, STEP), true_at(0)
    other_goal = GoalState(jnp.array([-2000.0, 500.0, 0.0]), jnp.array([0.0, 9.0, 0.0]))
    other_truth = dataclasses.replace(truth, goal=other_goal)
    ring_of, read = eqx.filter_jit(sensors.init), eqx.filter_jit(sensors.read)
    receiver_ring = hand_over_goal(ring_of(truth, instant), ring_of(other_truth, instant))
    reading, _ = read(receiver_ring, dataclasses.replace(true_at(1)[0], goal=other_goal), true_at(1)[1])
    expected = true_line_of_sight(other_truth, ENVIRONMENT.earth)
    for ours, ideal in zip(jax.tree.leaves(reading.sight), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(ours, ideal, rtol=1e-12)
