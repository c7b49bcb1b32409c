"""What no path can do: too far, too steep, into a keep-out, too close to another at the arrival."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser.planning.certified import search as arrival_proposals
from anser.planning.certified.arrival_times import arrival_conflicts, arrival_distances_max, climb_times_min, may_arrive
from anser.planning.certified.search import FleetTask, search
from anser.planning.certified.task import ArrivalRequest, KeepOuts, stack_tasks
from support.aircraft_tasks import CLIMB_MAX, SPEED_MAX, aircraft_task, airspace
from support.certified_cases import LAYERED, STEADY


def admissible_times(fleet):
    """Times that the rule leaves open, and which of them nothing rules out."""
    times = fleet.requested_times()
    return times, fleet.admissible(times)


def earliest(goal, moving, wind):
    """First of many durations that is conceivable, s."""
    durations = np.linspace(1.0, 400.0, 7981)
    one, nobody = stack_tasks([aircraft_task(goal, moving)]), np.zeros(durations.size, dtype=int)
    good = may_arrive(one, airspace(wind), nobody, durations)
    assert np.all(np.diff(good.astype(int)) >= 0)
    return durations[np.argmax(good)]


def test_a_way_is_too_long_where_not_even_tail_wind_and_greatest_speed_will_do():
    wind = float(np.hypot(*np.asarray(STEADY.velocity_n)[:2]))
    level = (24_000.0, 10_000.0, -1700.0)  # the rendezvous is 26 km away
    np.testing.assert_allclose(earliest(level, (0.0, 0.0, 0.0), STEADY), 26_000.0 / (SPEED_MAX + wind), rtol=0.01)
    # A goal that comes nearer by 26 m/s: as much sooner.
    coming = earliest(level, (-24.0, -10.0, 0.0), STEADY)
    np.testing.assert_allclose(coming, 26_000.0 / (SPEED_MAX + wind + 26.0), rtol=0.01)
    # Of a layered wind the strongest layer within reach counts.
    layer = float(np.max(np.linalg.norm(np.asarray(LAYERED.velocities_n), axis=1)))
    assert 26_000.0 / (SPEED_MAX + 1.05 * layer) < earliest(level, (0.0, 0.0, 0.0), LAYERED) < 26_000.0 / SPEED_MAX


def test_a_way_is_too_steep_where_the_climb_takes_longer():
    steep = earliest((500.0, 0.0, -5700.0), (0.0, 0.0, 0.0), STEADY)
    # The wind blows level: it carries nobody upwards.
    np.testing.assert_allclose(steep, 4000.0 / CLIMB_MAX, atol=0.05)


@pytest.mark.parametrize("up_m", [-1500.0, -1e-3, -1e-10, 0.0, 1e-10, 1e-3, 1.0, 600.0])
@pytest.mark.parametrize("moving", [0.0, 5.0])
def test_a_small_climb_takes_a_small_time(up_m, moving):
    """From 2,000 m to a rendezvous that is higher by `up_m`, of a goal that sinks."""
    one = stack_tasks([aircraft_task((9000.0, 0.0, -1700.0 - up_m), (0.0, 0.0, moving))])
    closing = CLIMB_MAX + moving if up_m > 0.0 else CLIMB_MAX - moving
    np.testing.assert_allclose(climb_times_min(one, airspace(STEADY)), abs(up_m) / closing, rtol=1e-9, atol=1e-12)


def test_a_goal_that_sinks_too_fast_is_never_reached_from_above():
    one = [aircraft_task((9000.0, 0.0, down), (0.0, 0.0, CLIMB_MAX)) for down in (-1600.0, -1700.0, -1800.0)]
    np.testing.assert_allclose(climb_times_min(stack_tasks(one), airspace(STEADY)), [np.inf, 0.0, 100.0 / 80.0])


def test_limits_that_do_not_exist_rule_nothing_out():
    one = stack_tasks([aircraft_task((5000.0, 0.0, -1700.0))])
    free = eqx.tree_at(lambda t: (t.limits.speed_max, t.limits.climb_rate_max), one, (jnp.array([jnp.inf]),) * 2)
    assert may_arrive(free, airspace(STEADY), np.array([0]), np.array([1.0])).all()


def test_a_rendezvous_inside_a_closed_volume_is_no_way_while_it_is_there():
    """A cell of 2 km radius passes over a rendezvous 10 km away, from the south at 50 m/s; the goal moves with 10 m/s."""
    durations = np.linspace(80.0, 400.0, 641)
    one, nobody = (
        stack_tasks([aircraft_task((10_000.0, 0.0, -1000.0), (10.0, 0.0, 0.0))]),
        np.zeros(durations.size, dtype=int),
    )

    def open_below(bottom):
        volumes = KeepOuts(
            jnp.array([[0.0, 0.0]]), jnp.array([[50.0, 0.0]]), *(jnp.array([x]) for x in (2000.0, bottom, 5000.0))
        )
        there = eqx.tree_at(lambda a: a.keep_outs, airspace(STEADY), volumes)
        return may_arrive(one, there, nobody, durations)

    # It gains 40 m/s on a rendezvous 10 km ahead: over it from 200 to 300 s.
    np.testing.assert_array_equal(open_below(0.0), (durations <= 200.0) | (durations >= 300.0))
    assert np.all(open_below(1300.0))  # the rendezvous is at 1,300 m


NEAR, FAR = (8000.0, 0.0, -1700.0), (8000.0, 400.0, -1700.0)  # goals 400 m apart
WIND = 1.02 * float(np.hypot(*np.asarray(STEADY.velocity_n)[:2]))


def test_two_that_arrive_at_once_are_as_far_apart_as_their_rendezvous_points():
    two = stack_tasks([aircraft_task(NEAR), aircraft_task(FAR, (0.0, 10.0, -2.0))])
    level, height = arrival_distances_max(two, airspace(STEADY), np.array([[60.0, 60.0], [100.0, 100.0]]))
    np.testing.assert_allclose(level[:, 0, 1], [1000.0, 1400.0])
    np.testing.assert_allclose(height[:, 1, 0], [120.0, 200.0])
    assert np.all(np.isinf(level[:, [0, 1], [0, 1]]))
    np.testing.assert_array_equal(level, np.swapaxes(level, 1, 2))


def test_the_later_one_may_still_be_away_by_what_it_flies_meanwhile():
    two = stack_tasks([aircraft_task(NEAR), aircraft_task(FAR)])
    level, height = arrival_distances_max(two, airspace(STEADY), np.array([[60.0, 61.0], [63.0, 60.0]]))
    np.testing.assert_allclose(level[:, 0, 1], 400.0 + np.array([1.0, 3.0]) * (SPEED_MAX + WIND))
    np.testing.assert_allclose(height[:, 0, 1], np.array([1.0, 3.0]) * CLIMB_MAX)  # the wind blows level


@pytest.mark.parametrize(
    ("apart", "delay", "expected"),
    [((500.0, 0.0), 0.0, True), ((390.0, 0.0), 0.0, False), ((500.0, 150.0), 0.0, True), ((500.0, 0.0), 1.0, False)],
)
def test_crowded_is_what_neither_distance_allows(apart, delay, expected):
    two = stack_tasks([aircraft_task(NEAR), aircraft_task(FAR)])
    found = arrival_conflicts(two, airspace(STEADY, *apart), np.array([[60.0, 60.0 + delay]]))[0]
    np.testing.assert_array_equal(found, np.array([[False, expected], [expected, False]]))
    # Above each other by more than the vertical distance.
    above = stack_tasks([aircraft_task(NEAR), aircraft_task((8000.0, 400.0, -1300.0))])
    assert not arrival_conflicts(above, airspace(STEADY, 500.0, 150.0), np.array([[60.0, 60.0]])).any()


def test_nobody_keeps_clear_of_one_that_only_fills_up():
    two = stack_tasks([aircraft_task(NEAR), eqx.tree_at(lambda t: t.active, aircraft_task(FAR), jnp.asarray(0.0))])
    assert not arrival_conflicts(two, airspace(STEADY, 5000.0), np.array([[60.0, 60.0]])).any()


def test_without_greatest_speed_two_that_arrive_at_once_are_no_farther_apart():
    free = [
        eqx.tree_at(lambda t: t.limits.speed_max, aircraft_task(goal), jnp.asarray(jnp.inf)) for goal in (NEAR, FAR)
    ]
    level, _ = arrival_distances_max(stack_tasks(free), airspace(STEADY), np.array([[60.0, 60.0]]))
    np.testing.assert_allclose(level[0, 0, 1], 400.0)


def test_times_that_are_left_to_a_fleet():
    """The second goal moves away: 900 m apart from 50 s on, and 27 s later by what is flown in the 27 s."""
    two = stack_tasks([aircraft_task(NEAR), aircraft_task(FAR, (0.0, 10.0, 0.0))])
    air = airspace(STEADY, 901.0)
    times, good = admissible_times(FleetTask(two, air, ArrivalRequest("earliest", 200.0)))
    reached = times[:, 0] >= 8000.0 / (SPEED_MAX + WIND)
    np.testing.assert_array_equal(good, reached & (times[:, 0] >= 50.0))
    late = ArrivalRequest("sequence", 200.0, offsets_s=np.array([0.0, 27.0]))
    times, good = admissible_times(FleetTask(two, air, late))
    assert times[-1, 1] < 200.0
    assert good[times[:, 0] > 60.0].all()
    _, good = admissible_times(FleetTask(two, air, ArrivalRequest("at", 200.0, times_s=np.array([45.0, 45.0]))))
    assert good.tolist() == [False]


@pytest.mark.long
@pytest.mark.parametrize("rule", ["earliest", "together", "at"])
def test_a_fleet_that_is_crowded_whenever_it_arrives_is_not_looked_at_closely(rule, monkeypatch):
    def never(*about, **more):
        raise AssertionError("arrival sets were looked for")

    monkeypatch.setattr(arrival_proposals, "arrival_sets", never)
    two = stack_tasks([aircraft_task(NEAR), aircraft_task(FAR)])
    times = np.array([70.0, 70.0]) if rule == "at" else None
    outcome = search(0.0, two, airspace(STEADY, 500.0), ArrivalRequest(rule, 200.0, times))
    assert outcome.plan is None
    assert outcome.attempts <= 1
