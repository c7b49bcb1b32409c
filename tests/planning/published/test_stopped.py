"""Aircraft that do not fly, or no longer: the published planner plans the others as if they were not there."""

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


def renewed(plan, time, tasks, even=False):
    return _renew(plan, jnp.asarray(time, dtype=float), tasks, RIGHT, jnp.asarray(even))[0]


def without(tasks, *gone):
    return replace(tasks, active=tasks.active.at[jnp.array(gone)].set(False))


def rows(tree, which):
    return jax.tree.map(lambda leaf: leaf[which], tree)


def check_same(one, other, atol=1e-6):
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=atol)


def check_finite(tree):
    assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree))


@pytest.mark.long
@pytest.mark.parametrize("even", [False, True])
def test_the_others_are_planned_as_if_the_farthest_were_not_there(even):
    tasks = in_wind(published_fleet(), WIND)
    everyone = plan_at(0.0, tasks, RIGHT, even)
    farthest = int(everyone.farthest)
    others = np.array([k for k in range(3) if k != farthest])
    plan = plan_at(0.0, without(tasks, farthest), RIGHT, even)
    pair = plan_at(0.0, rows(tasks, others), RIGHT[:2], even)
    assert plan.arrival_time < everyone.arrival_time - 1.0
    # Other shapes, other rounding: of a root to 1e-9 s, and of bends of kilometres that hang on it.
    np.testing.assert_allclose(plan.arrival_time, pair.arrival_time, atol=2e-9)
    assert others[int(pair.farthest)] == plan.farthest
    check_same(rows(plan.trajectories, others), pair.trajectories, atol=1e-5)
    check_same((plan.speed, plan.reference_length), (pair.speed, pair.reference_length))
    assert plan.status[farthest] == INACTIVE
    assert np.all(plan.status[others] == PLANNED)
    assert plan.converged.tolist() == plan.active.tolist() == [k != farthest for k in range(3)]
    check_finite(plan)
    assert "without it" in PLAN_MESSAGES[INACTIVE]


def test_whatever_is_known_of_it_changes_nothing_for_the_others():
    tasks = published_fleet()
    plan = plan_at(0.0, without(tasks, 0), RIGHT)
    for seed in range(3):
        other = random_fleet(seed, 200.0)
        odd = replace(
            tasks,
            position_n=tasks.position_n.at[0].set(10.0 * other.position_n[0]),
            air_velocity_n=tasks.air_velocity_n.at[0].set(2.0 * other.air_velocity_n[0]),
            goal_velocity_n=tasks.goal_velocity_n.at[0].set(other.goal_velocity_n[0]),
            path_length_deficit=tasks.path_length_deficit.at[0].set(-1e5),
        )
        again = plan_at(0.0, without(odd, 0), RIGHT)
        assert again.arrival_time == plan.arrival_time
        assert again.farthest == plan.farthest
        check_same(rows(again.trajectories, OTHERS), rows(plan.trajectories, OTHERS), atol=0.0)
        check_finite(again)
    # Not even a state that is none.
    broken = without(replace(tasks, position_n=tasks.position_n.at[0].set(jnp.nan)), 0)
    again = plan_at(0.0, broken, RIGHT)
    assert again.arrival_time == plan.arrival_time
    check_same(rows(again.trajectories, OTHERS), rows(plan.trajectories, OTHERS), atol=0.0)


def flown_on(tasks, plan, time, elapsed):
    """A fleet on its plan but for the first aircraft, which stopped at its start and has flown nothing since."""
    later = on_plan(plan, tasks, time, elapsed)
    return without(replace(later, position_n=later.position_n.at[0].set(tasks.position_n[0])), 0)


