"""Simultaneous arrival of a fleet (theory section 8)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from planning_cases import FleetCase, plan_at, published_fleet, random_fleet, stand_offs, velocity

from anser.planning import PLAN_MESSAGES, arc_length, coordinate, fit_trajectory, make_rendezvous
from anser.planning.coordination import DIRECTION_UNATTAINABLE, GOAL_OUTRUNS, NO_COMMON_TIME, PLANNED

RIGHT = jnp.ones(3)


def arrive(case: FleetCase, sides=RIGHT, time=0.0):
    return plan_at(time, *case, sides)


@jax.jit
def longest_path_takes(case: FleetCase, duration):
    """The published scheme written out for still air and free arrivals: how long the longest path takes."""
    ends = case.goal_positions_n + case.goal_velocities_n * duration + case.rendezvous.stand_off_n
    lines = ends - case.positions_n
    finals = case.speed * lines / jnp.linalg.norm(lines, axis=1)[:, None]
    paths = jax.vmap(lambda p, v, e, f: fit_trajectory(0.0, duration, p, v, e, f))(
        case.positions_n, case.air_velocities_n, ends, finals
    )
    return jnp.max(jax.vmap(arc_length)(paths)) / case.speed


along = jax.jit(lambda paths, time: jax.vmap(lambda path: (path.position_n(time), path.air_velocity_n(time)))(paths))
lengths_of = jax.jit(jax.vmap(arc_length))


def check_arrival(case: FleetCase, plan, time):
    """All fly the reference length and meet their moving goals together, as planned."""
    t_f = plan.arrival_time
    duration = t_f - time
    # Fixed point: the longest path at the airspeed takes the common time.
    assert abs(plan.reference_length / case.speed - duration) < 1e-9
    assert plan.reference_length == jnp.max(plan.nominal_lengths)
    assert plan.lateral_bends[plan.farthest] == 0.0
    np.testing.assert_allclose(lengths_of(plan.trajectories), plan.reference_length, atol=1e-6)
    here, start = along(plan.trajectories, time)
    there, final = along(plan.trajectories, t_f)
    goals = case.goal_positions_n + case.goal_velocities_n * duration + case.rendezvous.stand_off_n
    # Rounding of coefficients of up to 1e5 m.
    np.testing.assert_allclose(there, goals, atol=1e-8)
    np.testing.assert_allclose(here, case.positions_n, atol=1e-9)
    np.testing.assert_allclose(start, case.air_velocities_n, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(final, axis=1), case.speed, rtol=1e-10)


def test_published_three_aircraft_case():
    case = published_fleet()
    plan = arrive(case)
    assert np.all(plan.status == PLANNED)
    assert np.all(plan.converged & plan.goal_reachable)
    check_arrival(case, plan, 0.0)
    # Aircraft 1 is the farthest, 9 km from a rendezvous that lies ahead of it: it flies straight there,
    assert plan.farthest == 0
    # no shorter a way than the line to where the rendezvous will be, and longer by less than a percent.
    straight = jnp.linalg.norm(
        jnp.array([100.0, 0.0, -300.0]) + 25.0 * plan.arrival_time * jnp.array([1.0, 0.0, 0.0]) - case.positions_n[0]
    )
    assert straight <= plan.reference_length <= 1.01 * straight


@pytest.mark.parametrize("side", [(1.0, -1.0, 1.0), (1.0, 1.0, -1.0)])
def test_sides_of_the_detours(side):
    plan = arrive(published_fleet(), jnp.array(side))
    assert jnp.all(plan.lateral_bends * jnp.array(side) >= 0.0)
    assert jnp.sum(plan.lateral_bends == 0.0) == 1


@pytest.mark.parametrize("goal_speed_max", [30.0, 90.0])
def test_generic_fleets_with_goals_at_up_to_60_percent_of_the_airspeed(goal_speed_max):
    for seed in range(25):
        case = random_fleet(seed, goal_speed_max)
        plan = arrive(case, time=100.0)
        assert np.all(plan.converged), seed
        check_arrival(case, plan, 100.0)
        # It is the first such time: at no earlier one are all paths in time.
        for earlier in np.linspace(0.1, 0.999, 12) * float(plan.arrival_time - 100.0):
            assert longest_path_takes(case, earlier) > earlier


def test_fixed_point_agrees_with_plain_iteration():
    # The published scheme, iterated to rest: fit everything anew at T, then T = max L/V.
    case, duration = published_fleet(), 50.0
    for _ in range(100):
        duration = longest_path_takes(case, duration)
    np.testing.assert_allclose(arrive(case).arrival_time, duration, atol=1e-9)


def test_plan_in_wind_is_the_plan_in_still_air_seen_from_the_drifting_frame():
    wind = jnp.array([12.0, -20.0, 1.0])
    still = random_fleet(3, 40.0)
    windy = still._replace(goal_velocities_n=still.goal_velocities_n + wind[None], wind_n=jnp.tile(wind, (3, 1)))
    a, b = arrive(still, time=20.0), arrive(windy, time=20.0)
    np.testing.assert_allclose(b.arrival_time, a.arrival_time, rtol=1e-12)
    np.testing.assert_allclose(b.lateral_bends, a.lateral_bends, rtol=1e-7, atol=1e-6)
    for fraction in (0.0, 0.3, 1.0):
        time = 20.0 + fraction * (a.arrival_time - 20.0)
        in_still, in_wind = (along(plan.trajectories, time)[0] for plan in (a, b))
        # A bend to 1e-10 of the length moves the middle of the path by micrometres.
        np.testing.assert_allclose(in_wind, in_still + wind[None] * (time - 20.0), atol=1e-5)


def test_replanning_on_the_farthest_path_keeps_the_arrival_time():
    # Half a second on, the plan from there is nearly the same: the quartic family is not closed under restarts, so this
    # holds to a few milliseconds only.
    case = published_fleet()
    plan = arrive(case)
    later = case._replace(
        positions_n=along(plan.trajectories, 0.5)[0],
        air_velocities_n=along(plan.trajectories, 0.5)[1],
        goal_positions_n=case.goal_positions_n + 0.5 * case.goal_velocities_n,
    )
    np.testing.assert_allclose(arrive(later, time=0.5).arrival_time, plan.arrival_time, atol=0.01)


def test_an_outrunning_goal_is_flagged_and_the_others_are_planned():
    case = published_fleet()
    fleeing = case._replace(goal_velocities_n=case.goal_velocities_n.at[1].set(velocity(170.0, 0.8)))
    plan = arrive(fleeing)
    assert plan.status.tolist() == [PLANNED, GOAL_OUTRUNS, PLANNED]
    assert plan.goal_reachable.tolist() == [True, False, True]
    assert plan.converged.tolist() == [True, False, True]
    np.testing.assert_allclose(plan.arrival_time, arrive(case).arrival_time, rtol=1e-12)
    assert "outruns" in PLAN_MESSAGES[GOAL_OUTRUNS]


def test_all_outrun_stays_finite_and_bounded():
    case = published_fleet()
    away = case.goal_positions_n - case.positions_n
    fleeing = case._replace(goal_velocities_n=200.0 * away / jnp.linalg.norm(away, axis=1)[:, None])
    plan = arrive(fleeing)
    assert np.all(plan.status == GOAL_OUTRUNS)
    assert not np.any(plan.converged)
    assert plan.arrival_time < 1e3
    gradient = jax.jit(jax.grad(lambda p: coordinate(0.0, p, *fleeing[1:], RIGHT).arrival_time))(fleeing.positions_n)
    for leaf in jax.tree.leaves((plan, gradient)):
        assert jnp.all(jnp.isfinite(leaf))


@pytest.mark.parametrize("goal_speed_max", [135.0, 160.0, 400.0])
def test_fast_goals_never_give_nan(goal_speed_max):
    codes = set()
    for seed in range(20):
        plan = arrive(random_fleet(seed, goal_speed_max))
        assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(plan))
        assert np.all(plan.converged == (plan.status == PLANNED))
        codes |= set(plan.status.tolist())
    assert codes <= {PLANNED, GOAL_OUTRUNS, NO_COMMON_TIME}
    assert len(codes) > 1


def test_a_fleet_at_its_rendezvous_stays_finite():
    case = published_fleet()
    there = case._replace(positions_n=case.goal_positions_n + case.rendezvous.stand_off_n)
    assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(arrive(there)))


def test_prescribed_arrival_and_its_refusal():
    case = published_fleet()
    single = jax.tree.map(lambda leaf: leaf[:1], case._replace(speed=jnp.zeros(1)))._replace(speed=150.0)
    level_north = jax.tree.map(lambda leaf: leaf[None], make_rendezvous(jnp.array([0.0, 0.0, -300.0]), 0.0, 0.0))
    breeze = jnp.array([[0.0, 30.0, 0.0]])
    plan = plan_at(0.0, *single._replace(rendezvous=level_north, wind_n=breeze), jnp.ones(1))
    assert plan.status[0] == PLANNED
    final = jax.vmap(lambda path: path.velocity_n(plan.arrival_time))(plan.trajectories)[0]
    # Crab angle: the ground speed is sqrt(150^2 - 30^2), due North, level.
    np.testing.assert_allclose(final, [np.sqrt(150.0**2 - 30.0**2), 0.0, 0.0], atol=1e-9)
    storm = jnp.array([[0.0, 160.0, 0.0]])
    refused = plan_at(0.0, *single._replace(rendezvous=level_north, wind_n=storm, goal_velocities_n=storm), jnp.ones(1))
    assert refused.status[0] == DIRECTION_UNATTAINABLE


def test_published_single_case():
    # Theory section 8: one aircraft flies its nominal path.
    case = FleetCase(
        jnp.array([[0.0, 0.0, -1000.0]]),
        velocity(150.0, 0.0)[None],
        jnp.array([[5000.0, 0.0, 0.0]]),
        velocity(25.0, np.pi / 2)[None],
        stand_offs(1),
        150.0,
        jnp.zeros((1, 3)),
    )
    plan = plan_at(0.0, *case, jnp.ones(1))
    assert plan.status[0] == PLANNED
    check_arrival(case, plan, 0.0)


def test_gradient_against_finite_differences():
    case = published_fleet()

    @jax.jit
    def outcome(goal_velocities, speed):
        plan = coordinate(0.0, *case._replace(goal_velocities_n=goal_velocities, speed=speed), RIGHT)
        middle = jax.vmap(lambda path: path.position_n(20.0))(plan.trajectories)
        return jnp.concatenate([plan.arrival_time[None], plan.lateral_bends / 1e3, middle[:, 1] / 1e3])

    jacobian = jax.jit(jax.jacrev(outcome, argnums=(0, 1)))(case.goal_velocities_n, jnp.asarray(150.0))
    step = 1e-3
    for index in [(0, 0), (1, 1), (2, 1), (2, 2)]:
        shift = jnp.zeros((3, 3)).at[index].set(step)
        numeric = (
            outcome(case.goal_velocities_n + shift, jnp.asarray(150.0))
            - outcome(case.goal_velocities_n - shift, jnp.asarray(150.0))
        ) / (2.0 * step)
        # Central differences: step^2 truncation and 1e-10/step of solver residual.
        np.testing.assert_allclose(jacobian[0][:, index[0], index[1]], numeric, rtol=1e-5, atol=1e-6)
    numeric = (
        outcome(case.goal_velocities_n, jnp.asarray(150.0 + step))
        - outcome(case.goal_velocities_n, jnp.asarray(150.0 - step))
    ) / (2.0 * step)
    np.testing.assert_allclose(jacobian[1], numeric, rtol=1e-5, atol=1e-6)


def test_vmap_over_fleets():
    cases = [random_fleet(seed, 60.0) for seed in (5, 6)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *cases)
    plans = jax.jit(jax.vmap(lambda case: coordinate(0.0, *case, RIGHT)))(stacked)
    for index, case in enumerate(cases):
        np.testing.assert_allclose(plans.arrival_time[index], arrive(case).arrival_time, rtol=1e-12)
        np.testing.assert_allclose(plans.lateral_bends[index], arrive(case).lateral_bends, rtol=1e-8, atol=1e-6)


def test_no_weak_types():
    # A plan is carried through lax.cond and lax.scan, where weak types do not match strong ones.
    shapes = jax.eval_shape(coordinate, 0.0, *published_fleet(), RIGHT)
    assert not any(leaf.weak_type for leaf in jax.tree.leaves(shapes))
