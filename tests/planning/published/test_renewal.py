"""Replanning en route (theory section 8, "replanned online from the present state")."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.parts import make_rendezvous
from anser.planning.published.coordination import COMMITTED_S, PLANNED, continue_plan, replan
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
_continue = jax.jit(continue_plan)


def replanned_plan(plan, time, tasks, even, sides=RIGHT):
    return _renew(plan, jnp.asarray(time, dtype=float), tasks, sides, jnp.asarray(even))


@pytest.fixture(scope="module")
def flights():
    """Fleets with a plan each: the published and random fleets; both laws; wind; with and without energy exchange."""
    planned = []
    for even, deceleration in ((False, 1.0), (True, 1.0), (True, 20.0)):
        for seed, wind in ((None, [0.0, 0.0, 0.0]), (None, WIND), (2, WIND), (8, WIND)):
            tasks = published_fleet() if seed is None else random_fleet(seed, 40.0)
            tasks = replace(in_wind(tasks, wind), deceleration=jnp.full(3, deceleration, dtype=float))
            planned.append((tasks, plan_at(100.0, tasks, jnp.array([1.0, -1.0, 1.0]), even), even))
    return planned


def predicted(tasks, plan, fraction):
    """Time, and the fleet's tasks if the flight went as planned from 100 s on."""
    time = 100.0 + fraction * float(plan.arrival_time - 100.0)
    return time, on_plan(plan, tasks, time, time - 100.0)


def largest_distance(plan_a, plan_b, start):
    """Greatest distance between the positions of two plans from a time on, m."""
    times = np.linspace(start, float(plan_a.arrival_time), 9)
    return max(
        float(jnp.max(jnp.abs(along(plan_a.trajectories, t)[0] - along(plan_b.trajectories, t)[0]))) for t in times
    )


def test_replanning_on_the_planned_path_keeps_the_plan(flights):
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
            time, later = predicted(tasks, plan, fraction)
            replanned = replanned_plan(plan, time, later, even)
            assert replanned.arrival_time == plan.arrival_time
            np.testing.assert_array_equal(replanned.status, plan.status)
            assert largest_distance(plan, replanned, time) < tolerance
    assert traded


def test_the_cases_include_bent_paths(flights):
    bends = [plan.lateral_bends for _, plan, _ in flights]
    # One straight and two bent in each fleet, by up to more than the distance.
    assert all(jnp.sum(bend == 0.0) == 1 for bend in bends)
    assert max(float(jnp.max(jnp.abs(bend))) for bend in bends) > 1e4


@pytest.mark.long
@pytest.mark.parametrize("even", [False, True])
def test_replanning_every_second_does_not_drift(even):
    tasks = in_wind(published_fleet(), WIND)
    plan = first_plan = plan_at(100.0, tasks, RIGHT, even)
    for elapsed in range(1, 50):
        # Positions by the plan in force, so that the smallest change would add up.
        time = 100.0 + elapsed
        plan = replanned_plan(plan, time, on_plan(first_plan, tasks, time, elapsed), even)
    assert plan.arrival_time == first_plan.arrival_time
    # Fifty times the micrometre of one renewal.
    assert largest_distance(first_plan, plan, 149.0) < 5e-5


def test_prescribed_arrival_directions_are_kept():
    rendezvous = make_rendezvous(jnp.array([0.0, 0.0, -300.0]), 0.4, -0.02)
    tasks = replace(
        in_wind(published_fleet(), WIND),
        rendezvous=jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), rendezvous),
        deceleration=jnp.full(3, 0.5, dtype=float),
    )
    plan = plan_at(100.0, tasks, RIGHT, True)
    # The descent asks for more than the fleet's speed here, which the crab angle hangs on.
    steep = replace(tasks, position_n=tasks.position_n.at[:, 2].add(-1000.0))
    steep = replace(steep, origin_n=steep.position_n)
    fast = plan_at(100.0, steep, RIGHT, True)
    assert fast.speed > SPEED + 1.0
    for case, previous in ((tasks, plan), (steep, fast)):
        time, later = predicted(case, previous, 0.5)
        replanned = replanned_plan(previous, time, later, True)
        assert replanned.arrival_time == previous.arrival_time
        end_velocities = [along(x.trajectories, previous.arrival_time)[1] for x in (previous, replanned)]
        np.testing.assert_allclose(end_velocities[1], end_velocities[0], atol=1e-6)


