"""Replanning of a certified plan with stopped aircraft and with uncertain goals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.environment import SteadyWind
from anser.numerics.arrays import stack_rows
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
    PlanInFlight,
    arrival_delays,
    correct_or_replace_plan,
    correct_plan,
    rendezvous_has_moved,
)
from anser.planning.certified.routes import PIECES
from support.aircraft_tasks import aircraft_task, airspace

pytestmark = pytest.mark.long


INTERVALS, NOW, ARRIVAL = 64, 10.0, 110.0
YES = jnp.asarray(True)
SPACE = airspace(SteadyWind(jnp.zeros(3)), 500.0, 150.0)
# North at 150 m/s, side by side; the third flies 100 m beside the first, and at less than its least airspeed.
EAST = (0.0, 4000.0, 100.0)
SPEEDS = (150.0, 150.0, 120.0)
_correct = compiled_quickly(correct_plan)
_certify = compiled_quickly(lambda paths, fleet: certify(paths, fleet, SPACE, INTERVALS))


def straight(east, speed):
    times = jnp.linspace(0.0, ARRIVAL, INTERVALS + 1 + PIECES - 1 + KINKS)
    air = jnp.zeros((times.size, 3, 3)).at[:, 1, 0].set(speed)
    air = air.at[:, 0].set(jnp.array([[0.0, east, -2000.0]]) + times[:, None] * jnp.array([[speed, 0.0, 0.0]]))
    return TimedPath(times, air, jnp.zeros_like(air))


def fleet(active=(1.0, 1.0, 1.0), nearer=0.0):
    """State at `NOW`; the first rendezvous is `nearer` metres closer than planned."""
    tasks = []
    for k, (east, speed) in enumerate(zip(EAST, SPEEDS, strict=True)):
        task = aircraft_task((ARRIVAL * speed - (nearer if k == 0 else 0.0), east, -1700.0))
        tasks.append(eqx.tree_at(lambda t: t.limits.speed_min, task, jnp.asarray(140.0)))
    return eqx.tree_at(lambda t: t.active, stack_rows(tasks), jnp.array(active))


@pytest.fixture(scope="module")
def plan():
    paths = jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(straight, EAST, SPEEDS))
    certificate = _certify(paths, fleet())
    speeds = jnp.array(SPEEDS)
    return CertifiedPlan(
        paths, jnp.full(3, ARRIVAL), certificate, jnp.ones(3, dtype=bool), ARRIVAL * speeds, 0.0 * speeds, speeds
    )


def replan(plan, tasks, arrival_is_free=YES, covariances=None, time=NOW, has_left=(False, False, False)):
    """Replanned between two steps; a compiled loop makes the same plan, or reports that another one is needed."""
    in_flight = PlanInFlight(
        *(plan, jnp.asarray(time), tasks, SPACE, jnp.asarray(2.0), covariances, None),
        *(jnp.array(has_left), arrival_is_free, jnp.asarray(jnp.inf)),
    )
    new_plan, status = correct_or_replace_plan(in_flight)
    corrected, corrected_status, is_feasible = _correct(in_flight)
    assert is_feasible == (status in (CORRECTED, AWAITING_GOAL))
    if is_feasible:
        assert status == int(corrected_status)
        for leaf, reference in zip(jax.tree.leaves(new_plan), jax.tree.leaves(corrected), strict=True):
            np.testing.assert_allclose(leaf, reference, rtol=1e-9, atol=1e-6)
    return new_plan, status


def check_row(plan, reference, k, flown=0.0):
    """Compare one aircraft's part of two plans, without certificates; the reference path is `flown` metres longer."""
    parts = [(p.paths, p.arrival_times, p.total_turn, p.speeds) for p in (plan, reference)]
    for a, b in zip(*map(jax.tree.leaves, parts), strict=True):
        np.testing.assert_array_equal(a[k], b[k])
    np.testing.assert_allclose(plan.lengths[k], reference.lengths[k] - flown, atol=1e-6)


STOPPED = (1.0, 1.0, 0.0)


def test_a_plan_with_an_obstructing_and_too_slow_aircraft_is_infeasible(plan):
    assert plan.certificate.clearance_ratio[0, 2] < 1.0
    assert not plan.certificate.satisfied_individually[2]
    assert replan(plan, fleet())[1] == UNCHANGED


def test_the_other_aircraft_keep_their_plan_after_an_aircraft_stops(plan):
    new_plan, status = replan(plan, fleet(STOPPED))
    assert status == CORRECTED
    for k, flown in enumerate((NOW * SPEEDS[0], NOW * SPEEDS[1], 0.0)):  # who has stopped has no way left to count
        check_row(new_plan, plan, k, flown)
    assert np.all(new_plan.feasible[:2])


