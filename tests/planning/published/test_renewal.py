"""Renewing a plan on the way (theory section 8, "replanned online from the present state")."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.parts import make_rendezvous
from anser.planning.published.coordination import COMMITTED_S, PLANNED, replan
from support.planning_cases import (
    SPEED,
    along,
    in_wind,
    lengths_of,
    on_plan,
    plan_at,
    published_fleet,
    random_fleet,
    velocity,
)

RIGHT = jnp.ones(3)
WIND = [12.0, -20.0, 0.5]
_renew = jax.jit(replan)


def renewed(plan, time, tasks, even, sides=RIGHT):
    plan, asked = _renew(plan, jnp.asarray(time, dtype=float), tasks, sides, jnp.asarray(even))
    assert not asked
    return plan


@pytest.fixture(scope="module")
def flights():
    """Fleets with a plan each: the published one and generic ones; both laws; wind; room to exchange height or none."""
    planned = []
    for even, deceleration in ((False, 1.0), (True, 1.0), (True, 20.0)):
        for seed, wind in ((None, [0.0, 0.0, 0.0]), (None, WIND), (2, WIND), (8, WIND)):
            tasks = published_fleet() if seed is None else random_fleet(seed, 40.0)
            tasks = replace(in_wind(tasks, wind), deceleration=jnp.full(3, deceleration))
            planned.append((tasks, plan_at(100.0, tasks, jnp.array([1.0, -1.0, 1.0]), even), even))
    return planned


def foreseen(tasks, plan, fraction):
    """Time, and what the fleet knows then if all went as planned from 100 s on."""
    time = 100.0 + fraction * float(plan.arrival_time - 100.0)
    return time, on_plan(plan, tasks, time, time - 100.0)


def far_apart(one, other, start):
    """Greatest distance between two plans' positions from a time on, m."""
    times = np.linspace(start, float(one.arrival_time), 9)
    return max(float(jnp.max(jnp.abs(along(one.trajectories, t)[0] - along(other.trajectories, t)[0]))) for t in times)


def test_a_plan_renewed_on_its_own_path_is_the_same_plan(flights):
    traded = 0
    for tasks, plan, even in flights:
        assert np.all(plan.converged)
        law = plan.trajectories.law
        traded += even and bool(jnp.any((law.exchange > 0.0) & (law.exchange < 1.0)))
        # Four nodes per cell are exact to a micrometre where |dr/ds| stays above a third of its mean; the speeds of the
        # laws hang on it. The published law asks for no lengths.
        gentle = np.min(law.slopes, axis=1) > np.mean(law.slopes, axis=1) / 3.0
        tolerance = 1e-6 if not even or np.all(gentle) else 2e-2
        for fraction in (0.1, 0.4, 0.7):
            time, later = foreseen(tasks, plan, fraction)
            again = renewed(plan, time, later, even)
            assert again.arrival_time == plan.arrival_time
            np.testing.assert_array_equal(again.status, plan.status)
            assert far_apart(plan, again, time) < tolerance
    assert traded


def test_bent_paths_are_among_them(flights):
    bends = [plan.lateral_bends for _, plan, _ in flights]
    # One straight and two bent in each fleet, by up to more than the distance.
    assert all(jnp.sum(bend == 0.0) == 1 for bend in bends)
    assert max(float(jnp.max(jnp.abs(bend))) for bend in bends) > 1e4


@pytest.mark.long
@pytest.mark.parametrize("even", [False, True])
def test_renewing_every_second_does_not_drift(even):
    tasks = in_wind(published_fleet(), WIND)
    plan = first = plan_at(100.0, tasks, RIGHT, even)
    for elapsed in range(1, 50):
        # Positions by the plan in force, so that the smallest change would add up.
        time = 100.0 + elapsed
        plan = renewed(plan, time, on_plan(first, tasks, time, elapsed), even)
    assert plan.arrival_time == first.arrival_time
    # Fifty times the micrometre of one renewal.
    assert far_apart(first, plan, 149.0) < 5e-5


def test_prescribed_arrivals_are_kept():
    how = make_rendezvous(jnp.array([0.0, 0.0, -300.0]), 0.4, -0.02)
    tasks = replace(
        in_wind(published_fleet(), WIND),
        rendezvous=jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), how),
        deceleration=jnp.full(3, 0.5),
    )
    plan = plan_at(100.0, tasks, RIGHT, True)
    # The descent asks for more than the fleet's speed here, which the crab angle hangs on.
    steep = replace(tasks, position_n=tasks.position_n.at[:, 2].add(-1000.0))
    steep = replace(steep, origin_n=steep.position_n)
    fast = plan_at(100.0, steep, RIGHT, True)
    assert fast.speed > SPEED + 1.0
    for case, before in ((tasks, plan), (steep, fast)):
        time, later = foreseen(case, before, 0.5)
        again = renewed(before, time, later, True)
        assert again.arrival_time == before.arrival_time
        ends = [along(x.trajectories, before.arrival_time)[1] for x in (before, again)]
        np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)


