"""Holds of a fleet: a smooth start, separation from holds and approaches, and bounds."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.control import GuidanceSettings
from anser.environment import LayeredWind, SteadyWind
from anser.parts import make_rendezvous
from anser.planning import PathLimits, Separation, TimedPath
from anser.planning.certified.task import AircraftTask, Airspace, KeepOuts
from anser.planning.holds.assignment import _candidate_circles, assign_holds
from anser.planning.holds.hold_paths import (
    GOAL_VELOCITY_TOLERANCE,
    broadcast_holds,
    choose_cell_count,
    hold_path,
    hold_reference,
    move_with_goals,
)

pytestmark = pytest.mark.long


SPEED, GRAVITY, END = 150.0, 9.81, 240.0
CELLS = choose_cell_count(END)
SETTINGS = GuidanceSettings(*(jnp.asarray(x) for x in (0.3, 20.0, 3000.0, 1.0, 20.0)))
WIND = LayeredWind(jnp.array([0.0, 2000.0]), jnp.array([[4.0, 0.0, 0.0], [8.0, 6.0, 0.0]]))
LIMITS = PathLimits(*(jnp.asarray(x) for x in (90.0, 240.0, np.deg2rad(55.0), 70.0, 100.0)))
assign = compiled_quickly(lambda paths, tasks, space: assign_holds(paths, tasks, space, SETTINGS, 0.0, END, CELLS))


def array_of(x):
    return jnp.asarray(x, dtype=float)


def straight(end, course_deg, arrival, wind_n):
    """A level approach of 60 s at `SPEED` in steady wind."""
    course = np.deg2rad(course_deg)
    air = SPEED * np.array([np.cos(course), np.sin(course), 0.0])
    times = arrival - 60.0 + 20.0 * np.arange(4)
    elapsed = (times - times[0])[:, None]
    begin = np.asarray(end) - 60.0 * (air + wind_n)
    knots = np.zeros((4, 3, 3))
    drift = np.zeros((4, 3, 3))
    knots[:, 0], knots[:, 1] = begin + elapsed * air, air
    drift[:, 0], drift[:, 1] = elapsed * wind_n, wind_n
    return TimedPath(array_of(times), array_of(knots), array_of(drift))


def stacked(parts):
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *parts)


def fleet(goals_n, velocities_n, heights, courses_deg, arrivals):
    """Approaches that end above the goals, and the planning tasks of the aircraft."""
    paths, tasks = [], []
    for goal, velocity, height, course, arrival in zip(
        goals_n, velocities_n, heights, courses_deg, arrivals, strict=True
    ):
        goal_n, velocity_n = np.append(goal, 0.0), np.append(velocity, 0.0)
        end = goal_n + arrival * velocity_n - np.array([0.0, 0.0, height])
        path = straight(end, course, arrival, np.asarray(WIND.at(array_of(end), 0.0)))
        paths.append(path)
        tasks.append(
            AircraftTask(
                position_n=path.position_n(0.0),
                air_velocity_n=path.air_velocity_n(0.0),
                air_acceleration_n=jnp.zeros(3),
                goal_position_n=array_of(goal_n),
                goal_velocity_n=array_of(velocity_n),
                rendezvous=make_rendezvous(array_of([0.0, 0.0, -height])),
                speed=array_of(SPEED),
                side=jnp.asarray(0, dtype=jnp.int32),
                limits=LIMITS,
                roll_rate_max=array_of(0.35),
                active=array_of(1.0),
            )
        )
    return stacked(paths), stacked(tasks)


def airspace(horizontal, vertical, keep_out=(9e5, 9e5, 100.0)):
    north, east, radius = keep_out
    volumes = KeepOuts(
        array_of([[north, east]]), jnp.zeros((1, 2)), array_of([radius]), array_of([0.0]), array_of([5000.0])
    )
    return Airspace(WIND, array_of(GRAVITY), Separation(array_of(horizontal), array_of(vertical)), volumes)


GOALS = [(0.0, 0.0), (1500.0, 900.0), (-300.0, 800.0)]
DRIFTS = [(5.0, 0.0), (0.0, -4.0), (0.0, 0.0)]


@functools.cache
def meeting():
    return fleet(GOALS, DRIFTS, [300.0, 320.0, 300.0], [20.0, 330.0, 190.0], [90.0, 90.0, 120.0])


def ratios(approaches, holds, horizontal, vertical, step=0.05):
    """Least ratio of distance to separation of each pair from the first arrival on, from dense samples."""
    times = np.arange(0.0, END, step)
    positions = []
    for k in range(approaches.times.shape[0]):
        path, hold = (jax.tree.map(lambda leaf, k=k: leaf[k], p) for p in (approaches, holds))
        on_path, in_hold = (np.asarray(jax.vmap(p.position_n)(array_of(times))) for p in (path, hold))
        positions.append(np.where((times > float(path.times[-1]))[:, None], in_hold, on_path))
    arrivals = np.asarray(approaches.times[:, -1])
    least_ratios = np.full((len(positions), len(positions)), np.inf)
    for i in range(len(positions)):
        for j in range(i):
            offset = positions[i] - positions[j]
            flat = np.hypot(offset[:, 0], offset[:, 1]) / horizontal
            tall = np.abs(offset[:, 2]) / vertical if vertical else np.zeros_like(flat)
            elapsed = times > min(arrivals[i], arrivals[j])
            least_ratios[i, j] = least_ratios[j, i] = np.min(np.maximum(flat, tall)[elapsed])
    return least_ratios


def own_circles(paths, tasks, space):
    """Flights with the scenario's circle for every aircraft: holds without planning."""

    def single(path, task):
        arrival = path.times[-1]
        circle = jax.tree.map(lambda leaf: leaf[0], _candidate_circles(task, space, SETTINGS))
        goal = task.goal_position_n + arrival * task.goal_velocity_n, task.goal_velocity_n
        begin = path.position_n(arrival), path.velocity_n(arrival), arrival
        return hold_path(task, begin, goal, circle, space.wind, END, SETTINGS, GRAVITY, CELLS)

    return jax.vmap(single)(paths, tasks)


