"""Splines: they arrive and keep everything where nothing else does, seen by another's dense check."""

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

found_by = compiled_quickly(lambda one, airspace, t: find_splines(one, airspace, t, INTERVALS, STARTS, KEPT))


def task_of(seed, who):
    tasks, airspace, _ = planner_task(random_case(seed))
    return picked(tasks, who), airspace


@pytest.fixture(scope="module")
def hard():
    return [(seed, who, t, found_by(*task_of(seed, who), number(t))) for seed, who, t in HARD]


def test_there_are_some_and_they_pass_a_dense_check(hard):
    for seed, who, t, found in hard:
        valid = np.flatnonzero(np.asarray(found.valid))
        assert valid.size > 0, (seed, who)
        case = random_case(seed)
        # As if all flew it: only the one is looked at.
        k = int(valid[0])
        times, air, drift = (
            np.asarray(leaf[k]) for leaf in (found.paths.times, found.paths.air_n, found.paths.drift_n)
        )
        every = [np.repeat(leaf[None], case.size, axis=0) for leaf in (times, air, drift)]
        report = dense_check(Paths(*every), case, np.full(case.size, t))
        for limit, values in report.excess.items():
            assert values[who] <= 0.0, (seed, limit)
        assert report.arrival_miss[who] <= 1e-3


def test_nothing_else_finds_a_way_at_those_times():
    for seed, who, t in HARD[:2]:
        tasks, airspace, _ = planner_task(random_case(seed))
        asked = (tasks, airspace, np.array([who]), np.array([t]))
        assert not reachable(*asked, levels=(ALONE_STANDARD, ALONE_TURN_LEG_PATHS))[0]
        assert reachable(*asked, levels=(ALONE_SPLINES,))[0]


def test_begins_as_the_aircraft_does_and_ends_as_prescribed():
    one, airspace = task_of(34, 1)  # course and path angle prescribed
    found = found_by(one, airspace, number(380.0))
    assert np.any(found.valid)
    path = picked(found.paths, int(np.flatnonzero(np.asarray(found.valid))[0]))
    np.testing.assert_allclose(path.air_n[0, 0], one.position_n, atol=1e-9)
    np.testing.assert_allclose(path.air_n[0, 1], one.air_velocity_n, atol=1e-9)
    np.testing.assert_allclose(path.air_n[0, 2], one.air_acceleration_n, atol=1e-9)
    north, east, down = np.asarray(path.velocity_n(380.0))
    assert np.arctan2(east, north) == pytest.approx(float(one.rendezvous.course), abs=1e-6)
    assert np.arctan2(-down, np.hypot(north, east)) == pytest.approx(float(one.rendezvous.path_angle), abs=1e-6)


def test_a_turn_under_way_goes_on_without_a_jump():
    one, airspace = task_of(90, 0)
    ahead = one.air_velocity_n / jnp.linalg.norm(one.air_velocity_n)
    turn_n = jnp.array([-ahead[1], ahead[0], 0.0]) * 1.5
    turning = eqx.tree_at(lambda t: t.air_acceleration_n, one, turn_n)
    found = found_by(turning, airspace, number(230.0))
    assert np.any(found.valid)
    np.testing.assert_allclose(found.paths.air_n[0, 0, 2], turn_n, atol=1e-9)


def test_none_where_a_side_is_prescribed():
    one, airspace = task_of(90, 0)
    found = found_by(eqx.tree_at(lambda t: t.side, one, jnp.asarray(1)), airspace, number(230.0))
    assert not np.any(found.valid)


def test_nothing_valid_where_none_can_be():
    one, airspace = task_of(90, 3)
    found = found_by(one, airspace, number(150.0))  # 3 km down in 150 s at 16.6 m/s
    assert not np.any(found.valid)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(found.paths))


def test_limits_that_do_not_exist_are_no_limits():
    one, airspace = task_of(90, 0)
    free = eqx.tree_at(
        lambda t: (t.limits.speed_max, t.limits.load_factor_max, t.limits.acceleration_max, t.limits.altitude_max),
        one,
        (number(np.inf),) * 4,
    )
    found = found_by(free, airspace, number(230.0))
    assert np.any(found.valid)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(found.paths))