@pytest.mark.long
@pytest.mark.parametrize("even", [False, True])
def test_the_plan_stands_when_one_stops_on_the_way(even):
    tasks = in_wind(published_fleet(), WIND)
    plan = first = plan_at(100.0, tasks, RIGHT, even)
    assert first.farthest == 0
    for elapsed in range(5, 50, 5):
        time = 100.0 + elapsed
        plan = renewed(plan, time, flown_on(tasks, first, time, elapsed), even)
        assert plan.arrival_time == first.arrival_time
    np.testing.assert_array_equal(plan.arrival_times, first.arrival_times)
    assert plan.status.tolist() == [INACTIVE, PLANNED, PLANNED]
    # What stopped keeps its last plan to the bit.
    check_same(rows((plan.trajectories, plan.lengths), 0), rows((first.trajectories, first.lengths), 0), atol=0.0)
    check_finite(plan)


def test_what_is_planned_anew_is_planned_without_it():
    tasks = published_fleet()
    first = plan_at(100.0, tasks, RIGHT)
    time = 100.0 + 0.4 * float(first.arrival_time - 100.0)
    later = flown_on(tasks, first, time, time - 100.0)
    # The second's goal comes to meet it; the third's goes away.
    for k, goal_velocity in ((1, velocity(40.0, -2.0)), (2, velocity(60.0, -0.8))):
        moved = replace(later, goal_velocity_n=later.goal_velocity_n.at[k].set(goal_velocity))
        again = renewed(first, time, moved)
        anew = plan_at(time, moved, RIGHT)
        assert again.arrival_time != first.arrival_time
        np.testing.assert_allclose(again.arrival_time, anew.arrival_time, atol=1e-9)
        check_same(rows(again.trajectories, OTHERS), rows(anew.trajectories, OTHERS))
        assert again.farthest in OTHERS
        assert np.all(again.converged[OTHERS])
        np.testing.assert_array_equal(again.arrival_times[OTHERS], again.arrival_time)
        assert again.arrival_times[0] == first.arrival_time


def test_one_that_flies_again_is_planned_with_again():
    tasks = published_fleet()
    first = plan_at(100.0, without(tasks, 0), RIGHT)
    again = renewed(first, 100.0, tasks)
    np.testing.assert_allclose(again.arrival_time, plan_at(100.0, tasks, RIGHT).arrival_time, atol=1e-9)
    assert np.all(again.status == PLANNED)


@pytest.mark.parametrize("even", [False, True])
def test_where_none_flies_the_first_plan_is_finite_and_a_later_one_stands(even):
    tasks = published_fleet()
    none = without(tasks, 0, 1, 2)
    plan = plan_at(100.0, none, RIGHT, even)
    assert np.all(plan.status == INACTIVE)
    assert not np.any(plan.converged)
    check_finite(plan)
    flying = plan_at(100.0, tasks, RIGHT, even)
    for time in (101.0, 140.0, 400.0):
        again = renewed(flying, time, none, even)
        assert again.arrival_time == flying.arrival_time
        check_same(again.trajectories, flying.trajectories, atol=0.0)
        check_finite(again)


@pytest.mark.long
def test_sides_and_distances_leave_it_out():
    tasks = published_fleet()
    plan = plan_at(0.0, without(tasks, 0), RIGHT)
    pair = plan_at(0.0, rows(tasks, OTHERS), RIGHT[:2])
    np.testing.assert_array_equal(_choose(plan, jnp.zeros(3))[OTHERS], _choose(pair, jnp.zeros(2)))
    distance = _least(plan.trajectories, active=plan.active)
    assert np.all(np.isinf(distance[0]))
    assert np.all(np.isinf(distance[:, 0]))
    np.testing.assert_allclose(distance[1, 2], _least(pair.trajectories)[0, 1], rtol=1e-9)


def _outcome(shift, tasks):
    plan = coordinate(0.0, replace(tasks, position_n=tasks.position_n + shift), 150.0, RIGHT, jnp.asarray(False))
    return plan.arrival_time + jnp.sum(plan.lateral_bends) / 1e3


@pytest.mark.long
def test_batches_and_derivatives():
    tasks = published_fleet()
    cases = [tasks, without(tasks, 0), without(tasks, 0, 1, 2)]
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
