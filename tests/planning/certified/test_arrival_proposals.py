"""Proposed arrival times: the preferred times, or the earliest feasible times after them."""

import contextlib
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser.environment import SteadyWind
from anser.numerics.arrays import stack_rows
from anser.planning.certified import search as search_module
from anser.planning.certified.arrival_times import straight_times
from anser.planning.certified.search import FleetTask, first_stage, later_stage, search
from anser.planning.certified.task import ArrivalRequest, KeepOuts
from anser.planning.certified.timed_profiles import MINIMAL, STANDARD
from support.aircraft_tasks import aircraft_task, airspace
from support.certified_cases import STEADY

NEAR_ENOUGH = 1.0085  # a step of the search, and the part by which the first time is later than the direct path takes
CALM = SteadyWind(jnp.zeros(3))
LATEST_S = 300.0


SIZE = 6  # aircraft of every fleet, some of them not active, so that all share one program


def fleet_of(*tasks, wind=CALM, rule="together", **rule_times):
    """A fleet of tasks, or of tasks towards goals at rest."""
    active = [aircraft_task(task) if isinstance(task, tuple) else task for task in tasks]
    spare = eqx.tree_at(lambda t: t.active, active[-1], jnp.asarray(0.0))
    filled = {key: np.concatenate([values, values[[-1] * (SIZE - len(values))]]) for key, values in rule_times.items()}
    fleet = stack_rows([*active, *[spare] * (SIZE - len(active))])
    return FleetTask(fleet, airspace(wind), ArrivalRequest(rule, LATEST_S, **filled))


def planned(fleet, is_feasible):
    """Arrival times of the last plan, and the attempts as (times, candidates).

    `is_feasible(times, candidate_set)` returns whether each aircraft has a path.
    """
    planned_times, tried, indices = None, [], fleet.indices
    for stage in (first_stage(fleet, True), later_stage(fleet)):
        with contextlib.suppress(StopIteration):
            proposal = next(stage)
            while True:
                times = proposal.times[indices]
                tried.append((times, proposal.candidate_set))
                failed = np.zeros(SIZE, dtype=bool)
                failed[indices] = ~is_feasible(times, proposal.candidate_set)
                planned_times = planned_times if failed.any() else times
                proposal = stage.send(failed)
        if planned_times is not None:
            break
    return planned_times, tried


def test_a_millimetre_of_climb_delays_nobody():
    heights = [-1700.0 - up for up in (-1e-3, -1e-10, 0.0, 1e-10, 1e-3, 10.0)]
    for north in (300.0, 500.0, 800.0, 9000.0):
        fleet = fleet_of(*[(north + 2000.0, 0.0, height) for height in heights])
        np.testing.assert_allclose(fleet.preferred_times, fleet.preferred_times[2], rtol=2e-3)
        np.testing.assert_allclose(fleet.preferred_times[:5], fleet.preferred_times[2], rtol=1e-6)


def test_a_goal_without_a_direct_path_has_the_time_of_the_straight_way():
    """Ten metres ahead: shorter than any path with turns; the iteration for the direct path stays where it begins."""
    assert fleet_of((10.0, 0.0, -1700.0)).preferred_times[0] == 1.0  # the least time


def test_the_first_time_is_that_of_the_straight_way():
    fleet = fleet_of((9000.0, 0.0, -1700.001), (6000.0, 0.0, -1500.0))
    proposal = next(first_stage(fleet, True))
    np.testing.assert_allclose(proposal.times[fleet.indices], 60.0, rtol=5e-4)
    assert proposal.candidate_set is MINIMAL


@pytest.mark.parametrize("delay_factor", [1.004, 1.02, 1.3, 1.9])
@pytest.mark.parametrize("every_kind_before", [1.0, 0.97, 0.8])
def test_the_search_ends_at_the_first_time_with_a_plan(delay_factor, every_kind_before):
    """The standard candidates are feasible from one time on, the others from an earlier time on."""
    fleet = fleet_of((9000.0, 0.0, -1700.0), (6000.0, 0.0, -1500.0))
    standard_s = 60.0 * delay_factor
    first_s = max(standard_s * every_kind_before, 60.0)

    def is_feasible(times, candidate_set):
        return times >= (standard_s if candidate_set in (MINIMAL, STANDARD) else first_s)

    times, tried = planned(fleet, is_feasible)
    assert first_s <= times[0] <= NEAR_ENOUGH * first_s
    assert times[0] == times[1]
    assert len(tried) < 90


