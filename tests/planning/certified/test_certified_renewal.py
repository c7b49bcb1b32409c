"""Renewing a certified plan: where an aircraft has stopped, and where a goal is known with an error only."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.environment import SteadyWind
from anser.planning import TimedPath
from anser.planning.certified.certified_plan import CertifiedPlan, certify
from anser.planning.certified.profile import KINKS
from anser.planning.certified.replanning import (
    AWAITING_GOAL,
    CORRECTED,
    CORRECTION_FRACTIONS,
    PARTLY_CORRECTED,
    REPLANNED,
    UNCHANGED,
    arrival_delays,
    rendezvous_has_moved,
    replan_certified,
)
from anser.planning.certified.routes import PIECES
from anser.planning.certified.task import stack_tasks
from support.aircraft_tasks import aircraft_task, airspace

pytestmark = pytest.mark.long


INTERVALS, NOW, ARRIVAL = 64, 10.0, 110.0
YES = jnp.asarray(True)
SPACE = airspace(SteadyWind(jnp.zeros(3)), 500.0, 150.0)
# North at 150 m/s, side by side; the third flies 100 m beside the first, and at less than its least airspeed.
EAST = (0.0, 4000.0, 100.0)
SPEEDS = (150.0, 150.0, 120.0)
_renew = compiled_quickly(replan_certified)
_certify = compiled_quickly(lambda paths, fleet: certify(paths, fleet, SPACE, INTERVALS))


def straight(east, speed):
    times = jnp.linspace(0.0, ARRIVAL, INTERVALS + 1 + PIECES - 1 + KINKS)
    air = jnp.zeros((times.size, 3, 3)).at[:, 1, 0].set(speed)
    air = air.at[:, 0].set(jnp.array([[0.0, east, -2000.0]]) + times[:, None] * jnp.array([[speed, 0.0, 0.0]]))
    return TimedPath(times, air, jnp.zeros_like(air))


def fleet(active=(1.0, 1.0, 1.0), nearer=0.0):
    """As seen at `NOW`; the first's rendezvous is nearer by so much than its plan has it."""
    made = []
    for k, (east, speed) in enumerate(zip(EAST, SPEEDS, strict=True)):
        one = aircraft_task((ARRIVAL * speed - (nearer if k == 0 else 0.0), east, -1700.0))
        made.append(eqx.tree_at(lambda t: t.limits.speed_min, one, jnp.asarray(140.0)))
    return eqx.tree_at(lambda t: t.active, stack_tasks(made), jnp.array(active))


@pytest.fixture(scope="module")
def plan():
    paths = jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(straight, EAST, SPEEDS))
    certificate = _certify(paths, fleet())
    speeds = jnp.array(SPEEDS)
    return CertifiedPlan(
        paths, jnp.full(3, ARRIVAL), certificate, jnp.ones(3, dtype=bool), ARRIVAL * speeds, 0.0 * speeds, speeds
    )


def renewed(plan, tasks, arrival_is_free=YES, covariances=None, now=NOW):
    numbers = jnp.asarray(2.0), jnp.asarray(jnp.inf)
    made = _renew(plan, jnp.asarray(now), tasks, SPACE, arrival_is_free, *numbers, covariances=covariances)
    return made.plan, int(made.status)


def check_row(one, other, k, flown=0.0):
    """One aircraft's part of two plans, their certificates aside; the other had `flown` metres more before it."""
    parts = [(p.paths, p.arrival_times, p.total_turn, p.speeds) for p in (one, other)]
    for a, b in zip(*map(jax.tree.leaves, parts), strict=True):
        np.testing.assert_array_equal(a[k], b[k])
    np.testing.assert_allclose(one.lengths[k], other.lengths[k] - flown, atol=1e-6)


STOPPED = (1.0, 1.0, 0.0)


def test_one_that_flies_on_in_the_way_and_below_its_least_speed_is_no_good_plan(plan):
    assert plan.certificate.clearance_ratio[0, 2] < 1.0
    assert not plan.certificate.satisfied_individually[2]
    assert renewed(plan, fleet())[1] == UNCHANGED


def test_once_it_has_stopped_the_plan_of_the_others_goes_on(plan):
    again, how = renewed(plan, fleet(STOPPED))
    assert how == CORRECTED
    for k, flown in enumerate((NOW * SPEEDS[0], NOW * SPEEDS[1], 0.0)):  # who has stopped has no way left to count
        check_row(again, plan, k, flown)
    assert np.all(again.feasible[:2])


def test_and_is_made_anew_without_it(plan):
    again, how = renewed(plan, fleet(STOPPED, nearer=1500.0))
    assert how == REPLANNED
    assert np.all(again.feasible[:2])
    end = again.paths.air_n[0, -1, 0] + again.paths.drift_n[0, -1, 0]
    np.testing.assert_allclose(end, [ARRIVAL * 150.0 - 1500.0, 0.0, -2000.0], atol=1e-3)
    check_row(again, plan, 2)
    # Wherever it is and whatever its path: even one that is none.
    gone = eqx.tree_at(lambda p: p.paths.air_n, plan, plan.paths.air_n.at[2].set(jnp.nan))
    same, how = renewed(gone, fleet(STOPPED, nearer=1500.0))
    assert how == REPLANNED
    for k in (0, 1):
        check_row(again, same, k)


def test_a_renewal_without_replanning_says_where_one_is_due(plan):
    light = compiled_quickly(functools.partial(replan_certified, allow_replanning=False))
    for tasks, due in ((fleet(STOPPED), False), (fleet(STOPPED, nearer=1500.0), True), (fleet(), True)):
        more = (jnp.asarray(NOW), tasks, SPACE, YES, jnp.asarray(2.0), jnp.asarray(jnp.inf))
        kept, full = light(plan, *more), _renew(plan, *more)
        assert kept.replan_needed == due
        assert not full.replan_needed
        assert (int(full.status) == CORRECTED) != due
        if not due:
            for one, other in zip(jax.tree.leaves(kept.plan), jax.tree.leaves(full.plan), strict=True):
                np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-6)


