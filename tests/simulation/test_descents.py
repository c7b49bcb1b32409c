"""Descending arrivals: none flies into the ground, and the verdict says which could not go on as planned.

The hundred tasks of which these are some: trials/test_descents.py.
"""

import pytest

import anser
from anser.missions.plan_output import record_published
from anser.simulation import STATUS_MESSAGES
from anser.simulation.closed_loop import BREAKAWAY
from support.descents import descending_task, flown_descent

pytestmark = pytest.mark.long


BROKE = STATUS_MESSAGES[BREAKAWAY]


@pytest.fixture(scope="module")
def flown():
    return {seed: flown_descent(seed) for seed in (0, 4, 5, 6, 9)}


def test_none_reaches_the_ground(flown):
    """Before the guard seven of these fifteen aircraft did, two of them before their arrival."""
    for found in flown.values():
        assert not any("ground" in status for status in found["status"]), found
        # 30 m below the least altitude of 100 m is the floor
        assert min(found["lowest_m"]) >= 70.0, found


def test_who_breaks_off_is_told_and_fails_the_run(flown):
    broke = [found for found in flown.values() if BROKE in found["status"]]
    assert broke
    for found in broke:
        assert not found["met"]
        assert "all requirements met" not in found["text"]


def test_an_arrival_that_can_be_levelled_off_is_held(flown):
    """Descents of 45 and 32 m/s at arrival, 345 and 465 m above the sea, of aircraft 66 m/s faster than their hold.

    Both flew into the ground in the hold, and the run said "1 of 3 aircraft arrived, all requirements met".
    """
    found = flown[9]
    assert found["status"] == ["arrived"] * 3
    assert found["met"]
    # measured 554, 175, 358 m
    assert min(found["lowest_m"]) > 150.0


def test_an_arrival_that_cannot_be_is_announced_with_its_altitude():
    """Of the task 0 the third aircraft arrives in a descent; the plan told its turns and altitudes alone."""
    planned = anser.plan(anser.loads(descending_task(0)))
    assert any("hold cannot level off" in one for one in planned.problems())
    assert float(planned.limits.level_off_altitude.min()) < 100.0
    rows = record_published(planned).summary["aircraft"]
    margins = [next(one for one in row["limits"] if one["name"] == "level_off_min_m")["margin"] for row in rows]
    assert min(margins) == pytest.approx(float(planned.limits.level_off_altitude.min()) - 100.0)