def test_an_island_that_is_narrow_is_not_jumped_over():
    fleet = fleet_of((9000.0, 0.0, -1700.0))
    times, _ = planned(fleet, lambda times, kind: ((times > 66.0) & (times < 66.6)) | (times > 75.0))
    assert 66.0 < times[0] < 66.6


def test_a_sequence_is_put_off_as_a_whole():
    offsets_s = np.array([0.0, 12.0])
    fleet = fleet_of((6000.0, 0.0, -1500.0), (9000.0, 0.0, -1700.0), rule="sequence", offsets_s=offsets_s)
    times, _ = planned(fleet, lambda times, kind: np.full(2, True))
    np.testing.assert_allclose(times, [48.0, 60.0], rtol=1e-3)
    times, _ = planned(fleet, lambda times, kind: times > np.array([0.0, 63.0]))
    np.testing.assert_allclose(times[1] - times[0], 12.0)
    assert 63.0 < times[1] < NEAR_ENOUGH * 63.0


def test_aircraft_with_windows_are_delayed_individually():
    windows_s = np.array([[30.0, 100.0], [50.0, 90.0], [90.0, 120.0]])
    goals = (9000.0, 0.0, -1700.0), (6000.0, 0.0, -1500.0), (7000.0, 0.0, -1600.0)
    fleet = fleet_of(*goals, rule="windows", windows_s=windows_s)
    times, _ = planned(fleet, lambda times, kind: np.full(3, True))
    np.testing.assert_allclose(times, [60.0, 50.0, 90.0], rtol=1e-3)
    first_s = np.array([60.0, 57.0, 101.0])
    times, _ = planned(fleet, lambda times, kind: times >= first_s)
    assert np.all((times >= first_s) & (times <= NEAR_ENOUGH * first_s))
    # The second one has no path with the usual candidates, the third none at all.
    usual_s = np.array([60.0, 1e3, 101.0])
    times, _ = planned(fleet, lambda times, kind: times >= np.where(kind in (MINIMAL, STANDARD), usual_s, first_s))
    assert np.all((times >= first_s) & (times <= NEAR_ENOUGH * first_s))
    assert planned(fleet, lambda times, kind: times >= np.array([60.0, 57.0, 130.0]))[0] is None


@pytest.mark.parametrize("bearing_deg", [0.0, 20.0, 30.0, 60.0])
def test_turns_before_a_window_are_made_up_for_by_half_a_percent_of_airspeed(bearing_deg):
    """The start flies north in calm air; the straight line takes 60 s."""
    bearing = np.radians(bearing_deg)
    goal, windows_s = (9000.0 * np.cos(bearing), 9000.0 * np.sin(bearing), -1700.0), np.array([[1.0, 200.0]])
    direct_s = fleet_of(goal).preferred_times[0]
    window_s = fleet_of(goal, rule="windows", windows_s=windows_s).preferred_times[0]
    np.testing.assert_allclose(window_s, max(direct_s / 1.005, min(60.0, direct_s)), rtol=1e-9)
    assert (direct_s > 60.3) == (bearing_deg > 25.0)


@pytest.mark.parametrize("wind_north", [-110.0, -60.0, 0.0, 60.0, 140.0])
@pytest.mark.parametrize("rule", ["together", "windows"])
def test_the_preferred_time_counts_strong_wind_and_the_motion_of_the_goal(wind_north, rule):
    """The start flies north to a goal ahead that moves north at 25 m/s: distance over closing speed."""
    tasks = [aircraft_task((distance, 0.0, -1700.0), (25.0, 0.0, 0.0)) for distance in (2500.0, 3600.0)]
    windows = {"windows_s": np.tile([1.0, 250.0], (2, 1))} if rule == "windows" else {}
    fleet = fleet_of(*tasks, wind=SteadyWind(jnp.array([wind_north, 0.0, 0.0])), rule=rule, **windows)
    closing_speed = 150.0 + wind_north - 25.0
    np.testing.assert_allclose(fleet.preferred_times[:2], np.array([2500.0, 3600.0]) / closing_speed, rtol=2e-5)


