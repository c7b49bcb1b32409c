"""Order of events, and the complete search if periodic replanning fails after a goal has changed."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from anser.missions import event_replanning
from anser.missions import events as events_module
from anser.missions.event_replanning import NO_PLAN_MESSAGE, EventOutcome
from anser.missions.events import GOAL_TAKEN_OVER, EventSchedule
from anser.planning.certified.replanning import CORRECTED, UNCHANGED
from anser.scenario import loads
from anser.scenario.build import build_faults
from missions.test_goal_reassignment import text

TURNS = '[[event]]\ntime_s = 30.0\nkind = "goal-turns"\ngoal = "two"\ncourse_deg = 90.0\n'
SENSOR_LOST = '[[event]]\ntime_s = 30.0\nkind = "goal-sensor-lost"\naircraft = "a"\n'
LEAVES = '[[event]]\ntime_s = 12.5\nkind = "aircraft-leaves"\naircraft = "c"\n'


def state(replanning):
    return SimpleNamespace(planner=SimpleNamespace(replanning=np.asarray(replanning)))


@pytest.fixture
def log(monkeypatch):
    applied = []

    def apply_event(scenario, flight, state, number, event, performance, on_progress):
        applied.append((number, event.kind))
        return flight, state, EventOutcome(event.time_s, event.kind, "x", True, "renewed")

    monkeypatch.setattr(events_module, "apply_event", apply_event)
    return applied


def record_searches(monkeypatch, result):
    numbers = []

    def replan_fleet(scenario, flight, state, number, on_progress):
        numbers.append(number)
        return result

    monkeypatch.setattr(events_module, "replan_fleet", replan_fleet)
    return numbers


def test_events_are_applied_in_order_at_their_samples(log):
    events = EventSchedule(loads(text() + TURNS + LEAVES), lambda message: None)
    assert events.steps_until_next(0, 500) == 500
    events.apply_due(None, state(CORRECTED), 500)
    assert log == []
    assert events.steps_until_next(1000, 500) == 250
    events.apply_due(None, state(CORRECTED), 1250)
    assert log == [(1250, "aircraft-leaves")]
    assert events.steps_until_next(1250, 500) == 500
    events.apply_due(None, state(CORRECTED), 3000)
    assert log[-1] == (3000, "goal-turns")
    assert [outcome.kind for outcome in events.outcomes] == ["aircraft-leaves", "goal-turns"]


def test_without_a_successor_the_plan_is_as_valid_as_after_the_departure(monkeypatch):
    scenario = loads(text(("a", "nearest"), ("c", "nearest")) + TURNS.replace("30.0", "20.0"))
    departure_plans = {"a": True, "c": False}

    def apply_event(scenario, flight, state, number, event, performance, on_progress):
        has_plan = departure_plans.get(event.aircraft, True)
        return flight, state, EventOutcome(event.time_s, event.kind, event.aircraft or "two", has_plan, "replanned")

    def reassign_goals(scenario, flight, state, number, events, goals, has_valid_plan, on_progress):
        return flight, state, goals, [EventOutcome(20.0, GOAL_TAKEN_OVER, "c", has_valid_plan, "no aircraft can")]

    monkeypatch.setattr(events_module, "apply_event", apply_event)
    monkeypatch.setattr(events_module, "reassign_goals", reassign_goals)
    events = EventSchedule(scenario, lambda message: None)
    events.apply_due(None, state(CORRECTED), 2000)
    assert [outcome.has_valid_plan for outcome in events.outcomes] == [True, False, True, False]


@pytest.mark.parametrize(("time_s", "sample"), [(20.0, 2000), (20.004, 2001), (20.006, 2001), (0.57, 57)])
def test_an_event_between_two_samples_is_applied_at_the_second(log, time_s, sample):
    """At the sample before, the aircraft has not left: its goal would not be free, and plans would include it."""
    scenario = loads(text() + LEAVES.replace("12.5", str(time_s)))
    events = EventSchedule(scenario, lambda message: None)
    assert events.steps_until_next(0, 9999) == sample
    faults = build_faults(scenario.aircraft[2], scenario.event)
    step_s = scenario.timing.step_s
    assert [bool(faults.has_left_fleet(k * step_s)) for k in (sample - 1, sample)] == [False, True]


def test_every_replanning_is_checked_after_a_goal_has_turned(log, monkeypatch):
    searched, events = record_searches(monkeypatch, None), EventSchedule(loads(text() + TURNS), lambda message: None)
    events.apply_due(None, state(CORRECTED), 3000)
    # the renewal at 30 s is within the next step; then the next, a second later
    assert events.steps_until_next(3000, 500) == 1
    assert events.steps_until_next(3001, 500) == 100
    corrected = state(CORRECTED)
    assert events.check_replanning(None, corrected, 3101) is corrected
    assert events.check_replanning(None, corrected, 4001 + 100) is corrected
    assert events.steps_until_next(4101, 500) == 500
    assert searched == []
    assert events.outcomes[0].has_valid_plan


def test_a_plan_of_the_search_is_flown_and_reported(log, monkeypatch):
    replanned = state(CORRECTED)
    searched, events = (
        record_searches(monkeypatch, replanned),
        EventSchedule(loads(text() + TURNS), lambda message: None),
    )
    events.apply_due(None, state(CORRECTED), 3000)
    assert events.check_replanning(None, state(UNCHANGED), 3001) is replanned
    assert searched == [3001]
    (outcome,) = events.outcomes
    assert outcome.has_valid_plan
    assert outcome.message == "planned anew (30.01 s)"
    assert events.check_replanning(None, state(UNCHANGED), 3101).planner.replanning == UNCHANGED
    assert searched == [3001]


def test_a_failed_search_is_reported_and_repeated_at_most_three_times(log, monkeypatch):
    searched, events = record_searches(monkeypatch, None), EventSchedule(loads(text() + TURNS), lambda message: None)
    events.apply_due(None, state(CORRECTED), 3000)
    for number in (3001, 3101, 3201, 3301, 3401):
        events.check_replanning(None, state(UNCHANGED), number)
    assert searched == [3001, 3101, 3201]
    (outcome,) = events.outcomes
    assert not outcome.has_valid_plan
    assert outcome.message.startswith(NO_PLAN_MESSAGE)


def test_a_plan_made_once_does_not_follow_a_goal_that_turns():
    once = text().replace("duration_s = 200.0", "duration_s = 200.0\nreplan_period_s = 0.0")
    for scenario_text, is_planned, message in (
        (text() + TURNS, True, "periodic replanning follows the estimated goal"),
        (once + TURNS, False, "the plan in force stays: with timing.replan_period_s = 0"),
        (once + SENSOR_LOST, True, "the plan in force stays: with timing.replan_period_s = 0"),
    ):
        scenario = loads(scenario_text)
        *_, outcome = event_replanning.apply_event(scenario, None, None, 3000, scenario.event[0], None)
        assert outcome.has_valid_plan is is_planned
        assert outcome.message.startswith(message)


@dataclass(frozen=True)
class PlanInForce:
    plan: Any
    limits: Any
    holds: Any


@pytest.mark.parametrize("clear", [True, False])
def test_aircraft_about_to_arrive_fly_their_new_holds(monkeypatch, clear):
    """A keep-out appears on their holds when no aircraft can be replanned any more."""
    new_holds = SimpleNamespace(clear=np.array([clear]))
    planner = SimpleNamespace(correction_limits=lambda limits: limits, airspace=None, assign_holds=lambda *_: new_holds)
    replacements = {
        "snapshot_at": lambda *_: SimpleNamespace(
            replannable_tasks=SimpleNamespace(active=np.zeros(2)), flying_tasks=None, remaining=np.array([True, False])
        ),
        "aircraft_planner": lambda flight: planner,
        "_with_limits": lambda tasks, limits: tasks,
        # of the second aircraft, which has left, an exit path beyond its limits
        "_certificate": lambda *_: SimpleNamespace(satisfied=np.array([True, False])),
        "_target_times": lambda scenario, times_s, can_replan, event, planned_times_s: times_s,
        "replace_plan": lambda state, plan_state: plan_state,
    }
    for name, replacement in replacements.items():
        monkeypatch.setattr(event_replanning, name, replacement)
    plan_state = PlanInForce(SimpleNamespace(arrival_times=np.array([60.0, 90.0]), paths=None), None, holds="old")
    current = SimpleNamespace(planner=plan_state)
    scenario = SimpleNamespace(timing=SimpleNamespace(step_s=0.01, duration_s=90.0))
    event = SimpleNamespace(kind="keep-out-appears")
    after, is_valid, _ = event_replanning._replan_if_needed(
        scenario, None, current, 5000, event, np.array([60.0, 60.0]), lambda message: None
    )
    assert is_valid is clear
    assert (after.holds is new_holds) if clear else (after is current)


def target_times(times_s, can_replan, order, leaves, *earlier, planned_s=np.inf):
    """Arrival times required after the last event of a sequence with a spacing of 30 s, at 88 s.

    The aircraft that leaves was planned to arrive at `planned_s`.
    """
    events = [
        SimpleNamespace(kind="aircraft-leaves", aircraft=name, time_s=time_s, gaps=None)
        for name, time_s in (*earlier, (leaves, 88.0))
    ]
    scenario = SimpleNamespace(
        arrival=SimpleNamespace(rule="sequence", spacing_s=30.0, order=order),
        aircraft=[SimpleNamespace(name=name) for name in "abcd"],
        event=events,
    )
    planned_times_s = np.where(np.array(list("abcd")) == leaves, planned_s, times_s)
    arguments = scenario, np.array(times_s), np.array(can_replan), events[-1], planned_times_s
    return event_replanning._target_times(*arguments).tolist()


def test_followers_in_a_sequence_move_up_as_far_as_places_are_free():
    times_s, everyone = [100.0, 130.0, 160.0, 190.0], [True] * 4
    assert target_times(times_s, everyone, ["a", "b", "c", "d"], "b") == [100.0, 130.0, 130.0, 160.0]
    assert target_times(times_s, everyone, ["d", "c", "b", "a"], "c") == [70.0, 100.0, 160.0, 190.0]
    # b is about to arrive and keeps its place; the place of c, behind it, is taken
    assert target_times(times_s, [True, False, True, True], ["a", "b", "c", "d"], "a") == times_s
    # a has arrived at 80 s: its place is past
    times_s = [200.0, 110.0, 140.0, 170.0]
    assert target_times(times_s, [False, *[True] * 3], ["a", "b", "c", "d"], "a", planned_s=80.0) == times_s
    # so is that of a where b has left since, and its gap was kept
    times_s = [200.0, 200.0, 160.0, 190.0]
    arguments = times_s, [False, False, True, True], ["a", "b", "c", "d"], "a", ("b", 50.0)
    assert target_times(*arguments, planned_s=80.0) == times_s
    # b has left before, and holds nobody up
    moved = target_times(
        [100.0, 200.0, 130.0, 160.0], [True, False, True, True], ["a", "b", "c", "d"], "a", ("b", 50.0)
    )
    assert moved == [100.0, 200.0, 100.0, 130.0]


def test_no_arrival_after_the_latest_is_requested():
    scenario = SimpleNamespace(timing=SimpleNamespace(latest_arrival_s=99.0), arrival=SimpleNamespace(rule="at"))
    times_s = np.array([60.0, 60.0])
    for target_s, expected in ((75.0, [70.0, 55.0]), (105.0, [55.0])):
        requests = event_replanning._requests(scenario, times_s, np.ones(2, bool), 5.0, np.full(2, target_s))
        assert [float(request.times_s[0]) for request in requests] == expected


@pytest.mark.parametrize(
    ("later_s", "found", "said"),
    [
        (10.0, True, "planned anew"),
        (10.0, False, "no new plan"),
        (50.0, True, "not put off: an arrival at 110.0 s"),
        (10.0, True, "no aircraft is left that could be replanned"),
    ],
)
def test_an_arrival_is_put_off_to_the_time_that_is_asked_for_or_not_at_all(monkeypatch, later_s, found, said):
    is_flying = not said.startswith("no aircraft")
    replacements = {
        "snapshot_at": lambda *_: SimpleNamespace(
            replannable_tasks=SimpleNamespace(active=np.full(2, float(is_flying))),
            flying_tasks=None,
            remaining=np.ones(2, bool),
        ),
        "aircraft_planner": lambda _: SimpleNamespace(correction_limits=lambda limits: limits, airspace=None),
        "_with_limits": lambda tasks, limits: tasks,
        "_certificate": lambda *_: SimpleNamespace(satisfied=np.ones(2, bool)),
    }
    for name, replacement in replacements.items():
        monkeypatch.setattr(event_replanning, name, replacement)
    asked = []

    def search_plan(scenario, flight, state, snapshot, now_s, requests, on_progress):
        asked.extend(float(request.times_s[0]) for request in requests)
        return "new" if found else None

    monkeypatch.setattr(event_replanning, "_search_plan", search_plan)
    times_s = np.array([60.0, 60.0])
    current = SimpleNamespace(planner=PlanInForce(SimpleNamespace(arrival_times=times_s, paths=None), None, None))
    monkeypatch.setattr(event_replanning, "replace_plan", lambda state, plan_state: current)
    timing = SimpleNamespace(step_s=0.01, duration_s=100.0, latest_arrival_s=99.0)
    scenario = SimpleNamespace(timing=timing, arrival=SimpleNamespace(rule="together"))
    event = SimpleNamespace(kind="arrival-put-off", later_s=later_s)
    after, is_planned, message = event_replanning._replan_if_needed(
        scenario, None, current, 2000, event, times_s, lambda message: None
    )
    is_possible = is_flying and later_s < 39.0
    assert asked == ([50.0] if is_possible else [])
    assert is_planned is (found and is_possible)
    assert after == ("new" if is_planned else current)
    assert message.startswith(said)


@pytest.mark.parametrize(
    ("limits", "share", "expected"),
    [
        ((np.inf, np.inf), 0.25, 0.9 * 1.25),  # 0.25 (3 + 4) - 0.5 of the engine, less the reserve
        ((np.inf, 0.3), 0.25, 0.9 * 1.25),  # prescribed decelerations are no engine
        ((2.0, np.inf), 0.25, 0.9 * 1.25),
        ((1.0, np.inf), 0.25, 0.9 * 1.0),  # a prescribed limit stays
        ((np.inf, np.inf), 0.05, -1.1 * 0.15),  # it must decelerate, and the reserve is on the other side
    ],
)
def test_less_thrust_leaves_the_acceleration_of_the_engine(monkeypatch, limits, share, expected):
    performance = SimpleNamespace(acceleration=np.array([9.0, 6.5]), deceleration=np.array([9.0, 0.5]))
    planner = SimpleNamespace(
        limits=SimpleNamespace(acceleration_max=np.array([1.0, limits[0]])), acceleration_reserve=0.1
    )
    monkeypatch.setattr(event_replanning, "aircraft_planner", lambda flight: planner)
    monkeypatch.setattr(event_replanning.eqx, "tree_at", lambda where, state, value: np.asarray(value))
    state = SimpleNamespace(planner=SimpleNamespace(limits=SimpleNamespace(acceleration_max=np.array([7.0, 5.0]))))
    reduced = event_replanning._with_less_thrust(None, state, performance, 1, share)
    np.testing.assert_allclose(reduced, [7.0, expected], rtol=1e-12)
