"""Inactive aircraft: the published planner plans the fleet as if they did not exist."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.planning.published.coordination import INACTIVE, PLAN_MESSAGES, PLANNED, coordinate, replan
from anser.planning.published.planner import choose_sides, separation_min
from support.planning_cases import in_wind, on_plan, plan_at, published_fleet, random_fleet, velocity

RIGHT = jnp.ones(3)
WIND = [12.0, -20.0, 0.5]
OTHERS = np.array([1, 2])
_renew = jax.jit(replan)
_choose = jax.jit(choose_sides)
_least = jax.jit(separation_min, static_argnames="count")


def replanned_plan(plan, time, tasks, even=False):
    return _renew(plan, jnp.asarray(time, dtype=float), tasks, RIGHT, jnp.asarray(even))


def without_aircraft(tasks, *gone):
    return replace(tasks, active=tasks.active.at[jnp.array(gone)].set(False))


def select(tree, indices):
    return jax.tree.map(lambda leaf: leaf[indices], tree)


def check_same(plan, reference, atol=1e-6):
    for a, b in zip(jax.tree.leaves(plan), jax.tree.leaves(reference), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=atol)


def check_finite(tree):
    assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree))


@pytest.mark.long
@pytest.mark.parametrize("even", [False, True])
def test_a_plan_without_the_farthest_equals_that_of_a_smaller_fleet(even):
    tasks = in_wind(published_fleet(), WIND)
    everyone = plan_at(0.0, tasks, RIGHT, even)
    farthest = int(everyone.farthest)
    active_indices = np.array([k for k in range(3) if k != farthest])
    plan = plan_at(0.0, without_aircraft(tasks, farthest), RIGHT, even)
    pair = plan_at(0.0, select(tasks, active_indices), RIGHT[:2], even)
    assert plan.arrival_time < everyone.arrival_time - 1.0
    # Other shapes, other rounding: of a root to 1e-9 s, and of bends of kilometres that hang on it.
    np.testing.assert_allclose(plan.arrival_time, pair.arrival_time, atol=2e-9)
    assert active_indices[int(pair.farthest)] == plan.farthest
    check_same(select(plan.trajectories, active_indices), pair.trajectories, atol=1e-5)
    check_same((plan.speed, plan.reference_length), (pair.speed, pair.reference_length))
    assert plan.status[farthest] == INACTIVE
    assert np.all(plan.status[active_indices] == PLANNED)
    assert plan.converged.tolist() == plan.active.tolist() == [k != farthest for k in range(3)]
    check_finite(plan)
    assert "without it" in PLAN_MESSAGES[INACTIVE]


def test_data_of_an_inactive_aircraft_do_not_affect_the_fleet():
    tasks = published_fleet()
    plan = plan_at(0.0, without_aircraft(tasks, 0), RIGHT)
    for seed in range(3):
        odd_fleet = random_fleet(seed, 200.0)
        odd = replace(
            tasks,
            position_n=tasks.position_n.at[0].set(10.0 * odd_fleet.position_n[0]),
            air_velocity_n=tasks.air_velocity_n.at[0].set(2.0 * odd_fleet.air_velocity_n[0]),
            goal_velocity_n=tasks.goal_velocity_n.at[0].set(odd_fleet.goal_velocity_n[0]),
            path_length_deficit=tasks.path_length_deficit.at[0].set(-1e5),
        )
        replanned = plan_at(0.0, without_aircraft(odd, 0), RIGHT)
        assert replanned.arrival_time == plan.arrival_time
        assert replanned.farthest == plan.farthest
        check_same(select(replanned.trajectories, OTHERS), select(plan.trajectories, OTHERS), atol=0.0)
        check_finite(replanned)
    # Not even a state that is none.
    broken = without_aircraft(replace(tasks, position_n=tasks.position_n.at[0].set(jnp.nan)), 0)
    replanned = plan_at(0.0, broken, RIGHT)
    assert replanned.arrival_time == plan.arrival_time
    check_same(select(replanned.trajectories, OTHERS), select(plan.trajectories, OTHERS), atol=0.0)


def after_stop(tasks, plan, time, elapsed):
    """A fleet on its plan, except the first aircraft, which stopped at its start."""
    later = on_plan(plan, tasks, time, elapsed)
    return without_aircraft(replace(later, position_n=later.position_n.at[0].set(tasks.position_n[0])), 0)


@pytest.mark.long
@pytest.mark.parametrize("even", [False, True])
def test_the_plan_is_kept_when_an_aircraft_stops(even):
    tasks = in_wind(published_fleet(), WIND)
    plan = first_plan = plan_at(100.0, tasks, RIGHT, even)
    assert first_plan.farthest == 0
    for elapsed in range(5, 50, 5):
        time = 100.0 + elapsed
        plan = replanned_plan(plan, time, after_stop(tasks, first_plan, time, elapsed), even)
        assert plan.arrival_time == first_plan.arrival_time
    np.testing.assert_array_equal(plan.arrival_times, first_plan.arrival_times)
    assert plan.status.tolist() == [INACTIVE, PLANNED, PLANNED]
    # What stopped keeps its last plan to the bit.
    check_same(
        select((plan.trajectories, plan.lengths), 0), select((first_plan.trajectories, first_plan.lengths), 0), atol=0.0
    )
    check_finite(plan)


def test_a_new_coordination_excludes_a_stopped_aircraft():
    tasks = published_fleet()
    first_plan = plan_at(100.0, tasks, RIGHT)
    time = 100.0 + 0.4 * float(first_plan.arrival_time - 100.0)
    later = after_stop(tasks, first_plan, time, time - 100.0)
    # The second's goal comes to meet it; the third's goes away.
    for k, goal_velocity in ((1, velocity(40.0, -2.0)), (2, velocity(60.0, -0.8))):
        moved = replace(later, goal_velocity_n=later.goal_velocity_n.at[k].set(goal_velocity))
        replanned = replanned_plan(first_plan, time, moved)
        new_plan = plan_at(time, moved, RIGHT)
        assert replanned.arrival_time != first_plan.arrival_time
        np.testing.assert_allclose(replanned.arrival_time, new_plan.arrival_time, atol=1e-9)
        check_same(select(replanned.trajectories, OTHERS), select(new_plan.trajectories, OTHERS))
        assert replanned.farthest in OTHERS
        assert np.all(replanned.converged[OTHERS])
        np.testing.assert_array_equal(replanned.arrival_times[OTHERS], replanned.arrival_time)
        assert replanned.arrival_times[0] == first_plan.arrival_time


def test_a_reactivated_aircraft_is_planned_again():
    tasks = published_fleet()
    first_plan = plan_at(100.0, without_aircraft(tasks, 0), RIGHT)
    replanned = replanned_plan(first_plan, 100.0, tasks)
    np.testing.assert_allclose(replanned.arrival_time, plan_at(100.0, tasks, RIGHT).arrival_time, atol=1e-9)
    assert np.all(replanned.status == PLANNED)


@pytest.mark.parametrize("even", [False, True])
def test_a_fleet_without_active_aircraft_has_a_finite_plan(even):
    tasks = published_fleet()
    none = without_aircraft(tasks, 0, 1, 2)
    plan = plan_at(100.0, none, RIGHT, even)
    assert np.all(plan.status == INACTIVE)
    assert not np.any(plan.converged)
    check_finite(plan)
    flying = plan_at(100.0, tasks, RIGHT, even)
    for time in (101.0, 140.0, 400.0):
        replanned = replanned_plan(flying, time, none, even)
        assert replanned.arrival_time == flying.arrival_time
        check_same(replanned.trajectories, flying.trajectories, atol=0.0)
        check_finite(replanned)


@pytest.mark.long
def test_sides_and_distances_ignore_an_inactive_aircraft():
    tasks = published_fleet()
    plan = plan_at(0.0, without_aircraft(tasks, 0), RIGHT)
    pair = plan_at(0.0, select(tasks, OTHERS), RIGHT[:2])
    np.testing.assert_array_equal(_choose(plan, jnp.zeros(3))[OTHERS], _choose(pair, jnp.zeros(2)))
    distance = _least(plan.trajectories, active=plan.active)
    assert np.all(np.isinf(distance[0]))
    assert np.all(np.isinf(distance[:, 0]))
    np.testing.assert_allclose(distance[1, 2], _least(pair.trajectories)[0, 1], rtol=1e-9)


def _outcome(shift, tasks):
    plan = coordinate(0.0, replace(tasks, position_n=tasks.position_n + shift), 150.0, RIGHT, jnp.asarray(False))
    return plan.arrival_time + jnp.sum(plan.lateral_bends) / 1e3


@pytest.mark.long
def test_batches_and_derivatives_are_finite():
    tasks = published_fleet()
    cases = [tasks, without_aircraft(tasks, 0), without_aircraft(tasks, 0, 1, 2)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *cases)
    # Runs once: what the compiler would spend on its speed is not earned back.
    options = {"xla_backend_optimization_level": 0}
    batch = jax.jit(jax.vmap(jax.value_and_grad(_outcome), in_axes=(None, 0)), compiler_options=options)
    values, slopes = batch(jnp.zeros((3, 3)), stacked)
    for k, case in enumerate(cases):
        plan = plan_at(0.0, case, RIGHT)
        np.testing.assert_allclose(values[k], plan.arrival_time + jnp.sum(plan.lateral_bends) / 1e3, rtol=1e-8)
    assert np.all(np.isfinite(slopes))
    # The arrival and the bends of the others hang on the farthest only where it flies.
    assert np.max(np.abs(slopes[0, 0])) > 1e-3
    np.testing.assert_array_equal(slopes[1, 0], 0.0)
