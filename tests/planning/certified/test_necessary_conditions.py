"""Necessary conditions of a path: distance, climb, keep-outs, and separation at the arrival."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser.environment import LayeredWind, SteadyWind
from anser.numerics.arrays import stack_rows
from anser.planning.certified import arrival_times
from anser.planning.certified import search as arrival_proposals
from anser.planning.certified.arrival_times import arrival_conflicts, arrival_distances_max, climb_times_min, may_arrive
from anser.planning.certified.search import FleetTask, search
from anser.planning.certified.task import ArrivalRequest, KeepOuts
from support.aircraft_tasks import CLIMB_MAX, SPEED_MAX, aircraft_task, airspace
from support.certified_cases import LAYERED, STEADY


def admissible_times(fleet):
    """Times allowed by the rule, and whether each meets the necessary conditions."""
    times = fleet.requested_times()
    return times, fleet.admissible(times)


def earliest_duration(goal, goal_velocity, wind):
    """Shortest admissible duration of a dense grid, s."""
    durations = np.linspace(1.0, 400.0, 7981)
    task, indices = stack_rows([aircraft_task(goal, goal_velocity)]), np.zeros(durations.size, dtype=int)
    admissible = may_arrive(task, airspace(wind), indices, durations)
    assert np.all(np.diff(admissible.astype(int)) >= 0)
    return durations[np.argmax(admissible)]


@pytest.mark.parametrize("count", [1, 3])
def test_no_arrival_times_are_an_empty_answer(count):
    """All delays of an arrival may lie beyond the flight's end."""
    tasks = stack_rows([aircraft_task((24_000.0, 10_000.0, -1700.0), (0.0, 0.0, 0.0))] * count)
    fleet = FleetTask(tasks, airspace(STEADY), ArrivalRequest("together", 72.0))
    assert fleet.admissible(np.empty((0, count))).shape == (0,)


def test_a_path_is_too_long_even_with_tail_wind_and_greatest_speed():
    wind = float(np.hypot(*np.asarray(STEADY.velocity_n)[:2]))
    level = (24_000.0, 10_000.0, -1700.0)  # the rendezvous is 26 km away
    np.testing.assert_allclose(
        earliest_duration(level, (0.0, 0.0, 0.0), STEADY), 26_000.0 / (SPEED_MAX + wind), rtol=0.01
    )
    # A goal that comes nearer by 26 m/s: as much sooner.
    coming = earliest_duration(level, (-24.0, -10.0, 0.0), STEADY)
    np.testing.assert_allclose(coming, 26_000.0 / (SPEED_MAX + wind + 26.0), rtol=0.01)
    # Of a layered wind the strongest layer within reach counts.
    layer = float(np.max(np.linalg.norm(np.asarray(LAYERED.velocities_n), axis=1)))
    assert (
        26_000.0 / (SPEED_MAX + 1.05 * layer)
        < earliest_duration(level, (0.0, 0.0, 0.0), LAYERED)
        < 26_000.0 / SPEED_MAX
    )


