"""Shifts of goals relative to each other, after which holds may lack separation."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.planning import Separation
from anser.planning.certified.replanning import SIGNIFICANT_DEVIATIONS
from anser.planning.holds.hold_paths import goals_have_shifted
from anser.planning.separation import separation_ratio

ARRIVALS = np.array([100.0, 90.0, 120.0])
FORECAST_S, NOW_S = 10.0, 40.0
POSITIONS_N = np.array([[0.0, 0.0, 0.0], [500.0, 0.0, 0.0], [0.0, 800.0, -50.0]])
VELOCITIES_N = np.array([[5.0, 0.0, 0.0], [0.0, -4.0, 0.0], [0.0, 0.0, 0.0]])
FLAT = Separation(jnp.asarray(200.0), jnp.asarray(0.0))


def holds_with(ratio):
    ratios = np.where(np.eye(3, dtype=bool), np.inf, ratio)
    return SimpleNamespace(
        goal_positions_n=jnp.asarray(POSITIONS_N),
        goal_velocities_n=jnp.asarray(VELOCITIES_N),
        forecast_time=jnp.asarray(FORECAST_S),
        clearance_ratio=jnp.asarray(ratios),
        clear=jnp.ones(3, bool),
    )


def tasks_with(offset_n=(0.0, 0.0, 0.0), change_n=(0.0, 0.0, 0.0), active=(1.0, 1.0, 1.0)):
    """Goals at `NOW_S` as forecast, but the second one at an offset (m) and with a change of velocity (m/s)."""
    second = np.array([[0.0], [1.0], [0.0]])
    return SimpleNamespace(
        goal_position_n=jnp.asarray(POSITIONS_N + (NOW_S - FORECAST_S) * VELOCITIES_N + second * np.array(offset_n)),
        goal_velocity_n=jnp.asarray(VELOCITIES_N + second * np.array(change_n)),
        active=jnp.asarray(active),
    )


def shifted(ratio=1.0, tasks=None, separation=FLAT, covariances=None, now=NOW_S):
    tasks = tasks_with() if tasks is None else tasks
    return np.asarray(goals_have_shifted(holds_with(ratio), tasks, jnp.asarray(ARRIVALS), now, separation, covariances))


def pairs(*indices):
    matrix = np.zeros((3, 3), bool)
    for i, j in indices:
        matrix[i, j] = matrix[j, i] = True
    return matrix


def test_goals_as_forecast_have_not_shifted():
    assert not shifted().any()


def test_a_shift_counts_for_each_pair_of_the_goal_beyond_the_reserve_of_its_holds():
    tasks = tasks_with((0.0, 100.0, 0.0))  # half of the separation
    np.testing.assert_array_equal(shifted(1.0, tasks), pairs((0, 1), (1, 2)))
    assert not shifted(1.5, tasks).any()
    np.testing.assert_array_equal(shifted([[1.0, 1.4, 1.0], [1.4, 1.0, 1.6], [1.0, 1.6, 1.0]], tasks), pairs((0, 1)))
    # holds that lack separation are chosen again after a shift only
    np.testing.assert_array_equal(shifted(0.5, tasks), pairs((0, 1), (1, 2)))
    assert not shifted(0.5).any()


def test_a_change_of_velocity_counts_up_to_the_first_arrival_of_the_pair():
    # 50 s before the second aircraft's arrival, the first of each of its pairs
    assert shifted(1.45, tasks_with(change_n=(2.1, 0.0, 0.0))).any()
    assert not shifted(1.45, tasks_with(change_n=(1.9, 0.0, 0.0))).any()


def test_a_change_of_height_counts_where_a_vertical_separation_serves():
    tasks, stacked = tasks_with((0.0, 0.0, 60.0)), Separation(jnp.asarray(200.0), jnp.asarray(100.0))
    assert not shifted(1.0, tasks).any()
    assert shifted(1.0, tasks, stacked).any()
    assert not shifted(1.7, tasks, stacked).any()


def test_aircraft_that_have_arrived_or_stopped_do_not_count():
    far = (0.0, 1000.0, 0.0)
    assert not shifted(1.0, tasks_with(far, active=(1.0, 0.0, 1.0))).any()
    assert shifted(1.0, tasks_with(far))[1].any()
    assert not shifted(1.0, tasks_with(far), now=95.0)[1].any()
    # without a required separation every ratio is infinite
    assert not shifted(np.inf, tasks_with(far), Separation(jnp.asarray(0.0), jnp.asarray(0.0))).any()


@pytest.mark.parametrize("axis", [0, 1])
def test_a_shift_within_the_uncertainty_of_the_goals_does_not_count(axis):
    offset = np.zeros(3)
    offset[axis] = 100.0
    for sigma, expected in (
        (100.0 / SIGNIFICANT_DEVIATIONS * 1.01, False),
        (100.0 / SIGNIFICANT_DEVIATIONS * 0.99, True),
    ):
        # the variance of a pair's shift is the sum over both goals: all of it on the second one
        covariances = np.zeros((3, 6, 6))
        covariances[1, axis, axis] = sigma**2
        assert shifted(1.0, tasks_with(offset), covariances=jnp.asarray(covariances)).any() == expected
    # uncertain velocities are extrapolated to the arrival, here over 50 s
    covariances = np.zeros((3, 6, 6))
    covariances[:, 3 + axis, 3 + axis] = 1.0
    assert not shifted(1.0, tasks_with(offset), covariances=jnp.asarray(covariances)).any()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-400.0, 400.0), min_size=6, max_size=6))
def test_the_ratio_of_a_pair_falls_by_at_most_the_ratio_of_the_shift(values):
    distance_n, shift_n = np.array(values[:3]), np.array(values[3:])

    def ratio(offset_n):
        return float(
            separation_ratio(np.hypot(*offset_n[:2]), np.abs(offset_n[2]), np.float64(200.0), np.float64(100.0))
        )

    before, after, loss = ratio(distance_n), ratio(distance_n + shift_n), ratio(shift_n)
    assert after >= before - loss - 1e-12


def test_shifts_are_found_for_each_flight_of_a_batch_and_in_a_compiled_program():
    offsets = [(0.0, 0.0, 0.0), (0.0, 100.0, 0.0), (20.0, 0.0, 0.0)]
    positions = jnp.stack([tasks_with(offset).goal_position_n for offset in offsets])

    def shifts(goal_position_n):
        tasks = tasks_with()
        tasks.goal_position_n = goal_position_n
        return goals_have_shifted(holds_with(1.0), tasks, jnp.asarray(ARRIVALS), NOW_S, FLAT, None)

    batch = np.asarray(jax.jit(jax.vmap(shifts))(positions))
    for found, offset in zip(batch, offsets, strict=True):
        np.testing.assert_array_equal(found, shifted(1.0, tasks_with(offset)))