def test_the_rendezvous_follows_the_goal_in_a_plain_renewal(flights):
    for tasks, plan, even in flights:
        time, later = foreseen(tasks, plan, 0.6)
        # A little faster than foreseen, and seen a little aside: not enough to plan anew.
        moved = replace(
            later,
            goal_velocity_n=later.goal_velocity_n + jnp.array([[0.3, -0.2, 0.0]]),
            goal_position_n=later.goal_position_n + jnp.array([[2.0, 3.0, 0.0]]),
        )
        again = renewed(plan, time, moved, even)
        assert again.arrival_time == plan.arrival_time
        there = along(again.trajectories, again.arrival_time)[0]
        left = float(plan.arrival_time) - time
        goals = moved.goal_position_n + moved.goal_velocity_n * left + moved.rendezvous.stand_off_n
        # The end of the last cell, to rounding of the time.
        np.testing.assert_allclose(there, goals, atol=1e-6)
        np.testing.assert_allclose(along(again.trajectories, time)[0], later.position_n, atol=1e-6)
        # Flown on from there at the planned velocity, whatever the aircraft's own.
        np.testing.assert_allclose(along(again.trajectories, time)[1], along(plan.trajectories, time)[1], atol=1e-6)


def swerve(tasks):
    """The goal of the farthest of the published fleet turns away from it at 60 m/s."""
    return replace(tasks, goal_velocity_n=tasks.goal_velocity_n.at[0].set(velocity(60.0, -1.5)))


@pytest.mark.parametrize("even", [False, True])
def test_a_goal_that_swerves_far_out_is_planned_for_anew(even):
    tasks = replace(published_fleet(), deceleration=jnp.full(3, 4.0))
    plan = plan_at(100.0, tasks, RIGHT, even)
    time, later = foreseen(tasks, plan, 0.4)
    again = renewed(plan, time, swerve(later), even)
    assert np.all(again.status == PLANNED)
    # 36 s at up to 60 m/s away: some seconds more at 150 m/s.
    assert again.arrival_time > plan.arrival_time + 5.0
    left = again.arrival_time - time
    np.testing.assert_allclose(again.trajectories.duration, left, rtol=1e-12)
    # All fly the fleet's mean speed over their whole flight.
    np.testing.assert_allclose(
        lengths_of(again.trajectories), again.speed * left + later.path_length_deficit, atol=1e-5
    )
    goals = swerve(later).goal_position_n + swerve(later).goal_velocity_n * left + later.rendezvous.stand_off_n
    np.testing.assert_allclose(along(again.trajectories, again.arrival_time)[0], goals, atol=1e-6)
    # It is just what the fleet would plan from there.
    anew = plan_at(time, swerve(later), RIGHT, even)
    np.testing.assert_allclose(again.arrival_time, anew.arrival_time, rtol=1e-12)
    np.testing.assert_allclose(again.lateral_bends, anew.lateral_bends, rtol=1e-9, atol=1e-6)


def test_a_renewal_without_replanning_says_where_one_is_due(flights):
    kept = jax.jit(lambda *given: replan(*given, allow_replanning=False))
    for tasks, plan, even in flights:
        time, later = foreseen(tasks, plan, 0.4)
        for case, due in ((later, False), (swerve(later), True)):
            full = renewed(plan, time, case, even)
            light, asked = kept(plan, jnp.asarray(time), case, RIGHT, jnp.asarray(even))
            assert asked == due
            assert light.arrival_time == plan.arrival_time
            assert (full.arrival_time == plan.arrival_time) != due
            if not due:
                for one, other in zip(jax.tree.leaves(light), jax.tree.leaves(full), strict=True):
                    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("even", [False, True])
def test_within_the_last_15_seconds_the_arrival_time_stands(even):
    tasks = published_fleet()
    plan = plan_at(100.0, tasks, RIGHT, even)
    for left, kept in ((COMMITTED_S + 1.0, False), (COMMITTED_S - 1.0, True), (0.5, True)):
        time = float(plan.arrival_time) - left
        later = swerve(on_plan(plan, tasks, time, time - 100.0))
        again = renewed(plan, time, later, even)
        assert (again.arrival_time == plan.arrival_time) == kept
        # Either way the paths end where the goals will be.
        goals = later.goal_position_n + later.goal_velocity_n * (again.arrival_time - time)
        np.testing.assert_allclose(
            along(again.trajectories, again.arrival_time)[0], goals + later.rendezvous.stand_off_n, atol=1e-6
        )