@pytest.fixture(scope="module", params=[(500.0, 150.0), (450.0, 0.0)], ids=["or in altitude", "in the plane"])
def assigned(request):
    space = airspace(*request.param)
    return request.param, space, assign(*meeting(), space)


def test_assigned_holds_are_separated_unlike_the_scenarios_circles(assigned):
    separation, space, holds = assigned
    lost = ratios(meeting()[0], compiled_quickly(own_circles)(*meeting(), space), *separation)
    assert np.min(lost) < 0.8
    assert np.all(holds.clear)
    assert np.min(ratios(meeting()[0], holds.paths, *separation)) >= 1.0


def test_bounds_are_valid_between_the_samples_and_close(assigned):
    separation, _, holds = assigned
    sampled, proven = ratios(meeting()[0], holds.paths, *separation), np.asarray(holds.clearance_ratio)
    is_other = ~np.eye(3, dtype=bool)
    assert np.all(np.isinf(proven[~is_other]))
    assert np.all(proven[is_other] <= sampled[is_other] + 1e-9)
    # Slack of both, a h^2 / 8 with a up to 20 m/s^2 and h = 0.24 s, and the samples' own error: 0.3 m and 15 m/s x 0.05 s.
    assert np.all(proven[is_other] >= sampled[is_other] - 0.01)


def test_holds_start_smoothly_and_stay_within_limits(assigned):
    _, space, holds = assigned
    for k in range(3):
        path, hold = (jax.tree.map(lambda leaf, k=k: leaf[k], p) for p in (meeting()[0], holds.paths))
        arrival = path.times[-1]
        np.testing.assert_allclose(hold.position_n(arrival), path.position_n(arrival), atol=1e-6)
        np.testing.assert_allclose(hold.velocity_n(arrival), path.velocity_n(arrival), atol=1e-9)
        times = jnp.linspace(arrival, END, 4001)
        positions_n, air, rates = (
            jax.vmap(f)(times) for f in (hold.position_n, hold.air_velocity_n, hold.acceleration_n)
        )
        ground = jax.vmap(hold.velocity_n)(times)
        blowing = jax.vmap(lambda p: space.wind.at(p, 0.0))(positions_n)
        np.testing.assert_allclose(ground - blowing, air, atol=0.05)  # the drift is a quintic between knots 2 s apart
        assert np.all(np.abs(np.linalg.norm(air, axis=1) - SPEED) < 1.0)
        (u, v, _), (u_dot, v_dot, _) = np.asarray(air).T, np.asarray(rates).T
        side = np.abs(u * v_dot - v * u_dot) / SPEED
        assert np.max(side) <= GRAVITY * np.tan(float(LIMITS.bank_max))
        assert np.min(-np.asarray(positions_n)[:, 2]) >= 299.0
        goal = np.asarray(holds.goal_positions_n[k] + times[-1] * holds.goal_velocities_n[k])
        goal_distance = np.linalg.norm(np.asarray(positions_n)[-1, :2] - goal[:2])
        assert goal_distance == pytest.approx(float(holds.circles.radius[k]), rel=0.05)