def test_a_new_plan_ignores_a_stopped_aircraft(plan):
    new_plan, status = replan(plan, fleet(STOPPED, nearer=1500.0))
    assert status == REPLANNED
    assert np.all(new_plan.feasible[:2])
    end = new_plan.paths.air_n[0, -1, 0] + new_plan.paths.drift_n[0, -1, 0]
    np.testing.assert_allclose(end, [ARRIVAL * 150.0 - 1500.0, 0.0, -2000.0], atol=1e-3)
    check_row(new_plan, plan, 2)
    # Wherever it is and whatever its path: even one that is none.
    invalid = eqx.tree_at(lambda p: p.paths.air_n, plan, plan.paths.air_n.at[2].set(jnp.nan))
    reference, status = replan(invalid, fleet(STOPPED, nearer=1500.0))
    assert status == REPLANNED
    for k in (0, 1):
        check_row(new_plan, reference, k)


def test_a_corrected_or_new_plan_avoids_an_aircraft_that_has_left_the_fleet(plan):
    """Its exit path crosses that of the first, where this would be at that time."""
    meeting_s, times = 60.0, plan.paths.times[2]
    crossing_n = jnp.array([[meeting_s * SPEEDS[0], 0.0, -2000.0]])
    air = jnp.zeros_like(plan.paths.air_n[2]).at[:, 1, 1].set(-SPEEDS[0])
    air = air.at[:, 0].set(crossing_n + (times - meeting_s)[:, None] * jnp.array([[0.0, -SPEEDS[0], 0.0]]))
    crossed = eqx.tree_at(lambda p: p.paths.air_n, plan, plan.paths.air_n.at[2].set(air))
    # The plan in force had no conflict: the exit path has come near only now.
    crossed = eqx.tree_at(lambda p: p.certificate.clearance_ratio, crossed, jnp.full((3, 3), 2.0))
    assert replan(crossed, fleet(STOPPED))[1] == CORRECTED
    new_plan, status = replan(crossed, fleet(STOPPED), has_left=(False, False, True))
    assert status == REPLANNED
    assert np.all(new_plan.feasible[:2])
    assert np.all(new_plan.certificate.clearance_ratio[:2, 2] >= 1.0)
    np.testing.assert_array_equal(new_plan.paths.air_n[2], air)
    np.testing.assert_array_equal(new_plan.arrival_times[2], plan.arrival_times[2])
    # A path that nothing crosses is corrected as before.
    clear = eqx.tree_at(lambda p: p.paths.air_n, crossed, crossed.paths.air_n.at[2, :, 0, 2].add(-1000.0))
    assert replan(clear, fleet(STOPPED), has_left=(False, False, True))[1] == CORRECTED


def test_a_conflict_with_an_exit_path_that_no_plan_resolved_does_not_stop_the_corrections(plan):
    """The third has left 100 m beside the first; the goal of the second, 4 km away, moves by 60 m."""
    moved = eqx.tree_at(lambda t: t.goal_position_n, fleet(STOPPED), fleet().goal_position_n.at[1, 1].add(60.0))
    assert plan.certificate.clearance_ratio[0, 2] < 1.0
    new_plan, status = replan(plan, moved, has_left=(False, False, True))
    assert status == CORRECTED
    end = new_plan.paths.air_n[1, -1, 0] + new_plan.paths.drift_n[1, -1, 0]
    np.testing.assert_allclose(end[1], 4060.0, atol=1e-3)
    # The conflict stays in the certificate.
    assert new_plan.certificate.clearance_ratio[0, 2] < 1.0
    # One that grows by much does: in force, the first path was almost clear of the exit path.
    almost_clear = plan.certificate.clearance_ratio.at[0, 2].set(0.96).at[2, 0].set(0.96)
    grown = eqx.tree_at(lambda p: p.certificate.clearance_ratio, plan, almost_clear)
    assert replan(grown, moved, has_left=(False, False, True))[1] != CORRECTED


def test_a_plan_stays_unchanged_after_every_aircraft_has_stopped(plan):
    for nearer in (0.0, 1500.0):
        new_plan, status = replan(plan, fleet((0.0, 0.0, 0.0), nearer))
        assert status == CORRECTED
        for k in range(3):
            check_row(new_plan, plan, k)


def test_a_stopped_aircraft_has_no_effect_on_delays():
    times, replannable = jnp.array([200.0, 200.0, -jnp.inf]), jnp.array([True, True, True])
    delays, tries = arrival_delays(times, 100.0, replannable, YES, 210.0)
    np.testing.assert_allclose(delays, [0.0, 3.0, 8.0, 15.0], atol=1e-12)
    assert tries == 3
    delays, tries = arrival_delays(jnp.full(3, -jnp.inf), 100.0, replannable, YES, 210.0)
    np.testing.assert_array_equal(delays, 0.0)
    assert tries == 4