def test_a_jet_between_two_layers_counts():
    """A jet of 60 m/s, 100 m thick, in a range of altitudes of 11 km."""
    jet = LayeredWind(
        jnp.array([0.0, 5050.0, 5100.0, 5150.0]),
        jnp.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [60.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    )
    earliest = earliest_duration((26_000.0, 0.0, -10_000.0), (0.0, 0.0, 0.0), jet)
    np.testing.assert_allclose(earliest, max(26_000.0 / (SPEED_MAX + 60.0), 8300.0 / CLIMB_MAX), rtol=0.01)


@pytest.mark.parametrize(("rate_m_s", "counts"), [(-5.0, True), (0.0, False), (5.0, False)])
def test_a_layer_counts_that_a_climbing_goal_reaches_later(rate_m_s, counts):
    """A tail wind of 60 m/s from 6,000 m up, above a goal at 1,700 m that climbs at 5 m/s for 900 s and more."""
    aloft = LayeredWind(jnp.array([0.0, 5000.0, 6000.0]), jnp.array([[0.0, 0.0, 0.0]] * 2 + [[60.0, 0.0, 0.0]]))
    task = stack_rows([aircraft_task((230_000.0, 0.0, -1700.0), (0.0, 0.0, rate_m_s))])
    durations = np.array([230_000.0 / (SPEED_MAX + 50.0)])
    assert may_arrive(task, airspace(aloft), np.array([0]), durations).all() == counts


def test_the_times_of_the_search_begin_before_the_first_that_can_be_reached(monkeypatch):
    """Of a slow aircraft in a strong tail wind, which closes in at more than 1.4 times its airspeed."""
    grids = []
    monkeypatch.setattr(
        arrival_times, "_open_times", lambda *args: grids.append(args[3]) or np.zeros(args[3].shape, dtype=bool)
    )
    task = stack_rows([aircraft_task((50_000.0, 0.0, -1700.0), (-20.0, 0.0, 0.0))])
    for wind_m_s, factor in ((0.0, 1.4), (150.0, 1.0 + (1.02 * 150.0 + 20.0) / SPEED_MAX)):
        arrival_times.arrival_sets(task, airspace(SteadyWind(jnp.array([wind_m_s, 0.0, 0.0]))), 600.0)
        np.testing.assert_allclose(grids.pop()[0, 0], 50_000.0 / (factor * SPEED_MAX), rtol=1e-12)


def test_a_path_is_too_steep_for_the_climb_rate():
    steep = earliest_duration((500.0, 0.0, -5700.0), (0.0, 0.0, 0.0), STEADY)
    # The wind blows level: it carries nobody upwards.
    np.testing.assert_allclose(steep, 4000.0 / CLIMB_MAX, atol=0.05)


@pytest.mark.parametrize("up_m", [-1500.0, -1e-3, -1e-10, 0.0, 1e-10, 1e-3, 1.0, 600.0])
@pytest.mark.parametrize("moving", [0.0, 5.0])
def test_a_small_climb_takes_a_small_time(up_m, moving):
    """From 2,000 m to a rendezvous `up_m` higher, with a sinking goal."""
    task = stack_rows([aircraft_task((9000.0, 0.0, -1700.0 - up_m), (0.0, 0.0, moving))])
    closing = CLIMB_MAX + moving if up_m > 0.0 else CLIMB_MAX - moving
    np.testing.assert_allclose(climb_times_min(task, airspace(STEADY)), abs(up_m) / closing, rtol=1e-9, atol=1e-12)


def test_a_goal_that_sinks_too_fast_is_never_reached_from_above():
    tasks = [aircraft_task((9000.0, 0.0, down), (0.0, 0.0, CLIMB_MAX)) for down in (-1600.0, -1700.0, -1800.0)]
    np.testing.assert_allclose(climb_times_min(stack_rows(tasks), airspace(STEADY)), [np.inf, 0.0, 100.0 / 80.0])


def test_limits_that_do_not_exist_rule_nothing_out():
    task = stack_rows([aircraft_task((5000.0, 0.0, -1700.0))])
    unlimited = eqx.tree_at(lambda t: (t.limits.speed_max, t.limits.climb_rate_max), task, (jnp.array([jnp.inf]),) * 2)
    assert may_arrive(unlimited, airspace(STEADY), np.array([0]), np.array([1.0])).all()


def test_a_rendezvous_inside_a_moving_keep_out_is_inadmissible():
    """A volume of 2 km radius passes over a rendezvous 10 km away, at 50 m/s from the south; its goal moves at 10 m/s."""
    durations = np.linspace(80.0, 400.0, 641)
    task, indices = (
        stack_rows([aircraft_task((10_000.0, 0.0, -1000.0), (10.0, 0.0, 0.0))]),
        np.zeros(durations.size, dtype=int),
    )

    def open_below(bottom):
        volumes = KeepOuts(
            jnp.array([[0.0, 0.0]]), jnp.array([[50.0, 0.0]]), *(jnp.array([x]) for x in (2000.0, bottom, 5000.0))
        )
        with_volume = eqx.tree_at(lambda a: a.keep_outs, airspace(STEADY), volumes)
        return may_arrive(task, with_volume, indices, durations)

    # It gains 40 m/s on a rendezvous 10 km ahead: over it from 200 to 300 s.
    np.testing.assert_array_equal(open_below(0.0), (durations <= 200.0) | (durations >= 300.0))
    assert np.all(open_below(1300.0))  # the rendezvous is at 1,300 m


NEAR, FAR = (8000.0, 0.0, -1700.0), (8000.0, 400.0, -1700.0)  # goals 400 m apart
WIND = 1.02 * float(np.hypot(*np.asarray(STEADY.velocity_n)[:2]))


def test_simultaneous_arrivals_are_as_far_apart_as_the_rendezvous_points():
    two = stack_rows([aircraft_task(NEAR), aircraft_task(FAR, (0.0, 10.0, -2.0))])
    level, height = arrival_distances_max(two, airspace(STEADY), np.array([[60.0, 60.0], [100.0, 100.0]]))
    np.testing.assert_allclose(level[:, 0, 1], [1000.0, 1400.0])
    np.testing.assert_allclose(height[:, 1, 0], [120.0, 200.0])
    assert np.all(np.isinf(level[:, [0, 1], [0, 1]]))
    np.testing.assert_array_equal(level, np.swapaxes(level, 1, 2))


def test_the_later_aircraft_may_be_farther_away_by_its_flight_in_between():
    two = stack_rows([aircraft_task(NEAR), aircraft_task(FAR)])
    level, height = arrival_distances_max(two, airspace(STEADY), np.array([[60.0, 61.0], [63.0, 60.0]]))
    np.testing.assert_allclose(level[:, 0, 1], 400.0 + np.array([1.0, 3.0]) * (SPEED_MAX + WIND))
    np.testing.assert_allclose(height[:, 0, 1], np.array([1.0, 3.0]) * CLIMB_MAX)  # the wind blows level


@pytest.mark.parametrize(
    ("apart", "delay", "expected"),
    [((500.0, 0.0), 0.0, True), ((390.0, 0.0), 0.0, False), ((500.0, 150.0), 0.0, True), ((500.0, 0.0), 1.0, False)],
)
def test_a_conflict_violates_both_distances(apart, delay, expected):
    tasks = stack_rows([aircraft_task(NEAR), aircraft_task(FAR)])
    conflicts = arrival_conflicts(tasks, airspace(STEADY, *apart), np.array([[60.0, 60.0 + delay]]))[0]
    np.testing.assert_array_equal(conflicts, np.array([[False, expected], [expected, False]]))
    # Above each other by more than the vertical distance.
    above = stack_rows([aircraft_task(NEAR), aircraft_task((8000.0, 400.0, -1300.0))])
    assert not arrival_conflicts(above, airspace(STEADY, 500.0, 150.0), np.array([[60.0, 60.0]])).any()


def test_padding_aircraft_cause_no_conflict():
    two = stack_rows([aircraft_task(NEAR), eqx.tree_at(lambda t: t.active, aircraft_task(FAR), jnp.asarray(0.0))])
    assert not arrival_conflicts(two, airspace(STEADY, 5000.0), np.array([[60.0, 60.0]])).any()


def test_simultaneous_arrivals_without_a_speed_limit_are_no_farther_apart():
    unlimited = [
        eqx.tree_at(lambda t: t.limits.speed_max, aircraft_task(goal), jnp.asarray(jnp.inf)) for goal in (NEAR, FAR)
    ]
    level, _ = arrival_distances_max(stack_rows(unlimited), airspace(STEADY), np.array([[60.0, 60.0]]))
    np.testing.assert_allclose(level[0, 0, 1], 400.0)


def test_admissible_times_of_a_fleet():
    """The second goal moves away: 900 m apart from 50 s on; 27 s later, plus the flight in these 27 s."""
    two = stack_rows([aircraft_task(NEAR), aircraft_task(FAR, (0.0, 10.0, 0.0))])
    air = airspace(STEADY, 901.0)
    times, admissible = admissible_times(FleetTask(two, air, ArrivalRequest("earliest", 200.0)))
    reached = times[:, 0] >= 8000.0 / (SPEED_MAX + WIND)
    np.testing.assert_array_equal(admissible, reached & (times[:, 0] >= 50.0))
    late = ArrivalRequest("sequence", 200.0, offsets_s=np.array([0.0, 27.0]))
    times, admissible = admissible_times(FleetTask(two, air, late))
    assert times[-1, 1] == 200.0
    assert admissible[times[:, 0] > 60.0].all()
    _, admissible = admissible_times(FleetTask(two, air, ArrivalRequest("at", 200.0, times_s=np.array([45.0, 45.0]))))
    assert admissible.tolist() == [False]


@pytest.mark.long
@pytest.mark.parametrize("rule", ["earliest", "together", "at"])
def test_a_fleet_in_conflict_at_every_arrival_time_is_refused_early(rule, monkeypatch):
    def never(*arguments, **options):
        raise AssertionError("arrival sets were looked for")

    monkeypatch.setattr(arrival_proposals, "arrival_sets", never)
    two = stack_rows([aircraft_task(NEAR), aircraft_task(FAR)])
    times = np.array([70.0, 70.0]) if rule == "at" else None
    outcome = search(0.0, two, airspace(STEADY, 500.0), ArrivalRequest(rule, 200.0, times))
    assert outcome.plan is None
    assert outcome.attempts <= 1