def test_without_a_direct_path_the_preferred_time_is_that_of_the_straight_line():
    """The goal is abeam, nearer than a turn, and the wind blows across the line: a right-angled triangle of speeds."""
    fleet = fleet_of((0.0, 1000.0, -1700.0), wind=SteadyWind(jnp.array([-90.0, 0.0, 0.0])))
    np.testing.assert_allclose(fleet.preferred_times[0], 1000.0 / np.sqrt(150.0**2 - 90.0**2), rtol=1e-12)


def test_the_time_of_the_straight_line_is_that_through_the_moving_air():
    goals = (
        ((9000.0, -3000.0, -1900.0), (12.0, -7.0, 0.0)),
        ((20.0, 500.0, 0.0),),
        ((9000.0, 0.0, -1700.0), (140, 0, 0)),
    )
    tasks = stack_rows([aircraft_task(*goal) for goal in goals])
    times = np.asarray(straight_times(tasks, airspace(STEADY)))
    drift = np.asarray(tasks.goal_velocity_n) - np.asarray(STEADY.velocity_n)
    flown = np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n) + times[:, None] * drift
    np.testing.assert_allclose(np.linalg.norm(flown, axis=1), 150.0 * times, rtol=1e-12)


def test_the_straight_time_to_a_goal_that_outruns_the_aircraft_is_that_to_its_initial_position():
    tasks = stack_rows([aircraft_task((9000.0, 0.0, -1700.0), (160.0, 0.0, 0.0))])
    np.testing.assert_allclose(straight_times(tasks, airspace(CALM)), [60.0], rtol=1e-12)


def test_proposals_end_at_the_latest_arrival_or_the_window():
    late = fleet_of((9000.0, 0.0, -1700.0))
    assert max(times.max() for times, _ in planned(late, lambda times, kind: times > 1e9)[1]) <= LATEST_S
    window = fleet_of((9000.0, 0.0, -1700.0), rule="windows", windows_s=np.array([[55.0, 70.0]]))
    assert max(times.max() for times, _ in planned(window, lambda times, kind: times > 1e9)[1]) <= 70.0


@pytest.mark.long
def test_a_fleet_without_an_active_aircraft_is_put_off_by_nothing():
    window = fleet_of((9000.0, 0.0, -1700.0), rule="windows", windows_s=np.array([[50.0, 70.0]]))
    nobody = FleetTask(eqx.tree_at(lambda t: t.active, window.tasks, jnp.zeros(SIZE)), window.airspace, window.request)
    np.testing.assert_array_equal(next(later_stage(nobody)).times, next(first_stage(window, True)).times)


def test_the_proposals_do_not_depend_on_the_heading():
    """One task rotated to 24 headings, together with its wind."""
    last_s = 70.0

    def turned(vector, angle):
        north, east, down = vector
        cosine, sine = np.cos(angle), np.sin(angle)
        return np.array([north * cosine - east * sine, north * sine + east * cosine, down])

    tasks = []
    for angle in np.radians(np.arange(0.0, 360.0, 15.0)):
        task = aircraft_task(turned((8000.0, 3000.0, -1701.0), angle), turned((-6.0, 8.0, 0.0), angle))
        tasks.append(eqx.tree_at(lambda t: t.air_velocity_n, task, jnp.asarray(turned((150.0, 0.0, 0.0), angle))))
    arrivals = []
    for angle, task in zip(np.radians(np.arange(0.0, 360.0, 15.0)), tasks, strict=True):
        wind = SteadyWind(jnp.asarray(turned(np.asarray(STEADY.velocity_n), angle)))
        fleet = fleet_of(task, wind=wind)
        times, _ = planned(fleet, lambda times, kind: times > last_s)
        arrivals.append(times[0])
    assert np.ptp(arrivals) < 1e-6