def velocity_covariance(speed_sigma):
    """Covariance of each goal with an uncertain velocity only; standard deviation in m/s per axis."""
    return jnp.broadcast_to(jnp.diag(jnp.array([0.0, 0.0, 0.0, *[speed_sigma**2] * 3])), (3, 6, 6))


def test_a_shift_within_the_noise_causes_no_new_plan(plan):
    """A shift of 1,500 m in 100 s: 15 m/s, 2.9 standard deviations of 5.2 m/s and 3.1 of 4.8 m/s."""
    tasks = fleet(STOPPED, nearer=1500.0)
    new_plan, status = replan(plan, tasks, covariances=velocity_covariance(5.2))
    assert status == AWAITING_GOAL
    for k in (0, 1):
        check_row(new_plan, plan, k, NOW * SPEEDS[k])
    assert np.all(new_plan.feasible[:2])
    surely, exactly = (
        replan(plan, tasks, covariances=covariances)[0] for covariances in (velocity_covariance(4.8), None)
    )
    assert replan(plan, tasks, covariances=velocity_covariance(4.8))[1] == REPLANNED
    for k in (0, 1):
        check_row(surely, exactly, k)


def test_a_path_is_corrected_within_its_limits_while_another_waits(plan):
    tasks = fleet(STOPPED, nearer=1500.0)
    tasks = eqx.tree_at(lambda t: t.goal_position_n, tasks, tasks.goal_position_n.at[1, 1].add(10.0))
    new_plan, status = replan(plan, tasks, covariances=velocity_covariance(5.2))
    assert status == AWAITING_GOAL
    check_row(new_plan, plan, 0, NOW * SPEEDS[0])
    end = new_plan.paths.air_n[1, -1, 0] + new_plan.paths.drift_n[1, -1, 0]
    np.testing.assert_allclose(end, [ARRIVAL * 150.0, EAST[1] + 10.0, -2000.0], atol=1e-3)


def test_paths_are_corrected_as_far_as_limits_allow_without_a_new_plan(plan):
    """With 12 s to go no aircraft is replanned: the first path is partly corrected by braking, the second fully."""
    tasks = fleet(STOPPED, nearer=120.0)
    tasks = eqx.tree_at(lambda t: t.goal_position_n, tasks, tasks.goal_position_n.at[1, 1].add(10.0))
    new_plan, status = replan(plan, tasks, time=ARRIVAL - 12.0)
    assert status == PARTLY_CORRECTED
    end_points = new_plan.paths.air_n[:, -1, 0] + new_plan.paths.drift_n[:, -1, 0]
    np.testing.assert_allclose(end_points[1], [ARRIVAL * 150.0, EAST[1] + 10.0, -2000.0], atol=1e-3)
    nearer = (ARRIVAL * 150.0 - end_points[0, 0]) / 120.0
    part = min(CORRECTION_FRACTIONS, key=lambda part: abs(part - nearer))
    assert part < 1.0
    np.testing.assert_allclose(nearer, part, atol=1e-6)
    assert np.all(new_plan.feasible[:2])
    check_row(new_plan, plan, 2)


def test_a_path_without_a_feasible_correction_stays_unchanged(plan):
    new_plan, status = replan(plan, fleet(STOPPED, nearer=3000.0), time=ARRIVAL - 12.0)
    assert status == UNCHANGED
    for k in range(3):
        check_row(new_plan, plan, k)


def test_the_uncertainty_along_the_offset_decides(plan):
    path, task = (jax.tree.map(lambda leaf: leaf[0], stacked) for stacked in (plan.paths, fleet(nearer=50.0)))
    across = jnp.diag(jnp.array([1.0, 1e6, 1e6, 0.0, 1e4, 1e4]))
    assert rendezvous_has_moved(path, task, across, 100.0)
    assert not rendezvous_has_moved(path, task, across.at[0, 0].set(17.0**2), 100.0)
    assert rendezvous_has_moved(path, task, across.at[0, 0].set(16.0**2), 100.0)
    # place and velocity that are wrong against each other
    assert rendezvous_has_moved(
        path, task, across.at[0, 0].set(30.0**2).at[3, 3].set(0.09).at[0, 3].set(-9.0).at[3, 0].set(-9.0), 100.0
    )
    exact = fleet()
    unshifted = jax.tree.map(lambda leaf: leaf[0], exact)
    assert not rendezvous_has_moved(path, unshifted, jnp.zeros((6, 6)), 100.0)
    for find in (
        jax.jit(rendezvous_has_moved),
        lambda *a: jax.vmap(rendezvous_has_moved, in_axes=(None, None, 0, None))(a[0], a[1], a[2][None], a[3])[0],
    ):
        assert find(path, task, across, 100.0)