def steep_hold(climb, load_factor_max):
    """Heights (m) and vertical accelerations (m/s^2) of a hold that starts with a climb rate at a height of 500 m."""
    _, tasks = fleet(GOALS[:1], [(0.0, 0.0)], [500.0], [20.0], [90.0])
    task = jax.tree.map(lambda leaf: leaf[0], tasks)
    task = eqx.tree_at(lambda t: t.limits.load_factor_max, task, array_of(load_factor_max))
    still = SteadyWind(jnp.zeros(3))
    begin = array_of([0.0, 0.0, -500.0]), array_of([170.0, 0.0, -climb]), array_of(90.0)
    circle = jax.tree.map(lambda leaf: leaf[0], _candidate_circles(task, airspace(500.0, 150.0), SETTINGS))
    hold = hold_path(task, begin, (jnp.zeros(3), jnp.zeros(3)), circle, still, END, SETTINGS, GRAVITY, CELLS)
    times = jnp.linspace(90.0, END, 2001)
    return -np.asarray(jax.vmap(hold.position_n)(times))[:, 2], np.asarray(jax.vmap(hold.acceleration_n)(times))[:, 2]


def test_a_steep_arrival_is_levelled_off_with_the_necessary_pull():
    """From 72 m/s of descent within 8 s: 9 m/s^2, a loss of 72^2 / 18 = 288 m (the demanded climb hides the lag)."""
    heights, pulls = steep_hold(-72.0, np.inf)
    assert 500.0 - np.min(heights) == pytest.approx(72.0**2 / 18.0, rel=0.02)
    assert np.max(-pulls) == pytest.approx(9.0, abs=0.4)
    # With little load factor to spare, no harder than that allows; as gently as ever where it is not steep.
    assert np.max(-steep_hold(-72.0, 1.8)[1]) == pytest.approx(0.75 * 0.8 * GRAVITY, abs=0.4)
    assert np.max(-steep_hold(-25.0, np.inf)[1]) == pytest.approx(4.0, abs=0.3)


def test_holds_stay_out_of_keep_outs():
    alone = jax.tree.map(lambda leaf: leaf[:1], meeting())
    unrestricted = assign(*alone, airspace(500.0, 150.0))
    track = np.asarray(
        jax.vmap(jax.tree.map(lambda leaf: leaf[0], unrestricted.paths).position_n)(jnp.linspace(100.0, 239.0, 400))
    )
    keep_out = (*track[300, :2], 400.0)
    holds = assign(*alone, airspace(500.0, 150.0, keep_out))
    assert bool(holds.clear[0])
    assert float(holds.keep_out_clearance[0, 0]) >= 0.0
    assert (float(unrestricted.circles.radius[0]), float(unrestricted.circles.turn[0])) != (
        float(holds.circles.radius[0]),
        float(holds.circles.turn[0]),
    )


def test_an_exit_path_to_the_end_of_the_flight_needs_no_hold():
    alone = jax.tree.map(lambda leaf: leaf[:1], fleet(GOALS, DRIFTS, [300.0] * 3, [20.0] * 3, [END] * 3))
    end_n = np.asarray(jax.tree.map(lambda leaf: leaf[0], alone[0]).position_n(END))
    everywhere = (*end_n[:2], 5000.0)
    assert bool(assign(*alone, airspace(500.0, 150.0, everywhere)).clear[0])
    sooner = jax.tree.map(lambda leaf: leaf[:1], fleet(GOALS, DRIFTS, [300.0] * 3, [20.0] * 3, [END - 1.0] * 3))
    assert not bool(assign(*sooner, airspace(500.0, 150.0, everywhere)).clear[0])


def test_aircraft_without_a_clear_hold_are_flagged():
    """Two aircraft that meet head-on at the arrival, only one horizontal separation apart: no hold is clear."""
    facing = fleet([(0.0, 0.0), (560.0, 0.0), (9e3, 0.0)], [(0.0, 0.0)] * 3, [300.0] * 3, [0.0, 180.0, 0.0], [90.0] * 3)
    holds = assign(*facing, airspace(500.0, 0.0))
    assert np.asarray(holds.clear).tolist() == [False, False, True]
    assert float(holds.clearance_ratio[0, 1]) < 0.9
    inactive = eqx.tree_at(lambda t: t.active, facing[1], array_of([1.0, 0.0, 1.0]))
    assert np.all(assign(facing[0], inactive, airspace(500.0, 0.0)).clear)