def test_further_kinds_of_paths_precede_a_delay_of_more_than_one_step():
    """Without paths at the first two times, further kinds are tried there before a third time."""
    fleet = fleet_of((9000.0, 0.0, -1700.0), (6000.0, 0.0, -1500.0))
    _, tried = planned(fleet, lambda times, kind: times > 1.015 * fleet.preferred_times[0])
    ratios = [float(times[0]) / fleet.preferred_times[0] for times, kind in tried if kind is not MINIMAL]
    kinds = [kind for _, kind in tried if kind is not MINIMAL]
    third = next(k for k, ratio in enumerate(ratios) if ratio > 1.01)
    assert [kind is STANDARD for kind in kinds[:third]] == [True, True, True] + [False] * (third - 3)
    assert set(fleet.levels[1:]) <= set(kinds[:third])
    assert kinds[third] is STANDARD


def test_standard_candidates_are_generated_once_for_consecutive_attempts_at_a_time(monkeypatch):
    generated = []

    def standard_candidates(start_time, tasks, airspace, times, intervals, candidate_set=STANDARD):
        if candidate_set is STANDARD:
            generated.append(float(times[0]))

    def plans_at(start_time, tasks, airspace, times, intervals, candidate_set, *others):
        feasible = np.full(SIZE, candidate_set not in (MINIMAL, STANDARD))
        yield SimpleNamespace(arrival_times=np.asarray(times), feasible=feasible)

    monkeypatch.setattr(search_module, "standard_candidates", standard_candidates)
    monkeypatch.setattr(search_module, "plans_at", plans_at)
    fleet = fleet_of((9000.0, 0.0, -1700.0), (6000.0, 0.0, -1500.0))
    at_once = ArrivalRequest("at", LATEST_S, times_s=np.full(SIZE, 80.0))
    assert search(0.0, fleet.tasks, fleet.airspace, at_once).plan is not None
    assert generated == [80.0]


def replace_plans(monkeypatch, plans_at):
    """Replace the plans of the search; no candidates are generated."""
    monkeypatch.setattr(search_module, "standard_candidates", lambda *arguments: None)
    monkeypatch.setattr(search_module, "plans_at", plans_at)


@pytest.mark.parametrize("standard_delay", [1.0, 1.1])
def test_the_outcome_has_the_last_failed_attempt_before_the_plan(monkeypatch, standard_delay):
    """Paths exist from 66 s on; with the standard candidates only later, so that some later attempts fail too."""
    first_s = 66.0

    def plans_at(start_time, tasks, airspace, times, intervals, candidate_set, *others):
        is_late = np.asarray(times) >= first_s * (standard_delay if candidate_set in (MINIMAL, STANDARD) else 1.0)
        yield SimpleNamespace(arrival_times=np.asarray(times), feasible=is_late, candidate_set=candidate_set)

    replace_plans(monkeypatch, plans_at)
    fleet = fleet_of((9000.0, 0.0, -1700.0), (6000.0, 0.0, -1500.0))
    outcome = search(0.0, fleet.tasks, fleet.airspace, fleet.request)
    assert first_s <= outcome.plan.arrival_times[0] <= first_s * NEAR_ENOUGH
    earlier = outcome.earlier_attempt
    assert not earlier.feasible[0]
    assert outcome.plan.arrival_times[0] / NEAR_ENOUGH <= earlier.arrival_times[0] < outcome.plan.arrival_times[0]
    at_once = search(0.0, fleet.tasks, fleet.airspace, ArrivalRequest("at", LATEST_S, times_s=np.full(SIZE, 80.0)))
    assert at_once.earlier_attempt is None


