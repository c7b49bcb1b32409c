"""Sensors without errors equal perfect knowledge, and flights with noisy sensors converge to it."""

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

from anser.scenario import build_flight, loads
from anser.sensing import TrackingEstimator
from anser.simulation import assemble, fly, start_flight

pytestmark = pytest.mark.long

TEXT = Path("scenarios/three-aircraft.toml").read_text(encoding="utf-8")
STEPS = 7000  # beyond the arrivals at 60.4 s
# at every step, and every error a share of what it is by default
NAVIGATION = """
[navigation]
sensors = "satellite-inertial"
period_s = 0.01
position_m = {two:g}
noise_m = {noise:g}
velocity_m_s = {velocity:g}
attitude_deg = {velocity:g}
heading_deg = {noise:g}
rates_bias_deg_s = {bias:g}
rates_noise_deg_s = {velocity:g}
force_bias_m_s2 = {bias:g}
force_noise_m_s2 = {velocity:g}
airspeed_bias_m_s = {noise:g}
airspeed_noise_m_s = {noise:g}
vane_bias_deg = {velocity:g}
vane_noise_deg = {velocity:g}
"""
GOAL = """
[goal_sensor]
preset = "camera"
period_s = 0.01
range_m = {range:g}
angle_mrad = {angle:g}
[estimator]
briefed_position_m = {range:g}
briefed_velocity_m_s = {velocity:g}
acceleration_m_s2 = {goal:g}
"""


def noisy(share):
    numbers = {"two": 2.0, "noise": 0.3, "velocity": 0.05, "bias": 0.002, "range": 10.0, "angle": 3.0, "goal": 0.02}
    scaled = {key: share * value for key, value in numbers.items()}
    return NAVIGATION.format(**scaled), GOAL.format(**(scaled if share else numbers))


def with_estimator(flight, estimator):
    """The same flight with one estimator for every aircraft."""
    aircraft = [flight.aircraft(k) for k in range(flight.count)]
    aircraft = [(dataclasses.replace(vehicle, estimator=estimator), *start) for vehicle, *start in aircraft]
    timing = flight.timing
    return assemble(
        flight.environment,
        aircraft,
        flight.planner,
        timing.step,
        timing.replan_steps,
        timing.freeze,
        flight.randomness,
    )


@eqx.filter_jit
def flown(flight):
    state, _ = start_flight(flight)
    _, _, history = fly(flight, state, 0, STEPS)
    return {key: history[key] for key in SCALES}


# of each recorded quantity, SI
SCALES = {
    "north": 1e4,
    "east": 1e4,
    "altitude": 1e3,
    "airspeed": 150.0,
    "alpha": 0.1,
    "roll": 1.0,
    "roll_rate": 1.0,
    "elevator": 0.1,
    "arrival_time": 60.0,
}


@pytest.fixture(scope="module")
def perfect():
    return jax.tree.map(np.asarray, flown(build_flight(loads(TEXT))))


def largest_deviation(history, reference):
    return max(float(np.max(np.abs(history[key] - reference[key]))) / scale for key, scale in SCALES.items())


def test_error_free_sensors_equal_perfect_knowledge(perfect):
    flight = with_estimator(build_flight(loads(TEXT + noisy(0.0)[0])), TrackingEstimator())
    noisy_history = jax.tree.map(np.asarray, flown(flight))
    assert largest_deviation(noisy_history, perfect) < 1e-9


def test_filtered_flights_converge_to_perfect_knowledge_over_three_decades(perfect):
    """The process noise of the goal's motion vanishes with the sensor noise: the filter gain stays constant.

    With constant process noise, the error of the goal's velocity would fall only with the fourth root of the sensor
    noise.
    """
    largest_deviations = []
    for share in (0.1, 0.01, 0.001, 0.0001):
        noisy_history = jax.tree.map(np.asarray, flown(build_flight(loads(TEXT + "".join(noisy(share))))))
        deviations = [np.abs(noisy_history[key] - perfect[key]).max() for key in ("north", "east", "altitude")]
        largest_deviations.append(float(max(deviations)))
    print("greatest departure from the perfect flight, m:", largest_deviations)  # noqa: T201
    # in proportion to the noise: a factor of 10, but for what is not linear in the largest of it
    ratios = np.array(largest_deviations[:-1]) / np.array(largest_deviations[1:])
    assert np.all(ratios > 7.0), largest_deviations
    assert largest_deviations[-1] < 0.01