def test_the_rendezvous_follows_the_goal_without_new_coordination(flights):
    for tasks, plan, even in flights:
        time, later = predicted(tasks, plan, 0.6)
        # A little faster than foreseen, and seen a little aside: not enough to plan anew.
        moved = replace(
            later,
            goal_velocity_n=later.goal_velocity_n + jnp.array([[0.3, -0.2, 0.0]]),
            goal_position_n=later.goal_position_n + jnp.array([[2.0, 3.0, 0.0]]),
        )
        replanned = replanned_plan(plan, time, moved, even)
        assert replanned.arrival_time == plan.arrival_time
        arrival_position = along(replanned.trajectories, replanned.arrival_time)[0]
        time_left = float(plan.arrival_time) - time
        goals = moved.goal_position_n + moved.goal_velocity_n * time_left + moved.rendezvous.stand_off_n
        # The end of the last cell, to rounding of the time.
        np.testing.assert_allclose(arrival_position, goals, atol=1e-6)
        np.testing.assert_allclose(along(replanned.trajectories, time)[0], later.position_n, atol=1e-6)
        # Flown on from there at the planned velocity, whatever the aircraft's own.
        np.testing.assert_allclose(along(replanned.trajectories, time)[1], along(plan.trajectories, time)[1], atol=1e-6)


def swerve(tasks):
    """The goal of the farthest aircraft of the published fleet turns away at 60 m/s."""
    return replace(tasks, goal_velocity_n=tasks.goal_velocity_n.at[0].set(velocity(60.0, -1.5)))


@pytest.mark.parametrize("even", [False, True])
def test_a_swerving_goal_leads_to_a_new_coordination(even):
    tasks = replace(published_fleet(), deceleration=jnp.full(3, 4.0, dtype=float))
    plan = plan_at(100.0, tasks, RIGHT, even)
    time, later = predicted(tasks, plan, 0.4)
    replanned = replanned_plan(plan, time, swerve(later), even)
    assert np.all(replanned.status == PLANNED)
    # 36 s at up to 60 m/s away: some seconds more at 150 m/s.
    assert replanned.arrival_time > plan.arrival_time + 5.0
    time_left = replanned.arrival_time - time
    np.testing.assert_allclose(replanned.trajectories.duration, time_left, rtol=1e-12)
    # All fly the fleet's mean speed over their whole flight.
    np.testing.assert_allclose(
        lengths_of(replanned.trajectories), replanned.speed * time_left + later.path_length_deficit, atol=1e-5
    )
    goals = swerve(later).goal_position_n + swerve(later).goal_velocity_n * time_left + later.rendezvous.stand_off_n
    np.testing.assert_allclose(along(replanned.trajectories, replanned.arrival_time)[0], goals, atol=1e-6)
    # It is just what the fleet would plan from there.
    new_plan = plan_at(time, swerve(later), RIGHT, even)
    np.testing.assert_allclose(replanned.arrival_time, new_plan.arrival_time, rtol=1e-12)
    np.testing.assert_allclose(replanned.lateral_bends, new_plan.lateral_bends, rtol=1e-9, atol=1e-6)


def test_a_fleet_off_its_speed_must_be_coordinated_again(flights):
    for tasks, plan, even in flights:
        time, later = predicted(tasks, plan, 0.4)
        for case, expected in ((later, False), (swerve(later), True)):
            full = replanned_plan(plan, time, case, even)
            light, is_due = _continue(plan, jnp.asarray(time), case, jnp.asarray(even))
            assert is_due == expected
            assert light.arrival_time == plan.arrival_time
            assert (full.arrival_time == plan.arrival_time) != expected
            if not expected:
                for leaf, full_leaf in zip(jax.tree.leaves(light), jax.tree.leaves(full), strict=True):
                    np.testing.assert_allclose(leaf, full_leaf, rtol=1e-9, atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("even", [False, True])
def test_the_arrival_time_is_fixed_in_the_last_15_seconds(even):
    tasks = published_fleet()
    plan = plan_at(100.0, tasks, RIGHT, even)
    for time_left, is_fixed in ((COMMITTED_S + 1.0, False), (COMMITTED_S - 1.0, True), (0.5, True)):
        time = float(plan.arrival_time) - time_left
        later = swerve(on_plan(plan, tasks, time, time - 100.0))
        replanned = replanned_plan(plan, time, later, even)
        assert (replanned.arrival_time == plan.arrival_time) == is_fixed
        # Either way the paths end where the goals will be.
        goals = later.goal_position_n + later.goal_velocity_n * (replanned.arrival_time - time)
        np.testing.assert_allclose(
            along(replanned.trajectories, replanned.arrival_time)[0], goals + later.rendezvous.stand_off_n, atol=1e-6
        )


def test_the_speed_of_a_fast_descending_fleet_is_not_raised():
    # Down steep paths, engines idle, at more than the planned speed: no slower mean is possible on what is left. Raised
    # to that, again and again, the plan once ran away from 157 to 250 m/s.
    high = random_fleet(2, 40.0)
    down = jnp.array([[0.0, 0.0, 1.0]])
    high = replace(high, position_n=high.position_n - 1500.0 * down, deceleration=jnp.full(3, 0.4, dtype=float))
    plan = plan_at(100.0, high, RIGHT, True)
    time, later = predicted(high, plan, 0.6)
    faster = replace(
        later,
        air_velocity_n=1.1 * later.air_velocity_n,
        path_length_deficit=later.path_length_deficit - 0.02 * plan.lengths,
    )
    replanned = replanned_plan(plan, time, faster, True)
    assert replanned.speed == plan.speed
    assert replanned.arrival_time > plan.arrival_time - 0.5
    assert plan_at(time, faster, RIGHT, True).speed > 1.02 * plan.speed


@pytest.mark.long
def test_a_failed_plan_is_coordinated_again():
    tasks = published_fleet()
    fleeing = replace(tasks, goal_velocity_n=tasks.goal_velocity_n.at[1].set(velocity(170.0, 0.8)))
    plan = plan_at(100.0, fleeing, RIGHT)
    assert not plan.converged[1]
    time, later = predicted(fleeing, plan, 0.1)
    # The goal has come to rest.
    replanned = replanned_plan(plan, time, replace(later, goal_velocity_n=tasks.goal_velocity_n), False)
    assert np.all(replanned.status == PLANNED)


def test_replanning_is_finite_at_and_after_the_arrival():
    tasks = in_wind(published_fleet(), WIND)
    for even in (False, True):
        plan = plan_at(100.0, tasks, RIGHT, even)
        for late in (0.0, 7.0):
            time = float(plan.arrival_time) + late
            replanned = replanned_plan(plan, time, on_plan(plan, tasks, time, time - 100.0), even)
            assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(replanned))