def test_an_aircraft_in_its_hold_keeps_it(assigned):
    _, space, holds = assigned
    _, tasks = meeting()
    time = 95.0
    new_velocities = tasks.goal_velocity_n + jnp.array([[1.0, -2.0, 0.0]])
    new_positions = tasks.goal_position_n + time * tasks.goal_velocity_n + 3.0
    moved_tasks = eqx.tree_at(lambda t: (t.goal_position_n, t.goal_velocity_n), tasks, (new_positions, new_velocities))
    reassigned = compiled_quickly(
        lambda former: assign_holds(
            meeting()[0], moved_tasks, space, SETTINGS, time, END, CELLS, move_with_goals(former, moved_tasks, time)
        )
    )(holds)
    expected = move_with_goals(holds, moved_tasks, time)
    for k, arrived in enumerate([True, True, False]):
        is_kept = np.allclose(reassigned.paths.air_n[k], expected.paths.air_n[k], atol=1e-9)
        assert is_kept == arrived
    # Seen from its goal the hold is where it was.
    path = jax.tree.map(lambda leaf: leaf[0], expected.paths)
    previous_path = jax.tree.map(lambda leaf: leaf[0], holds.paths)
    np.testing.assert_allclose(path.position_n(time) - previous_path.position_n(time), [3.0, 3.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(path.velocity_n(time) - previous_path.velocity_n(time), [1.0, -2.0, 0.0], atol=1e-9)


def test_the_reference_moves_with_the_goal_and_is_invalid_after_a_change_of_velocity(assigned):
    _, _, holds = assigned
    single = jax.tree.map(lambda leaf: leaf[0], broadcast_holds(holds))
    time = 120.0
    predicted_n = holds.goal_positions_n[0] + time * holds.goal_velocities_n[0]
    offset, rate = jnp.array([4.0, -3.0, 0.0]), jnp.array([0.5, 0.0, 0.0])
    reference, is_valid = hold_reference(single, time, predicted_n + offset, holds.goal_velocities_n[0] + rate, SPEED)
    assert bool(is_valid)
    path = jax.tree.map(lambda leaf: leaf[0], holds.paths)
    np.testing.assert_allclose(reference.position_n(time) - path.position_n(time), offset, atol=1e-9)
    np.testing.assert_allclose(reference.velocity_n(time) - path.velocity_n(time), rate, atol=1e-12)
    changed_velocity = holds.goal_velocities_n[0] + jnp.array([1.01 * GOAL_VELOCITY_TOLERANCE * SPEED, 0.0, 0.0])
    assert not bool(hold_reference(single, time, predicted_n, changed_velocity, SPEED)[1])
    assert not bool(hold_reference(single, END + 1.0, predicted_n, holds.goal_velocities_n[0], SPEED)[1])


@pytest.mark.parametrize("wind", [SteadyWind(jnp.array([3.0, 0.0, 0.0])), WIND], ids=["steady", "layers"])
def test_a_hold_computed_by_one_kernel_a_cell_is_the_same(wind):
    task = jax.tree.map(lambda leaf: leaf[0], meeting()[1])
    circle = jax.tree.map(lambda leaf: leaf[0], _candidate_circles(task, airspace(500.0, 150.0), SETTINGS))
    begin = array_of([0.0, 0.0, -300.0]), array_of([150.0, 0.0, -5.0]), array_of(10.0)
    goal = jnp.zeros(3), array_of([5.0, 2.0, 0.0])

    @functools.partial(jax.jit, static_argnames="one_kernel")
    def knots(end, one_kernel):
        path = hold_path(task, begin, goal, circle, wind, end, SETTINGS, GRAVITY, 16, one_kernel=one_kernel)
        return path.air_n + path.drift_n

    together, apart = (np.asarray(knots(60.0, one_kernel)) for one_kernel in (True, False))
    assert np.ptp(apart[:, 0, 0]) > 1000.0
    np.testing.assert_allclose(together, apart, rtol=1e-11, atol=1e-8)


def test_derivatives_are_finite():
    task = jax.tree.map(lambda leaf: leaf[0], meeting()[1])
    space = airspace(500.0, 150.0)
    circle = jax.tree.map(lambda leaf: leaf[0], _candidate_circles(task, space, SETTINGS))

    def end(goal_velocity_n):
        goal = jnp.zeros(3), goal_velocity_n
        begin = jnp.array([0.0, 0.0, -300.0]), jnp.array([150.0, 0.0, 0.0]), 10.0
        steady = SteadyWind(jnp.array([3.0, 0.0, 0.0]))
        return jnp.sum(hold_path(task, begin, goal, circle, steady, 60.0, SETTINGS, GRAVITY, 16).position_n(59.0))

    assert np.all(np.isfinite(jax.jit(jax.jacfwd(end))(jnp.array([5.0, 0.0, 0.0]))))