def test_extra_candidates_are_not_tried_for_want_of_a_hold(monkeypatch):
    """Paths are proven at every time; holds exist from 75 s on."""
    first_s, candidate_sets = 75.0, []

    def plans_at(start_time, tasks, airspace, times, intervals, candidate_set, *others):
        candidate_sets.append(candidate_set)
        for _ in range(2):
            yield SimpleNamespace(arrival_times=np.asarray(times), feasible=np.ones(SIZE, dtype=bool))

    replace_plans(monkeypatch, plans_at)
    fleet = fleet_of((9000.0, 0.0, -1700.0), (6000.0, 0.0, -1500.0))
    outcome = search(
        0.0,
        fleet.tasks,
        fleet.airspace,
        fleet.request,
        failed_after_arrival=lambda plan: plan.arrival_times < first_s,
    )
    assert first_s <= outcome.plan.arrival_times[0] <= first_s * NEAR_ENOUGH
    assert set(candidate_sets) == {MINIMAL, STANDARD}
    assert len(candidate_sets) > 3


def test_paths_are_chosen_again_where_only_holds_are_missing(monkeypatch):
    """The second choice at the same times has holds and is taken, before any later time."""
    chosen = []

    def plans_at(start_time, tasks, airspace, times, intervals, candidate_set, *others):
        for choice in range(2):
            chosen.append((choice, float(times[0])))
            yield SimpleNamespace(arrival_times=np.asarray(times), feasible=np.ones(SIZE, dtype=bool), choice=choice)

    replace_plans(monkeypatch, plans_at)
    fleet = fleet_of((9000.0, 0.0, -1700.0), (6000.0, 0.0, -1500.0))
    outcome = search(
        0.0,
        fleet.tasks,
        fleet.airspace,
        fleet.request,
        failed_after_arrival=lambda plan: np.full(SIZE, plan.choice == 0),
    )
    first_s = chosen[0][1]
    assert chosen == [(0, first_s), (1, first_s)]
    assert outcome.plan.choice == 1
    assert outcome.plan_without_holds is None


def test_an_inactive_aircraft_has_no_effect_on_the_times_of_the_others():
    """One that has arrived or left recedes from its goal; its preferred time would be the latest."""
    far = eqx.tree_at(lambda t: t.active, aircraft_task((90000.0, 0.0, -1700.0)), jnp.asarray(0.0))
    near = (9000.0, 0.0, -1700.0), (6000.0, 0.0, -1500.0)
    fleets = [fleet_of(*near, far), fleet_of(*near)]
    for first_times in zip(*(next(first_stage(fleet, True)).times[:2] for fleet in fleets), strict=True):
        np.testing.assert_allclose(*first_times, rtol=1e-12)
    offsets_s = np.array([0.0, 10.0, 250.0])
    late, only = (
        fleet_of(*near, *others, rule="sequence", offsets_s=offsets_s[:count])
        for count, others in ((3, (far,)), (2, ()))
    )
    assert late.latest_first_s == only.latest_first_s == LATEST_S - 10.0
    assert late.requested_times()[-1, 1] == LATEST_S


def test_a_search_in_flight_has_the_keep_outs_where_they_are(monkeypatch):
    """A moving volume has left the rendezvous by the start of the search."""
    searches = []
    monkeypatch.setattr(search_module._Search, "run", lambda progress, *_: searches.append(progress))
    volume = KeepOuts(*(jnp.asarray(x) for x in ([[7200.0, 0.0]], [[30.0, 0.0]], [800.0], [0.0], [5000.0])))
    air = eqx.tree_at(lambda a: a.keep_outs, airspace(CALM), volume)
    tasks = stack_rows([aircraft_task((9000.0, 0.0, -1700.0))])
    request = ArrivalRequest("times", LATEST_S, times_s=np.array([60.0]))
    for start_s, is_clear in ((0.0, False), (100.0, True)):
        search(start_s, tasks, air, request)
        progress = searches.pop()
        np.testing.assert_array_equal(progress.fleet.airspace.keep_outs.position_n, [[7200.0 + 30.0 * start_s, 0.0]])
        assert progress.fleet.admissible(np.array([[60.0]]))[0] == is_clear
        assert progress.airspace is air  # of the attempts, whose paths begin at the start of the search
