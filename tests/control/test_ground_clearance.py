"""Ground clearance: a descent broken off at the guard's command ends above the floor."""

from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser.control.ground_clearance import ALTITUDE_ERROR_ALLOWED_M
from anser.scenario import build_flight, load
from anser.simulation.closed_loop import AT_GROUND, BREAKAWAY, FLYING
from support.fleet_flight import own, segment, started, with_own

SCENARIO = Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml"
FLOOR = 100.0 - ALTITUDE_ERROR_ALLOWED_M
# airspeed m/s, path angle, bank, angle of attack deg; from steep to inverted, at low speed, and unloaded
DIVES = [
    [(120, -10, 0, 3), (150, -25, 60, 5), (240, -65, 120, 2)],
    [(95, -10, 60, 5), (120, -45, 0, -3), (200, -65, 60, 5)],
    [(150, -45, 0, 3), (150, -20, 180, 2), (200, -40, -150, 2)],
]


@pytest.fixture(scope="module")
def three():
    flight = build_flight(load(SCENARIO))
    once = eqx.tree_at(lambda f: f.timing.replan_steps, flight, jnp.zeros_like(flight.timing.replan_steps))
    return once, started(flight)


def quaternion(roll, pitch):
    """Quaternion of a roll about a pitched path; north is ahead."""
    cosines, sines = np.cos([roll / 2, pitch / 2]), np.sin([roll / 2, pitch / 2])
    return np.array([cosines[0] * cosines[1], sines[0] * cosines[1], cosines[0] * sines[1], -sines[0] * sines[1]])


def pitched(q, angle):
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    return np.array([c * q[0] - s * q[2], c * q[1] - s * q[3], c * q[2] + s * q[0], c * q[3] + s * q[1]])


def placed(state, dives, heights):
    speed, gamma, bank, alpha = np.array(dives, dtype=float).T
    gamma, bank, alpha = np.radians(gamma), np.radians(bank), np.radians(alpha)
    attitude = np.stack([pitched(quaternion(*pair), a) for *pair, a in zip(bank, gamma, alpha, strict=True)])
    velocity_b = np.stack([speed * np.cos(alpha), 0 * speed, speed * np.sin(alpha)], axis=1)
    position_n = np.stack([0 * speed, 5000.0 * (1 + np.arange(3)), -np.asarray(heights)], axis=1)
    return with_own(
        lambda s: (s.aircraft.quaternion, s.aircraft.velocity_b, s.aircraft.position_n, s.aircraft.rates_b),
        state,
        tuple(jnp.asarray(x) for x in (attitude, velocity_b, position_n, np.zeros((3, 3)))),
    )


def first_trigger(three, dives):
    """Least height, to 2 m, at which the guard does not stop the dive in its first step."""
    flight, state = three
    low, high = np.full(3, FLOOR), np.full(3, FLOOR + 5000.0)
    while np.max(high - low) > 2.0:
        middle = 0.5 * (low + high)
        _, history = segment(flight, placed(state, dives, middle))
        lost = history["status"][1] == BREAKAWAY
        low, high = np.where(lost, middle, low), np.where(lost, high, middle)
    return low


@pytest.mark.long
@pytest.mark.parametrize("dives", DIVES, ids=["shallow and banked", "slow and pushed over", "steep and inverted"])
def test_a_descent_broken_off_at_the_last_moment_ends_above_the_floor(three, dives):
    flight, state = three
    heights = first_trigger(three, dives)
    final_state, lowest = placed(state, dives, heights), np.full(3, np.inf)
    for number in range(6):
        final_state, history = segment(flight, final_state, number)
        lowest = np.minimum(lowest, np.asarray(history["altitude"]).min(axis=0))
    np.testing.assert_array_equal(own(final_state).status, BREAKAWAY)
    # Measured: of the height reckoned with 0.29 to 0.94 is used.
    assert np.all(lowest > FLOOR), (heights, lowest)
    # and it goes to its hold 300 m above its goal
    assert np.all(np.asarray(history["altitude"][-1]) > 150.0)
    assert np.all(np.asarray(history["phase"][-1]) == 2)


@pytest.mark.long
def test_level_flight_at_the_least_altitude_continues(three):
    flight, state = three
    final_state, _ = segment(
        flight, placed(state, [(150, 0, 0, 4), (150, 1, 0, 4), (150, 10, 60, 5)], [90.0, 75.0, 75.0])
    )
    assert AT_GROUND not in np.asarray(own(final_state).status)
    _, history = segment(flight, placed(state, [(150, 0, 0, 4)] * 3, [90.0] * 3))
    assert np.all(np.asarray(history["status"][:5]) == FLYING)