def test_where_all_have_stopped_the_plan_stands(plan):
    for nearer in (0.0, 1500.0):
        again, how = renewed(plan, fleet((0.0, 0.0, 0.0), nearer))
        assert how == CORRECTED
        for k in range(3):
            check_row(again, plan, k)


def test_one_that_has_stopped_neither_lengthens_nor_forbids_a_delay():
    times, free = jnp.array([200.0, 200.0, -jnp.inf]), jnp.array([True, True, True])
    delays, tries = arrival_delays(times, 100.0, free, YES, 210.0)
    np.testing.assert_allclose(delays, [0.0, 3.0, 8.0, 15.0], atol=1e-12)
    assert tries == 3
    delays, tries = arrival_delays(jnp.full(3, -jnp.inf), 100.0, free, YES, 210.0)
    np.testing.assert_array_equal(delays, 0.0)
    assert tries == 4


def known_to(speed_sigma):
    """Of each goal, where only its velocity is uncertain; m/s per axis."""
    return jnp.broadcast_to(jnp.diag(jnp.array([0.0, 0.0, 0.0, *[speed_sigma**2] * 3])), (3, 6, 6))


def test_no_plan_is_made_anew_for_what_may_be_noise(plan):
    """1,500 m nearer, in 100 s: 15 m/s, which is 2.9 standard deviations of 5.2 m/s and 3.1 of 4.8 m/s."""
    tasks = fleet(STOPPED, nearer=1500.0)
    again, how = renewed(plan, tasks, covariances=known_to(5.2))
    assert how == AWAITING_GOAL
    for k in (0, 1):
        check_row(again, plan, k, NOW * SPEEDS[k])
    assert np.all(again.feasible[:2])
    surely, exactly = (renewed(plan, tasks, covariances=known)[0] for known in (known_to(4.8), None))
    assert renewed(plan, tasks, covariances=known_to(4.8))[1] == REPLANNED
    for k in (0, 1):
        check_row(surely, exactly, k)


def test_a_path_is_bent_by_any_amount_that_keeps_its_limits_while_another_waits(plan):
    tasks = fleet(STOPPED, nearer=1500.0)
    tasks = eqx.tree_at(lambda t: t.goal_position_n, tasks, tasks.goal_position_n.at[1, 1].add(10.0))
    again, how = renewed(plan, tasks, covariances=known_to(5.2))
    assert how == AWAITING_GOAL
    check_row(again, plan, 0, NOW * SPEEDS[0])
    end = again.paths.air_n[1, -1, 0] + again.paths.drift_n[1, -1, 0]
    np.testing.assert_allclose(end, [ARRIVAL * 150.0, EAST[1] + 10.0, -2000.0], atol=1e-3)


def test_where_none_is_found_each_path_is_bent_as_far_as_its_limits_allow(plan):
    """With 12 s to go nobody is planned anew: the first can brake for a part of what it is too late, the second for all."""
    tasks = fleet(STOPPED, nearer=120.0)
    tasks = eqx.tree_at(lambda t: t.goal_position_n, tasks, tasks.goal_position_n.at[1, 1].add(10.0))
    again, how = renewed(plan, tasks, now=ARRIVAL - 12.0)
    assert how == PARTLY_CORRECTED
    ends = again.paths.air_n[:, -1, 0] + again.paths.drift_n[:, -1, 0]
    np.testing.assert_allclose(ends[1], [ARRIVAL * 150.0, EAST[1] + 10.0, -2000.0], atol=1e-3)
    nearer = (ARRIVAL * 150.0 - ends[0, 0]) / 120.0
    part = min(CORRECTION_FRACTIONS, key=lambda part: abs(part - nearer))
    assert part < 1.0
    np.testing.assert_allclose(nearer, part, atol=1e-6)
    assert np.all(again.feasible[:2])
    check_row(again, plan, 2)


def test_a_path_that_no_part_of_the_bend_suits_stands(plan):
    again, how = renewed(plan, fleet(STOPPED, nearer=3000.0), now=ARRIVAL - 12.0)
    assert how == UNCHANGED
    for k in range(3):
        check_row(again, plan, k)


def test_how_sure_it_is_counts_along_the_way_to_the_other_place(plan):
    path, task = (jax.tree.map(lambda leaf: leaf[0], rows) for rows in (plan.paths, fleet(nearer=50.0)))
    across = jnp.diag(jnp.array([1.0, 1e6, 1e6, 0.0, 1e4, 1e4]))
    assert rendezvous_has_moved(path, task, across, 100.0)
    assert not rendezvous_has_moved(path, task, across.at[0, 0].set(17.0**2), 100.0)
    assert rendezvous_has_moved(path, task, across.at[0, 0].set(16.0**2), 100.0)
    # place and velocity that are wrong against each other
    assert rendezvous_has_moved(
        path, task, across.at[0, 0].set(30.0**2).at[3, 3].set(0.09).at[0, 3].set(-9.0).at[3, 0].set(-9.0), 100.0
    )
    exact = fleet()
    same = jax.tree.map(lambda leaf: leaf[0], exact)
    assert not rendezvous_has_moved(path, same, jnp.zeros((6, 6)), 100.0)
    for find in (
        jax.jit(rendezvous_has_moved),
        lambda *a: jax.vmap(rendezvous_has_moved, in_axes=(None, None, 0, None))(a[0], a[1], a[2][None], a[3])[0],
    ):
        assert find(path, task, across, 100.0)
