"""The standard mission under other conditions: the other Earth, other steps, a goal that turns."""

from pathlib import Path

import pytest

import anser
from anser.scenario import loads
from anser.verification import missions

pytestmark = pytest.mark.long


THREE = (Path(__file__).parents[2] / "scenarios" / missions.MISSION).read_text()
FLOWN_S = 75.0


def _until_after_the_arrival(scenario):
    """What the checks compare ends at the arrival, at 60 s: the circles flown after it say nothing there."""
    return anser.run(scenario.replace("timing.duration_s", FLOWN_S))


@pytest.fixture(scope="module")
def shorter():
    """The checks' own flights, shorter."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(missions, "run", _until_after_the_arrival)
        missions.mission.cache_clear()
        yield missions.mission
        missions.mission.cache_clear()


@pytest.mark.parametrize("check", missions.MISSION_CHECKS, ids=lambda check: check.key)
def test_missions_over_both_earths_and_at_all_steps(shorter, check):
    for comparison in check.measure():
        assert comparison.passes, comparison
    assert all(row["arrival_s"] < FLOWN_S - 10.0 for row in shorter().summary["aircraft"])


def test_a_goal_that_turns_is_still_met():
    """A boat that reverses 30 s before the arrival: the plan is coordinated anew and all still arrive together."""
    boat = (
        '[[goal]]\nname = "boat-north"\nkind = "surface"\nwaypoints = [{ time_s = 0.0, north_m = 100.0, east_m = 0.0, '
    )
    boat += "altitude_m = 0.0 }, { time_s = 25.0, north_m = 725.0, east_m = 0.0, altitude_m = 0.0 }, { time_s = 400.0, "
    boat += "north_m = 725.0, east_m = 5000.0, altitude_m = 0.0 }]\n\n"
    start = THREE.index('[[goal]]\nname = "boat-north"')
    end = THREE.index('[[goal]]\nname = "buoy"')
    flown = anser.run(loads(THREE[:start] + boat + THREE[end:]))
    assert max(row["miss_m"] for row in flown.summary["aircraft"]) <= 3.0
    assert flown.summary["fleet"]["arrival_spread_s"] <= 0.05
