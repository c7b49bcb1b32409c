"""Descending arrivals: no aircraft hits the ground, and the verdict reports the aircraft that left the plan.

The cases are some of the hundred tasks of trials/test_descents.py.
"""

import pytest

import anser
from anser.simulation import STATUS_MESSAGES
from anser.simulation.closed_loop import BREAKAWAY
from support.descents import descending_task, flown_descent

pytestmark = pytest.mark.long


BROKE = STATUS_MESSAGES[BREAKAWAY]


@pytest.fixture(scope="module")
def flown():
    return {seed: flown_descent(seed) for seed in (0, 4, 5, 6, 9)}


def test_no_descent_reaches_the_ground(flown):
    """Without the guard, seven of these fifteen aircraft hit the ground, two of them before their arrival."""
    for outcome in flown.values():
        assert not any("ground" in status for status in outcome["status"]), outcome
        # 30 m below the least altitude of 100 m is the floor
        assert min(outcome["lowest_m"]) >= 70.0, outcome


def test_a_break_off_is_reported_and_fails_the_run(flown):
    broken_off = [outcome for outcome in flown.values() if BROKE in outcome["status"]]
    assert broken_off
    for outcome in broken_off:
        assert not outcome["met"]
        assert "all requirements met" not in outcome["text"]


def test_a_feasible_level_off_ends_in_the_hold(flown):
    """Descents of 45 and 32 m/s at arrival, 345 and 465 m above the sea, of aircraft 66 m/s faster than in the hold.

    Without the guard, both hit the ground in the hold, and the run reported "all requirements met".
    """
    outcome = flown[9]
    assert outcome["status"] == ["arrived"] * 3
    assert outcome["met"]
    # measured 554, 175, 358 m
    assert min(outcome["lowest_m"]) > 150.0


def test_an_infeasible_level_off_is_reported_with_its_altitude():
    """In task 0 the third aircraft arrives in a descent."""
    planned = anser.plan(anser.loads(descending_task(0)))
    assert any("hold cannot level off" in problem for problem in planned.problems())
    assert float(planned.limits.level_off_altitude.min()) < 100.0
    entries = planned.record().summary["aircraft"]
    margins = [
        next(limit for limit in entry["limits"] if limit["name"] == "level_off_min_m")["margin"] for entry in entries
    ]
    assert min(margins) == pytest.approx(float(planned.limits.level_off_altitude.min()) - 100.0)
