"""Sensors that are late: what they remember, and what they tell."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AircraftState, flight_condition
from anser.aircraft.actuators import Deflections
from anser.aircraft.engines import EnginePower
from anser.aircraft_files import load_airframe
from anser.environment import standard_environment
from anser.parts import GoalState, Instant, Truth
from anser.sensing import DelayedSensors, IdealSensors
from anser.sensing.ideal_sensors import SampleRing, SensorSample
from anser.spatial import quaternion_from_euler

AIRFRAME, ENVIRONMENT = load_airframe(), standard_environment()
STEP, DELAY_MAX = 0.01, 0.1


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
    return Truth(AIRFRAME, state, flight_condition(AIRFRAME, ENVIRONMENT, 0.0, state), goal), instant


def steady(delay_max):
    """Memory of an aircraft in steady flight."""
    return DelayedSensors(jnp.asarray(0.0), delay_max, STEP).init(*true_at(0))


def ring():
    """Memory for the longest delay, full of sample 0."""
    return SampleRing(jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (12, *jnp.shape(leaf))), sample_at(0)))


def sample_at(k):
    """A reading that changes in every number, as a line in time but for the attitude."""
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
def late():
    """Reading of a given lateness after each of 30 samples, from a memory for 0.1 s at 10 ms."""
    samples = jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(sample_at, range(30)))

    @jax.jit
    def all_of(periods):
        def one(readings, k):
            readings = readings.with_sample(k, jax.tree.map(lambda leaf: leaf[k], samples))
            return readings, readings.delayed_sample(k, periods)

        return jax.lax.scan(one, ring(), jnp.arange(30))[1]

    return lambda periods: jax.tree.map(np.asarray, all_of(jnp.asarray(float(periods)))), samples


@pytest.mark.parametrize("periods", [0, 1, 3, 10])
def test_whole_delays_are_a_shift(late, periods):
    of, samples = late
    found = of(periods)
    shifted = np.maximum(np.arange(30) - periods, 0)  # before the start: the first
    for ours, given in zip(jax.tree.leaves(found), jax.tree.leaves(samples), strict=True):
        np.testing.assert_array_equal(ours, np.asarray(given)[shifted])


def test_between_samples_it_is_linear(late):
    of, _ = late
    found = of(2.25)
    at = np.arange(30) - 2.25
    inside = at >= 0
    np.testing.assert_allclose(found.state.position_n[inside, 0], at[inside], atol=1e-12)
    np.testing.assert_allclose(found.specific_force_b[inside, 0], at[inside], atol=1e-12)
    np.testing.assert_allclose(found.state.power[inside], 5 * at[inside], atol=1e-12)
    # a point of the chord of half the angle, 0.02 rad, is seen 0.02^3 / 30 off that of the arc at most
    directions = found.state.quaternion / np.linalg.norm(found.state.quaternion, axis=1, keepdims=True)
    expected = jax.vmap(lambda x: sample_at(x).state.quaternion)(jnp.asarray(at[inside]))
    np.testing.assert_allclose(directions[inside], expected, atol=1e-6)


def test_the_memory_holds_the_largest_delay():
    """Whole and broken delays up to the largest need the sample before the oldest wanted."""
    for delay_max, rows in ((0.0, 2), (0.1, 12), (0.105, 13), (0.2, 22)):
        assert steady(delay_max).buffer.specific_force_b.shape == (rows, 3)


@pytest.mark.parametrize("periods", [0.0, 3.0, 2.5])
def test_readings_are_the_truth_of_before(periods):
    """Of an aircraft in steady flight past a boat: state, air data and line of sight are those `periods` ago."""
    truths, instants = zip(*(true_at(k) for k in range(12)), strict=True)
    sensors = DelayedSensors(jnp.asarray(periods * STEP), DELAY_MAX, STEP)
    memory = sensors.init(truths[0], instants[0])
    for truth, instant in zip(truths, instants, strict=True):
        reading, memory = sensors.read(memory, truth, instant)
    before = 11 - periods
    np.testing.assert_allclose(reading.state.position_n[0], 150.0 * STEP * before, atol=1e-9)
    np.testing.assert_allclose(float(jnp.linalg.norm(reading.state.quaternion)), 1.0, atol=1e-15)
    np.testing.assert_allclose(reading.condition.air_data.V, 150.0, rtol=1e-12)
    # the line of sight is never between samples: that of the even number next to it
    seen, _ = IdealSensors().read(None, *true_at(round(before)) if periods != 2.5 else true_at(9))
    for ours, ideal in zip(jax.tree.leaves(reading.sight), jax.tree.leaves(seen.sight), strict=True):
        np.testing.assert_allclose(ours, ideal, rtol=1e-12)
