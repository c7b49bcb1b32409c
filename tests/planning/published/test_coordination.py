"""Simultaneous arrival of a fleet (theory section 8)."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.parts import make_rendezvous
from anser.planning.published.coordination import (
    DIRECTION_UNATTAINABLE,
    GOAL_OUTRUNS,
    NO_COMMON_TIME,
    PLAN_MESSAGES,
    PLANNED,
    PlanningTask,
    coordinate,
)
from anser.planning.published.trajectory import arc_length, fit_trajectory
from support.planning_cases import (
    SPEED,
    along,
    fleet,
    in_wind,
    lengths_of,
    on_plan,
    plan_at,
    published_fleet,
    random_fleet,
    velocity,
)

RIGHT = jnp.ones(3)


def plan_arrival(case: PlanningTask, sides=RIGHT, time=0.0, even=False):
    return plan_at(time, case, sides, even)


@jax.jit
def longest_flight_time(case: PlanningTask, duration):
    """The published scheme written out for still air and free arrivals: flight time of the longest path."""
    end_points = case.goal_position_n + case.goal_velocity_n * duration + case.rendezvous.stand_off_n
    lines = end_points - case.position_n
    finals = SPEED * lines / jnp.linalg.norm(lines, axis=1)[:, None]
    paths = jax.vmap(lambda p, v, e, f: fit_trajectory(0.0, duration, p, v, e, f))(
        case.position_n, case.air_velocity_n, end_points, finals
    )
    return jnp.max(jax.vmap(arc_length)(paths)) / SPEED


def _outcome(goal_velocity_n, speed, position_n, case, weights):
    """Weighted sum of the fields of a plan."""
    case = replace(case, goal_velocity_n=goal_velocity_n, position_n=position_n, origin_n=position_n)
    plan = coordinate(0.0, case, speed, RIGHT, jnp.asarray(False))
    middle = jax.vmap(lambda path: path.position_n(20.0))(plan.trajectories)
    parts = jnp.concatenate([plan.arrival_time[None], plan.lateral_bends / 1e3, middle[:, 1] / 1e3])
    return jnp.sum(weights * parts)


outcome = jax.jit(_outcome)
# Runs a few times: what the compiler would spend on its speed is not earned back.
slopes = jax.jit(jax.grad(_outcome, argnums=(0, 1, 2)), compiler_options={"xla_backend_optimization_level": 0})


def check_arrival(case: PlanningTask, plan, time):
    """The fleet flies the reference length and meets the moving goals at the planned time."""
    t_f = plan.arrival_time
    duration = t_f - time
    # Fixed point: the longest path at the airspeed takes the common time.
    assert abs(plan.reference_length / SPEED - duration) < 1e-9
    assert plan.reference_length == jnp.max(plan.nominal_lengths)
    assert plan.lateral_bends[plan.farthest] == 0.0
    np.testing.assert_allclose(lengths_of(plan.trajectories), plan.reference_length, atol=1e-6)
    position, start = along(plan.trajectories, time)
    goal_position, final = along(plan.trajectories, t_f)
    goals = case.goal_position_n + case.goal_velocity_n * duration + case.rendezvous.stand_off_n
    # Rounding of coefficients of up to 1e5 m.
    np.testing.assert_allclose(goal_position, goals, atol=1e-8)
    np.testing.assert_allclose(position, case.position_n, atol=1e-9)
    np.testing.assert_allclose(start, case.air_velocity_n, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(final, axis=1), SPEED, rtol=1e-10)


def test_the_published_three_aircraft_case_is_reproduced():
    case = published_fleet()
    plan = plan_arrival(case)
    assert np.all(plan.status == PLANNED)
    assert np.all(plan.converged & plan.goal_reachable)
    check_arrival(case, plan, 0.0)
    # Aircraft 1 is the farthest, 9 km from a rendezvous that lies ahead of it: it flies straight there,
    assert plan.farthest == 0
    # no shorter a way than the line to where the rendezvous will be, and longer by less than a percent.
    straight = jnp.linalg.norm(
        jnp.array([100.0, 0.0, -300.0]) + 25.0 * plan.arrival_time * jnp.array([1.0, 0.0, 0.0]) - case.position_n[0]
    )
    assert straight <= plan.reference_length <= 1.01 * straight


@pytest.mark.parametrize("side", [(1.0, -1.0, 1.0), (1.0, 1.0, -1.0)])
def test_detours_are_on_the_requested_sides(side):
    plan = plan_arrival(published_fleet(), jnp.array(side))
    assert jnp.all(plan.lateral_bends * jnp.array(side) >= 0.0)
    assert jnp.sum(plan.lateral_bends == 0.0) == 1


@pytest.mark.parametrize("goal_speed_max", [30.0, 90.0])
def test_random_fleets_meet_goals_at_up_to_60_percent_of_the_airspeed(goal_speed_max):
    for seed in range(25):
        case = random_fleet(seed, goal_speed_max)
        plan = plan_arrival(case, time=100.0)
        assert np.all(plan.converged), seed
        check_arrival(case, plan, 100.0)
        # It is the first such time: at no earlier one are all paths in time.
        for earlier in np.linspace(0.1, 0.999, 12) * float(plan.arrival_time - 100.0):
            assert longest_flight_time(case, earlier) > earlier


def test_the_fixed_point_equals_plain_iteration():
    # The published scheme, iterated to rest: fit everything anew at T, then T = max L/V.
    case, duration = published_fleet(), 50.0
    for _ in range(100):
        duration = longest_flight_time(case, duration)
    np.testing.assert_allclose(plan_arrival(case).arrival_time, duration, atol=1e-9)


def test_a_plan_in_wind_is_the_still_air_plan_in_the_drifting_frame():
    wind = jnp.array([12.0, -20.0, 1.0])
    still = random_fleet(3, 40.0)
    windy = in_wind(still, wind)
    a, b = plan_arrival(still, time=20.0), plan_arrival(windy, time=20.0)
    np.testing.assert_allclose(b.arrival_time, a.arrival_time, rtol=1e-12)
    np.testing.assert_allclose(b.lateral_bends, a.lateral_bends, rtol=1e-7, atol=1e-6)
    for fraction in (0.0, 0.3, 1.0):
        time = 20.0 + fraction * (a.arrival_time - 20.0)
        goal_position, drifting = (along(plan.trajectories, time)[0] for plan in (a, b))
        # A bend to 1e-10 of the length moves the middle of the path by micrometres.
        np.testing.assert_allclose(drifting, goal_position + wind[None] * (time - 20.0), atol=1e-5)


@pytest.mark.parametrize("elapsed", [0.5, 8.0, 15.0])
def test_replanning_on_the_paths_keeps_the_arrival_time(elapsed):
    # The rest of the farthest's nominal path is the nominal path from there (same slopes by s at both ends), and what
    # it flew faster or slower than the mean so far is due: arrival time and reference length follow exactly.
    # (Later on the farthest may change: from the middle of a detour the unbent path is not the shortest.)
    case = published_fleet()
    plan = plan_arrival(case)
    later = on_plan(plan, case, elapsed, elapsed)
    replanned = plan_arrival(later, time=elapsed)
    # A millimetre is what quadrature leaves of a length of 9 km split in two; 150 m/s.
    np.testing.assert_allclose(replanned.arrival_time, plan.arrival_time, atol=1e-5)
    assert replanned.farthest == plan.farthest
    assert np.all(replanned.converged)
    np.testing.assert_allclose(
        lengths_of(replanned.trajectories), replanned.reference_length + later.path_length_deficit, atol=1e-6
    )


@pytest.mark.parametrize("seed", range(8))
def test_length_deficits_are_added_to_the_paths(seed):
    case = random_fleet(seed, 40.0)
    deficits = jnp.asarray(np.random.default_rng(seed).uniform(-300.0, 300.0, 3))
    late_case = replace(case, path_length_deficit=deficits)
    plan = plan_arrival(late_case, time=30.0)
    assert np.all(plan.converged)
    # What is due comes on top of each path, and the fleet's mean airspeed over the whole flight is the same for all.
    np.testing.assert_allclose(lengths_of(plan.trajectories) - deficits, SPEED * (plan.arrival_time - 30.0), atol=1e-5)


@pytest.mark.parametrize("part", [0.5, 0.8, 0.95, 0.999])
def test_a_late_fleet_has_an_arrival_time(part):
    # Nearly the whole way is due already: the time that is left tends to 0, far below the straight lines' time.
    case = published_fleet()
    distance = jnp.linalg.norm(case.goal_position_n + case.rendezvous.stand_off_n - case.position_n, axis=1)
    late_case = replace(case, path_length_deficit=part * distance)
    plan = plan_arrival(late_case)
    assert np.all(plan.converged)
    assert plan.arrival_time < 1.1 * (1.0 - part) * jnp.max(distance) / SPEED
    np.testing.assert_allclose(
        lengths_of(plan.trajectories) - late_case.path_length_deficit, SPEED * plan.arrival_time, atol=1e-5
    )


@pytest.mark.long
def test_a_fleet_late_by_more_than_its_path_is_refused_with_finite_numbers():
    case = published_fleet()
    plan = plan_arrival(replace(case, path_length_deficit=jnp.full(3, 2e4, dtype=float)))
    assert np.all(plan.status == NO_COMMON_TIME)
    assert not np.any(plan.converged)
    # The time along straight lines at the airspeed stands in: 9 km for the farthest.
    assert 50.0 < plan.arrival_time < 100.0
    assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(plan))


def test_an_unreachable_goal_is_flagged_and_excluded():
    case = published_fleet()
    fleeing = replace(case, goal_velocity_n=case.goal_velocity_n.at[1].set(velocity(170.0, 0.8)))
    plan = plan_arrival(fleeing)
    assert plan.status.tolist() == [PLANNED, GOAL_OUTRUNS, PLANNED]
    assert plan.goal_reachable.tolist() == [True, False, True]
    assert plan.converged.tolist() == [True, False, True]
    np.testing.assert_allclose(plan.arrival_time, plan_arrival(case).arrival_time, rtol=1e-12)
    assert "outruns" in PLAN_MESSAGES[GOAL_OUTRUNS]


@pytest.mark.long
def test_a_fleet_with_unreachable_goals_only_stays_finite():
    case = published_fleet()
    direction = case.goal_position_n - case.position_n
    fleeing = replace(case, goal_velocity_n=200.0 * direction / jnp.linalg.norm(direction, axis=1)[:, None])
    plan = plan_arrival(fleeing)
    assert np.all(plan.status == GOAL_OUTRUNS)
    assert not np.any(plan.converged)
    assert plan.arrival_time < 1e3
    gradient = slopes(fleeing.goal_velocity_n, jnp.asarray(SPEED), fleeing.position_n, fleeing, jnp.ones(7))
    for leaf in jax.tree.leaves((plan, gradient)):
        assert jnp.all(jnp.isfinite(leaf))


@pytest.mark.parametrize("goal_speed_max", [135.0, 160.0, 400.0])
def test_fast_goals_never_give_nan(goal_speed_max):
    codes = set()
    for seed in range(20):
        plan = plan_arrival(random_fleet(seed, goal_speed_max))
        assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(plan))
        assert np.all(plan.converged == (plan.status == PLANNED))
        codes |= set(plan.status.tolist())
    assert codes <= {PLANNED, GOAL_OUTRUNS, NO_COMMON_TIME}
    assert len(codes) > 1


def test_a_fleet_at_its_rendezvous_stays_finite():
    case = published_fleet()
    goal_position = replace(case, position_n=case.goal_position_n + case.rendezvous.stand_off_n)
    assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(plan_arrival(goal_position)))


def test_a_prescribed_arrival_direction_is_flown_or_refused():
    case = published_fleet()
    north = make_rendezvous(jnp.array([0.0, 0.0, -300.0]), 0.0, 0.0)
    northward = replace(case, rendezvous=jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), north))
    breeze, storm = jnp.tile(jnp.array([[0.0, 30.0, 0.0]]), (3, 1)), jnp.tile(jnp.array([[0.0, 160.0, 0.0]]), (3, 1))
    plan = plan_arrival(replace(northward, wind_n=breeze))
    assert np.all(plan.status == PLANNED)
    final = along(plan.trajectories, plan.arrival_time)[1] + breeze
    # Crab angle: the ground speed is sqrt(150^2 - 30^2), due North, level.
    np.testing.assert_allclose(final, np.tile([np.sqrt(150.0**2 - 30.0**2), 0.0, 0.0], (3, 1)), atol=1e-9)
    refused = plan_arrival(replace(northward, wind_n=storm, goal_velocity_n=storm))
    assert np.all(refused.status == DIRECTION_UNATTAINABLE)


@pytest.mark.long
def test_the_published_single_case_is_reproduced():
    # Theory section 8: one aircraft flies its nominal path.
    case = fleet(
        jnp.array([[0.0, 0.0, -1000.0]]),
        velocity(150.0, 0.0)[None],
        jnp.array([[5000.0, 0.0, 0.0]]),
        velocity(25.0, np.pi / 2)[None],
    )
    plan = plan_at(0.0, case, jnp.ones(1))
    assert plan.status[0] == PLANNED
    check_arrival(case, plan, 0.0)


@pytest.mark.long
def test_the_gradient_equals_finite_differences():
    case, speed = published_fleet(), jnp.asarray(SPEED)
    rng = np.random.default_rng(1)
    for weights in (jnp.zeros(7).at[0].set(1.0), jnp.asarray(rng.normal(size=7))):
        by_goal, by_speed, by_position = slopes(case.goal_velocity_n, speed, case.position_n, case, weights)
        for _ in range(3):
            directions = [jnp.asarray(rng.normal(size=shape)) for shape in ((3, 3), (), (3, 3))]
            # Central differences of step 1e-3: step^2 truncation and 1e-10/step of solver residual.
            forward, backward = (
                outcome(
                    case.goal_velocity_n + step * directions[0],
                    speed + step * directions[1],
                    case.position_n + step * directions[2],
                    case,
                    weights,
                )
                for step in (1e-3, -1e-3)
            )
            slope = jnp.sum(by_goal * directions[0]) + by_speed * directions[1] + jnp.sum(by_position * directions[2])
            np.testing.assert_allclose(slope, (forward - backward) / 2e-3, rtol=1e-5, atol=1e-6)


@pytest.mark.long
def test_a_batch_of_fleets_equals_single_fleets():
    cases = [random_fleet(seed, 60.0) for seed in (5, 6)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *cases)
    plans = jax.jit(jax.vmap(lambda case: coordinate(0.0, case, SPEED, RIGHT)))(stacked)
    for index, case in enumerate(cases):
        np.testing.assert_allclose(plans.arrival_time[index], plan_arrival(case).arrival_time, rtol=1e-12)
        np.testing.assert_allclose(plans.lateral_bends[index], plan_arrival(case).lateral_bends, rtol=1e-8, atol=1e-6)


def test_a_plan_has_no_weak_types():
    # A plan is carried through lax.cond and lax.scan, where weak types do not match strong ones.
    for even in (False, True):
        shapes = jax.eval_shape(coordinate, 0.0, published_fleet(), SPEED, RIGHT, even)
        assert not any(leaf.weak_type for leaf in jax.tree.leaves(shapes))
