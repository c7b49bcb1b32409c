"""Events in their order, and the whole search where renewal finds no plan to a goal that has changed."""

from types import SimpleNamespace

import numpy as np
import pytest

from anser.missions import events as happenings
from anser.missions.events import EventSchedule
from anser.missions.replanning import NO_PLAN_MESSAGE, EventOutcome
from anser.planning.certified.replanning import CORRECTED, UNCHANGED
from anser.scenario import loads
from missions.test_takeover import text

TURNS = '[[event]]\ntime_s = 30.0\nkind = "goal-turns"\ngoal = "two"\ncourse_deg = 90.0\n'
LEAVES = '[[event]]\ntime_s = 12.5\nkind = "aircraft-leaves"\naircraft = "c"\n'


def state(replanning):
    return SimpleNamespace(planner=SimpleNamespace(replanning=np.asarray(replanning)))


@pytest.fixture
def log(monkeypatch):
    done = []

    def after(scenario, flight, state, number, event, told):
        done.append((number, event.kind))
        return flight, state, EventOutcome(event.time_s, event.kind, "x", True, "renewed")

    monkeypatch.setattr(happenings, "apply_event", after)
    return done


def searches(monkeypatch, found):
    asked = []

    def anew(scenario, flight, state, number, told):
        asked.append(number)
        return found

    monkeypatch.setattr(happenings, "replan_fleet", anew)
    return asked


def test_events_happen_in_their_order_at_their_samples(log):
    events = EventSchedule(loads(text() + TURNS + LEAVES), lambda what: None)
    assert events.steps_until_next(0, 500) == 500
    events.apply_due(None, state(CORRECTED), 500)
    assert log == []
    assert events.steps_until_next(1000, 500) == 250
    events.apply_due(None, state(CORRECTED), 1250)
    assert log == [(1250, "aircraft-leaves")]
    assert events.steps_until_next(1250, 500) == 500
    events.apply_due(None, state(CORRECTED), 3000)
    assert log[-1] == (3000, "goal-turns")
    assert [one.kind for one in events.outcomes] == ["aircraft-leaves", "goal-turns"]


def test_after_a_goal_has_turned_the_renewals_are_looked_at_one_by_one(log, monkeypatch):
    asked, events = searches(monkeypatch, None), EventSchedule(loads(text() + TURNS), lambda what: None)
    events.apply_due(None, state(CORRECTED), 3000)
    # the renewal at 30 s is within the next step; then the next, a second later
    assert events.steps_until_next(3000, 500) == 1
    assert events.steps_until_next(3001, 500) == 100
    fine = state(CORRECTED)
    assert events.check_replanning(None, fine, 3101) is fine
    assert events.check_replanning(None, fine, 4001 + 100) is fine
    assert events.steps_until_next(4101, 500) == 500
    assert asked == []
    assert events.outcomes[0].planned


def test_a_plan_that_the_search_finds_is_flown_and_told(log, monkeypatch):
    new = state(CORRECTED)
    asked, events = searches(monkeypatch, new), EventSchedule(loads(text() + TURNS), lambda what: None)
    events.apply_due(None, state(CORRECTED), 3000)
    assert events.check_replanning(None, state(UNCHANGED), 3001) is new
    assert asked == [3001]
    (told,) = events.outcomes
    assert told.planned
    assert told.message == "planned anew (30.01 s)"
    assert events.check_replanning(None, state(UNCHANGED), 3101).planner.replanning == UNCHANGED
    assert asked == [3001]


def test_it_is_told_that_no_plan_was_found_and_three_times_is_enough(log, monkeypatch):
    asked, events = searches(monkeypatch, None), EventSchedule(loads(text() + TURNS), lambda what: None)
    events.apply_due(None, state(CORRECTED), 3000)
    for number in (3001, 3101, 3201, 3301, 3401):
        events.check_replanning(None, state(UNCHANGED), number)
    assert asked == [3001, 3101, 3201]
    (told,) = events.outcomes
    assert not told.planned
    assert told.message.startswith(NO_PLAN_MESSAGE)
