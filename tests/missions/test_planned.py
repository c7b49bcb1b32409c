"""What a first plan says of itself: which mean airspeed it has and why, which wind it reckons with, when it ends."""

import pytest

import anser
from anser.missions.plan_output import record_plan
from anser.scenario import loads
from scenario.test_cautions import SHEARED


@pytest.mark.long
def test_a_mean_airspeed_other_than_the_fleets_is_announced():
    """Down a path that the idle engine cannot fly at 150 m/s, from 9 m/s against it into 20 m/s behind it."""
    planned = anser.plan(loads(SHEARED))
    raised, wind = planned.notes()
    assert "the plan's mean airspeed is 173.2 m/s instead of fleet.speed_m_s = 150 m/s" in raised
    assert 'aircraft "one" has the longest way and cannot slow down or come down more slowly' in raised
    assert 'that at the rendezvous differs, by 29.2 m/s for aircraft "one"' in wind
    assert planned.problems() == ()
    summary = record_plan(planned).summary
    assert summary["notes"] == [raised, wind]
    row = summary["aircraft"][0]
    # the figure of the note is the one that is planned: the length is flown in the time at it
    assert row["speed_mean_m_s"] == pytest.approx(173.158, abs=1e-2)
    assert row["length_m"] / row["arrival_s"] == pytest.approx(row["speed_mean_m_s"], rel=1e-5)
    assert str(planned).splitlines()[1:] == [f"  note: {raised}", f"  note: {wind}"]


@pytest.mark.long
def test_shear_by_itself_raises_nothing():
    level = anser.plan(loads(SHEARED).replace("aircraft[one].start.altitude_m", 300.0, "timing.duration_s", 120.0))
    assert float(level.plan.speed) == 150.0
    assert level.notes() == ()


@pytest.mark.long
def test_a_plan_that_arrives_after_the_flight_is_not_flyable():
    planned = anser.plan(loads(SHEARED).replace("timing.duration_s", 85.0))
    assert planned.problems() == ("the fleet arrives at 87.0 s, the flight ends at 85 s",)