@jax.jit
@jax.value_and_grad
def outcome(shift, plan, time, tasks, even):
    """Sample values of a replanned plan, as functions of shifts in the sensed aircraft and goals."""
    tasks = replace(
        tasks, position_n=tasks.position_n + shift[:3], goal_velocity_n=tasks.goal_velocity_n + 0.01 * shift[3:]
    )
    replanned = replan(plan, time, tasks, RIGHT, even)
    later = jax.vmap(lambda path: path.position_n(time + 10.0) + path.velocity_n(time + 10.0))(replanned.trajectories)
    return replanned.arrival_time + jnp.sum(later * jnp.arange(9.0).reshape(3, 3)) / 1e3


@pytest.mark.long
def test_the_gradient_equals_finite_differences():
    tasks = in_wind(published_fleet(), WIND)
    plan = plan_at(100.0, tasks, RIGHT, True)
    time, later = predicted(tasks, plan, 0.4)
    rng = np.random.default_rng(4)
    for case in (later, swerve(later)):
        args = (plan, jnp.asarray(time), case, jnp.asarray(True))
        slope = outcome(jnp.zeros((6, 3)), *args)[1]
        for _ in range(3):
            direction = jnp.asarray(rng.normal(size=(6, 3)))
            numeric = (outcome(1e-2 * direction, *args)[0] - outcome(-1e-2 * direction, *args)[0]) / 2e-2
            # Central differences of step 1e-2 m: truncation and solver residual.
            np.testing.assert_allclose(jnp.sum(slope * direction), numeric, rtol=1e-4, atol=1e-6)


@pytest.mark.long
def test_a_batch_equals_single_replanning():
    # One fleet that keeps its plan and one that does not.
    tasks = published_fleet()
    plan = plan_at(100.0, tasks, RIGHT)
    time, later = predicted(tasks, plan, 0.4)
    cases = [later, swerve(later)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *cases)
    batch = jax.jit(jax.vmap(lambda case: replan(plan, time, case, RIGHT)))(stacked)
    for index, case in enumerate(cases):
        alone = replanned_plan(plan, time, case, False)
        np.testing.assert_allclose(batch.arrival_time[index], alone.arrival_time, rtol=1e-12)
        np.testing.assert_allclose(batch.lateral_bends[index], alone.lateral_bends, rtol=1e-8, atol=1e-6)
    assert batch.arrival_time[0] == plan.arrival_time != batch.arrival_time[1]


def test_a_replanned_plan_has_no_weak_types():
    # A plan is carried through lax.scan, and both branches of lax.cond must give the same types.
    tasks = published_fleet()
    plan = plan_at(100.0, tasks, RIGHT)
    for even in (False, True, jnp.asarray(True)):
        shapes = jax.eval_shape(replan, plan, 120.0, tasks, RIGHT, even)
        assert not any(leaf.weak_type for leaf in jax.tree.leaves(shapes))
        assert jax.tree.map(lambda leaf: leaf.dtype, shapes) == jax.tree.map(lambda leaf: leaf.dtype, plan)


def test_a_goal_that_outruns_its_aircraft_is_no_reason_for_another_plan_until_it_can_be_reached():
    case = published_fleet()
    fleeing = replace(case, goal_velocity_n=case.goal_velocity_n.at[1].set(velocity(170.0, 0.8)))
    plan = plan_at(100.0, fleeing, RIGHT, False)
    assert plan.goal_reachable.tolist() == [True, False, True]
    time, tasks = predicted(fleeing, plan, 0.3)
    assert not _continue(plan, jnp.asarray(time), tasks, jnp.asarray(False))[1]
    stopped = replace(tasks, goal_velocity_n=tasks.goal_velocity_n.at[1].set(0.0))
    _, is_due = _continue(plan, jnp.asarray(time), stopped, jnp.asarray(False))
    assert is_due
    assert replanned_plan(plan, time, stopped, False).goal_reachable.all()
