"""The standard mission under changed conditions: round Earth, different steps, a turning goal."""

from pathlib import Path

import pytest

import anser
from anser.scenario import loads
from anser.verification import missions

pytestmark = pytest.mark.long


THREE = (Path(__file__).parents[2] / "scenarios" / f"{missions.MISSION}.toml").read_text()
FLOWN_S = 75.0


def _run_shortened(scenario):
    """The comparisons of the checks end at the arrival, at 60 s: the circles flown afterwards do not matter."""
    return anser.run(scenario.replace("timing.duration_s", FLOWN_S))


@pytest.fixture(scope="module")
def shorter():
    """Shorter flights for the checks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(missions, "run", _run_shortened)
        missions.mission.cache_clear()
        yield missions.mission
        missions.mission.cache_clear()


@pytest.mark.parametrize("check", missions.MISSION_CHECKS, ids=lambda check: check.key)
def test_missions_over_both_earths_and_at_all_steps(shorter, check):
    for comparison in check.measure():
        assert not comparison.fails, comparison
    assert all(entry["arrival_s"] < FLOWN_S - 10.0 for entry in shorter().summary["aircraft"])


def test_a_turning_goal_is_still_met():
    """A boat reverses 30 s before the arrival: the fleet is coordinated anew and still arrives together."""
    boat = (
        '[[goal]]\nname = "boat-north"\nkind = "surface"\nwaypoints = [{ time_s = 0.0, north_m = 100.0, east_m = 0.0, '
    )
    boat += "altitude_m = 0.0 }, { time_s = 25.0, north_m = 725.0, east_m = 0.0, altitude_m = 0.0 }, { time_s = 400.0, "
    boat += "north_m = 725.0, east_m = 5000.0, altitude_m = 0.0 }]\n\n"
    start = THREE.index('[[goal]]\nname = "boat-north"')
    end = THREE.index('[[goal]]\nname = "buoy"')
    flown = anser.run(loads(THREE[:start] + boat + THREE[end:]))
    assert max(entry["miss_m"] for entry in flown.summary["aircraft"]) <= 3.0
    assert flown.summary["fleet"]["arrival_spread_s"] <= 0.05
