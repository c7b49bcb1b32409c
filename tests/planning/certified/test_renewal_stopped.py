"""Renewing a certified plan while an aircraft has stopped: the others neither keep clear of it nor wait for it."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling import compiled_quickly
from anser.environment import SteadyWind
from anser.planning.certified import CertifiedPlan
from anser.planning.certified.certified_plan import certify
from anser.planning.certified.profile import KINKS
from anser.planning.certified.renewal import CORRECTED, KEPT, REPLANNED, postponements, renew_certified
from anser.planning.certified.route import PIECES
from anser.planning.certified.task import stacked
from anser.planning.timed_path import TimedPath
from support.aircraft_tasks import aircraft_task, airspace

pytestmark = pytest.mark.long


INTERVALS, NOW, ARRIVAL = 64, 10.0, 110.0
YES = jnp.asarray(True)
SPACE = airspace(SteadyWind(jnp.zeros(3)), 500.0, 150.0)
# North at 150 m/s, side by side; the third flies 100 m beside the first, and at less than its least airspeed.
EAST = (0.0, 4000.0, 100.0)
SPEEDS = (150.0, 150.0, 120.0)
_renew = compiled_quickly(renew_certified)
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
    return eqx.tree_at(lambda t: t.active, stacked(made), jnp.array(active))


@pytest.fixture(scope="module")
def plan():
    paths = jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(straight, EAST, SPEEDS))
    certificate = _certify(paths, fleet())
    speeds = jnp.array(SPEEDS)
    return CertifiedPlan(
        paths, jnp.full(3, ARRIVAL), certificate, jnp.ones(3, dtype=bool), ARRIVAL * speeds, 0.0 * speeds, speeds
    )


def renewed(plan, tasks, movable=YES):
    made = _renew(plan, jnp.asarray(NOW), tasks, SPACE, movable, jnp.asarray(2.0), jnp.asarray(jnp.inf))
    return made.plan, int(made.how)


def check_row(one, other, k, flown=0.0):
    """One aircraft's part of two plans, their certificates aside; the other had `flown` metres more before it."""
    parts = [(p.paths, p.arrival_times, p.turned, p.speeds) for p in (one, other)]
    for a, b in zip(*map(jax.tree.leaves, parts), strict=True):
        np.testing.assert_array_equal(a[k], b[k])
    np.testing.assert_allclose(one.lengths[k], other.lengths[k] - flown, atol=1e-6)


STOPPED = (1.0, 1.0, 0.0)


def test_one_that_flies_on_in_the_way_and_below_its_least_speed_is_no_good_plan(plan):
    assert plan.certificate.clearance_ratio[0, 2] < 1.0
    assert not plan.certificate.kept_alone[2]
    assert renewed(plan, fleet())[1] == KEPT


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
    light = compiled_quickly(functools.partial(renew_certified, replans=False))
    for tasks, due in ((fleet(STOPPED), False), (fleet(STOPPED, nearer=1500.0), True), (fleet(), True)):
        more = (jnp.asarray(NOW), tasks, SPACE, YES, jnp.asarray(2.0), jnp.asarray(jnp.inf))
        kept, full = light(plan, *more), _renew(plan, *more)
        assert kept.asked == due
        assert not full.asked
        assert (int(full.how) == CORRECTED) != due
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
    delays, tries = postponements(times, 100.0, free, YES, 210.0)
    np.testing.assert_allclose(delays, [0.0, 3.0, 8.0, 15.0], atol=1e-12)
    assert tries == 3
    delays, tries = postponements(jnp.full(3, -jnp.inf), 100.0, free, YES, 210.0)
    np.testing.assert_array_equal(delays, 0.0)
    assert tries == 4