def test_a_fleet_that_is_too_fast_on_its_way_down_is_not_told_to_be_faster():
    # Down steep paths, engines idle, at more than the planned speed: no slower mean is possible on what is left. Raised
    # to that, again and again, the plan once ran away from 157 to 250 m/s.
    high = random_fleet(2, 40.0)
    down = jnp.array([[0.0, 0.0, 1.0]])
    high = replace(high, position_n=high.position_n - 1500.0 * down, deceleration=jnp.full(3, 0.4))
    plan = plan_at(100.0, high, RIGHT, True)
    time, later = foreseen(high, plan, 0.6)
    faster = replace(
        later,
        air_velocity_n=1.1 * later.air_velocity_n,
        path_length_deficit=later.path_length_deficit - 0.02 * plan.lengths,
    )
    again = renewed(plan, time, faster, True)
    assert again.speed == plan.speed
    assert again.arrival_time > plan.arrival_time - 0.5
    assert plan_at(time, faster, RIGHT, True).speed > 1.02 * plan.speed


@pytest.mark.long
def test_a_plan_that_failed_is_made_anew():
    tasks = published_fleet()
    fleeing = replace(tasks, goal_velocity_n=tasks.goal_velocity_n.at[1].set(velocity(170.0, 0.8)))
    plan = plan_at(100.0, fleeing, RIGHT)
    assert not plan.converged[1]
    time, later = foreseen(fleeing, plan, 0.1)
    # The goal has come to rest.
    again = renewed(plan, time, replace(later, goal_velocity_n=tasks.goal_velocity_n), False)
    assert np.all(again.status == PLANNED)


def test_finite_at_and_after_the_arrival():
    tasks = in_wind(published_fleet(), WIND)
    for even in (False, True):
        plan = plan_at(100.0, tasks, RIGHT, even)
        for late in (0.0, 7.0):
            time = float(plan.arrival_time) + late
            again = renewed(plan, time, on_plan(plan, tasks, time, time - 100.0), even)
            assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(again))


@jax.jit
@jax.value_and_grad
def outcome(shift, plan, time, tasks, even):
    """Some of a renewed plan, by shifts of what the fleet senses of itself and its goals."""
    tasks = replace(
        tasks, position_n=tasks.position_n + shift[:3], goal_velocity_n=tasks.goal_velocity_n + 0.01 * shift[3:]
    )
    again, _ = replan(plan, time, tasks, RIGHT, even)
    later = jax.vmap(lambda path: path.position_n(time + 10.0) + path.velocity_n(time + 10.0))(again.trajectories)
    return again.arrival_time + jnp.sum(later * jnp.arange(9.0).reshape(3, 3)) / 1e3


@pytest.mark.long
def test_gradient_against_finite_differences():
    tasks = in_wind(published_fleet(), WIND)
    plan = plan_at(100.0, tasks, RIGHT, True)
    time, later = foreseen(tasks, plan, 0.4)
    rng = np.random.default_rng(4)
    for case in (later, swerve(later)):
        args = (plan, jnp.asarray(time), case, jnp.asarray(True))
        slope = outcome(jnp.zeros((6, 3)), *args)[1]
        for _ in range(3):
            way = jnp.asarray(rng.normal(size=(6, 3)))
            numeric = (outcome(1e-2 * way, *args)[0] - outcome(-1e-2 * way, *args)[0]) / 2e-2
            # Central differences of step 1e-2 m: truncation and solver residual.
            np.testing.assert_allclose(jnp.sum(slope * way), numeric, rtol=1e-4, atol=1e-6)


@pytest.mark.long
def test_vmap_agrees_with_one_at_a_time():
    # One fleet that keeps its plan and one that does not.
    tasks = published_fleet()
    plan = plan_at(100.0, tasks, RIGHT)
    time, later = foreseen(tasks, plan, 0.4)
    cases = [later, swerve(later)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *cases)
    both = jax.jit(jax.vmap(lambda case: replan(plan, time, case, RIGHT)[0]))(stacked)
    for index, case in enumerate(cases):
        alone = renewed(plan, time, case, False)
        np.testing.assert_allclose(both.arrival_time[index], alone.arrival_time, rtol=1e-12)
        np.testing.assert_allclose(both.lateral_bends[index], alone.lateral_bends, rtol=1e-8, atol=1e-6)
    assert both.arrival_time[0] == plan.arrival_time != both.arrival_time[1]


def test_no_weak_types():
    # A plan is carried through lax.scan, and both branches of lax.cond must give the same types.
    tasks = published_fleet()
    plan = plan_at(100.0, tasks, RIGHT)
    for even in (False, True, jnp.asarray(True)):
        shapes, _ = jax.eval_shape(replan, plan, 120.0, tasks, RIGHT, even)
        assert not any(leaf.weak_type for leaf in jax.tree.leaves(shapes))
        assert jax.tree.map(lambda leaf: leaf.dtype, shapes) == jax.tree.map(lambda leaf: leaf.dtype, plan)
