"""Exit paths of aircraft that leave the fleet: where they begin, and what they keep clear of."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.environment import SteadyWind
from anser.missions.event_replanning import EXIT_TURNS, _exit_violations, exit_start, plan_exit
from anser.planning import TimedPath
from anser.planning.certified.certified_plan import CertifiedPlan, certify
from anser.planning.certified.planner import CertifiedPlanState
from anser.planning.certified.profile import KINKS
from anser.planning.certified.routes import PIECES
from anser.planning.certified.task import KeepOuts
from anser.planning.holds.hold_paths import HoldCircle, PlannedHolds
from support.aircraft_tasks import aircraft_task, airspace

INTERVALS, END, SPEED, RADIUS = 64, 200.0, 150.0, 2000.0
NOW, ARRIVALS = 60.0, (100.0, 50.0)
SEPARATION_M = 2500.0


def space(north_m, radius_m=1500.0):
    """Airspace with a keep-out on the axis."""
    rows = jnp.array([[north_m, 0.0]]), jnp.zeros((1, 2)), *(jnp.array([x]) for x in (radius_m, 0.0, 3000.0))
    return eqx.tree_at(lambda a: a.keep_outs, airspace(SteadyWind(jnp.zeros(3)), SEPARATION_M, 0.0), KeepOuts(*rows))


SPACE = space(1e6)
_exit_start, _plan_exit = compiled_quickly(exit_start), compiled_quickly(plan_exit)
_position_at = jax.jit(jax.vmap(TimedPath.position_n, in_axes=(None, 0)))


def timed_path(place, times):
    rows = [jax.vmap(f)(times) for f in (place, jax.jacfwd(place), jax.jacfwd(jax.jacfwd(place)))]
    air = jnp.stack(rows, axis=1)
    return TimedPath(times, air, jnp.zeros_like(air))


def approach(arrival_s, north_m):
    """North along the axis, at the position `north_m` at `NOW`."""
    times = jnp.linspace(0.0, arrival_s, INTERVALS + 1 + PIECES - 1 + KINKS)
    return timed_path(lambda t: jnp.stack([north_m + SPEED * (t - NOW), 0.0 * t, -2000.0 + 0.0 * t]), times)


def circle(arrival_s, north_m):
    """Clockwise around a point of the axis."""
    rate = SPEED / RADIUS
    times = jnp.linspace(arrival_s, END, 129)
    return timed_path(
        lambda t: jnp.stack([north_m + RADIUS * jnp.cos(rate * t), RADIUS * jnp.sin(rate * t), -2000.0 + 0.0 * t]),
        times,
    )


def stacked(*parts):
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)


@compiled_quickly
def fleet_state(arrivals):
    """The first aircraft under way at the origin; the second 6 km ahead, in its hold if it has arrived at `NOW`."""
    # One that has arrived continues straight on far away; its hold is what it flies.
    paths = stacked(approach(arrivals[0], 0.0), approach(arrivals[1], 60000.0))
    tasks = stacked(aircraft_task((15000.0, 0.0, -1700.0)), aircraft_task((6000.0, 0.0, -1700.0)))
    plan = CertifiedPlan(
        paths, arrivals, certify(paths, tasks, SPACE, INTERVALS), jnp.ones(2, dtype=bool), *[jnp.zeros(2)] * 3
    )
    holds = PlannedHolds(
        paths=stacked(circle(arrivals[0], 40000.0), circle(arrivals[1], 6000.0)),
        circles=HoldCircle(*[jnp.full(2, x) for x in (RADIUS, 1.0, 300.0)]),
        goal_positions_n=tasks.goal_position_n,
        goal_velocities_n=tasks.goal_velocity_n,
        forecast_time=jnp.asarray(0.0),
        clearance_ratio=jnp.full((2, 2), jnp.inf),
        keep_out_clearance=jnp.zeros((2, 1)),
        clear=jnp.ones(2, dtype=bool),
    )
    return CertifiedPlanState(plan, jnp.asarray(0), holds, tasks.limits), tasks


def leave(state, tasks, aircraft, turns=EXIT_TURNS, airspace_=SPACE):
    now, index = jnp.asarray(NOW), jnp.asarray(aircraft, dtype=jnp.int32)
    start = _exit_start(state, tasks, now, index)
    plan = _plan_exit(state, tasks, airspace_, now, index, start, jnp.asarray(END), jnp.asarray(turns))
    return start, plan, jax.tree.map(lambda leaf: leaf[aircraft], plan.paths)


def turn_of(start, path):
    """Turn of an exit path from its start to its end, rad."""
    courses = [float(jnp.arctan2(v[1], v[0])) for v in (start.air_velocity_n, path.air_n[-1, 1])]
    return (courses[1] - courses[0] + np.pi) % (2 * np.pi) - np.pi


def distance_min(path, hold):
    times = jnp.arange(NOW, END, 0.05)
    return float(jnp.min(jnp.linalg.norm(_position_at(path, times) - _position_at(hold, times), axis=1)))


@pytest.mark.long
def test_an_exit_path_keeps_clear_of_a_hold_that_another_aircraft_flies():
    state, tasks = fleet_state(jnp.array(ARRIVALS))
    hold = jax.tree.map(lambda leaf: leaf[1], state.holds.paths)
    start, plan, path = leave(eqx.tree_at(lambda s: s.holds, state, None), tasks, 0)
    assert turn_of(start, path) == pytest.approx(0.0, abs=1e-9)
    assert distance_min(path, hold) < SEPARATION_M
    start, plan, path = leave(state, tasks, 0)
    assert turn_of(start, path) != pytest.approx(0.0, abs=1e-9)
    assert distance_min(path, hold) >= SEPARATION_M
    assert float(plan.arrival_times[0]) == END
    # The hold moves with its goal: far away it is in nobody's way.
    moved = eqx.tree_at(lambda t: t.goal_position_n, tasks, tasks.goal_position_n.at[1, 1].add(20000.0))
    start, _, path = leave(state, moved, 0)
    assert turn_of(start, path) == pytest.approx(0.0, abs=1e-9)


def test_without_a_turn_clear_of_all_holds_those_flown_count():
    """The hold of an aircraft that has not arrived can be chosen anew, that of one that has arrived cannot."""
    arrivals = jnp.array([100.0, 75.0])
    state, tasks = fleet_state(arrivals)
    start, _, path = leave(state, tasks, 0, turns=[0.0, 0.1])
    assert turn_of(start, path) == pytest.approx(0.0, abs=1e-9)
    arrived = eqx.tree_at(lambda s: s.plan.arrival_times, state, arrivals.at[1].set(NOW - 1.0))
    hold = jax.tree.map(lambda leaf: leaf[1], state.holds.paths)
    distances = [distance_min(leave(arrived, tasks, 0, turns=[turn, turn])[2], hold) for turn in (0.0, 0.1)]
    path = leave(arrived, tasks, 0, turns=[0.0, 0.1])[2]
    assert max(distances) < SEPARATION_M
    assert distance_min(path, hold) == pytest.approx(max(distances))


def test_an_exit_path_keeps_clear_of_keep_outs_and_within_limits_where_a_turn_does():
    state, tasks = fleet_state(jnp.array(ARRIVALS))
    tasks = eqx.tree_at(lambda t: t.goal_position_n, tasks, tasks.goal_position_n.at[1, 1].add(60000.0))
    scenario = SimpleNamespace(keep_out=[SimpleNamespace(name="cell")], event=[])

    def turn_and_violations(tasks, airspace_):
        start, plan, path = leave(state, tasks, 0, [0.0, 0.5], airspace_)
        assert float(plan.certificate.clearance_ratio[0, 1]) >= 1.0
        return turn_of(start, path), _exit_violations(scenario, plan, 0)

    assert turn_and_violations(tasks, SPACE) == (pytest.approx(0.0, abs=1e-9), "")
    # The keep-out is 6 km ahead.
    turn, violations = turn_and_violations(tasks, space(6000.0))
    assert turn == pytest.approx(0.5)
    assert violations == ""
    # No turn leads out of a keep-out, or up to a least altitude.
    turn, violations = turn_and_violations(tasks, space(0.0, 5000.0))
    assert turn == pytest.approx(0.0, abs=1e-9)
    assert violations.startswith('; the exit path enters the keep-out "cell": no turn that was tried avoids this')
    low = eqx.tree_at(lambda t: t.limits.altitude_min, tasks, jnp.full(2, 2500.0))
    _, violations = turn_and_violations(low, space(0.0, 5000.0))
    assert (
        'enters the keep-out "cell" and exceeds the limit of the least altitude (limits.altitude_min_m)' in violations
    )


@pytest.mark.parametrize("goal_rate_m_s", [0.0, 5.0, 50.0])
def test_an_aircraft_leaves_from_its_path_or_from_the_hold_that_it_flies(goal_rate_m_s):
    state, tasks = fleet_state(jnp.array(ARRIVALS))
    tasks = eqx.tree_at(lambda t: t.goal_velocity_n, tasks, tasks.goal_velocity_n.at[1, 0].add(goal_rate_m_s))
    for aircraft, paths in ((0, state.plan.paths), (1, state.holds.paths)):
        flown = jax.tree.map(lambda leaf, k=aircraft: leaf[k], paths)
        start, _, path = leave(state, tasks, aircraft)
        expected = np.array([flown.position_n(NOW), flown.velocity_n(NOW), flown.at(NOW).acceleration_n])
        if aircraft == 1:
            expected[1, 0] += goal_rate_m_s  # the hold moves with its goal
        if aircraft == 1 and goal_rate_m_s == 50.0:
            # Beyond the tolerance the planned hold is not flown: the exit begins at the measured motion.
            expected = np.array([tasks.position_n[1], tasks.air_velocity_n[1], np.zeros(3)])
        np.testing.assert_allclose(
            [start.position_n, start.air_velocity_n, start.air_acceleration_n], expected, rtol=1e-9, atol=1e-6
        )
        begun = [np.asarray(x) for x in (path.position_n(NOW), path.velocity_n(NOW))]
        np.testing.assert_allclose(begun, expected[:2], rtol=1e-9, atol=1e-6)
