"""Splines: arrivals in cases beyond the other generators, verified by the independent dense check."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.arrival_times import reachable
from anser.planning.certified.spline_search import find_splines
from anser.planning.certified.timed_profiles import ALONE_SPLINES, ALONE_STANDARD, ALONE_TURN_LEG_PATHS
from support.certified_cases import number, picked
from trials.cases import random_case
from trials.check import dense_check
from trials.data import Paths
from trials.task import planner_task

pytestmark = pytest.mark.long


INTERVALS, STARTS, KEPT = 128, 32, 6
# Of the random cases: an aircraft, and a time at which it was said to have no way, though it has: a descent at nearly
# the greatest rate; a turn that needs the least airspeed at full bank; keep-outs.
HARD = ((90, 3, 192.5), (198, 7, 90.9), (104, 0, 87.9))

find = compiled_quickly(lambda one, airspace, t: find_splines(one, airspace, t, INTERVALS, STARTS, KEPT))


def task_of(seed, index):
    tasks, airspace, _ = planner_task(random_case(seed))
    return picked(tasks, index), airspace


@pytest.fixture(scope="module")
def hard():
    return [(seed, index, t, find(*task_of(seed, index), number(t))) for seed, index, t in HARD]


def test_hard_cases_have_splines_that_pass_a_dense_check(hard):
    for seed, index, t, splines in hard:
        valid = np.flatnonzero(np.asarray(splines.valid))
        assert valid.size > 0, (seed, index)
        case = random_case(seed)
        # As if all flew it: only the one is looked at.
        k = int(valid[0])
        times, air, drift = (
            np.asarray(leaf[k]) for leaf in (splines.paths.times, splines.paths.air_n, splines.paths.drift_n)
        )
        repeated = [np.repeat(leaf[None], case.size, axis=0) for leaf in (times, air, drift)]
        report = dense_check(Paths(*repeated), case, np.full(case.size, t))
        for limit, values in report.excess.items():
            assert values[index] <= 0.0, (seed, limit)
        assert report.arrival_miss[index] <= 1e-3


def test_other_generators_fail_in_the_hard_cases():
    for seed, index, t in HARD[:2]:
        tasks, airspace, _ = planner_task(random_case(seed))
        arguments = (tasks, airspace, np.array([index]), np.array([t]))
        assert not reachable(*arguments, levels=(ALONE_STANDARD, ALONE_TURN_LEG_PATHS))[0]
        assert reachable(*arguments, levels=(ALONE_SPLINES,))[0]


def test_splines_start_at_the_aircraft_and_end_as_prescribed():
    task, airspace = task_of(34, 1)  # course and path angle prescribed
    splines = find(task, airspace, number(380.0))
    assert np.any(splines.valid)
    path = picked(splines.paths, int(np.flatnonzero(np.asarray(splines.valid))[0]))
    np.testing.assert_allclose(path.air_n[0, 0], task.position_n, atol=1e-9)
    np.testing.assert_allclose(path.air_n[0, 1], task.air_velocity_n, atol=1e-9)
    np.testing.assert_allclose(path.air_n[0, 2], task.air_acceleration_n, atol=1e-9)
    north, east, down = np.asarray(path.velocity_n(380.0))
    assert np.arctan2(east, north) == pytest.approx(float(task.rendezvous.course), abs=1e-6)
    assert np.arctan2(-down, np.hypot(north, east)) == pytest.approx(float(task.rendezvous.path_angle), abs=1e-6)


def test_an_initial_turn_continues_smoothly():
    task, airspace = task_of(90, 0)
    direction = task.air_velocity_n / jnp.linalg.norm(task.air_velocity_n)
    turn_n = jnp.array([-direction[1], direction[0], 0.0]) * 1.5
    turning = eqx.tree_at(lambda t: t.air_acceleration_n, task, turn_n)
    splines = find(turning, airspace, number(230.0))
    assert np.any(splines.valid)
    np.testing.assert_allclose(splines.paths.air_n[0, 0, 2], turn_n, atol=1e-9)


def test_no_spline_is_valid_with_a_prescribed_side():
    task, airspace = task_of(90, 0)
    splines = find(eqx.tree_at(lambda t: t.side, task, jnp.asarray(1)), airspace, number(230.0))
    assert not np.any(splines.valid)


def test_no_spline_is_valid_in_an_impossible_case():
    task, airspace = task_of(90, 3)
    splines = find(task, airspace, number(150.0))  # 3 km down in 150 s at 16.6 m/s
    assert not np.any(splines.valid)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(splines.paths))


def test_infinite_limits_are_no_limits():
    task, airspace = task_of(90, 0)
    unlimited = eqx.tree_at(
        lambda t: (t.limits.speed_max, t.limits.load_factor_max, t.limits.acceleration_max, t.limits.altitude_max),
        task,
        (number(np.inf),) * 4,
    )
    splines = find(unlimited, airspace, number(230.0))
    assert np.any(splines.valid)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(splines.paths))
