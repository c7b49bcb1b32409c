"""Notes and problems of a first plan: mean airspeed, wind at the rendezvous, end of the flight."""

import pytest

import anser
from anser.scenario import loads
from scenario.test_cautions import SHEARED


@pytest.mark.long
def test_a_mean_airspeed_different_from_the_fleets_is_noted():
    """A descent too steep for the idle engine at 150 m/s, from 9 m/s of headwind into 20 m/s of tailwind."""
    planned = anser.plan(loads(SHEARED))
    airspeed_note, wind_note = planned.notes()
    assert "the plan's mean airspeed is 173.2 m/s instead of fleet.speed_m_s = 150 m/s" in airspeed_note
    assert 'aircraft "one" has the longest way and cannot slow down or come down more slowly' in airspeed_note
    assert 'that at the rendezvous differs, by 29.2 m/s for aircraft "one"' in wind_note
    assert planned.problems() == ()
    summary = planned.record().summary
    assert summary["notes"] == [airspeed_note, wind_note]
    entry = summary["aircraft"][0]
    # the figure of the note is the one that is planned: the length is flown in the time at it
    assert entry["speed_mean_m_s"] == pytest.approx(173.158, abs=1e-2)
    assert entry["length_m"] / entry["arrival_s"] == pytest.approx(entry["speed_mean_m_s"], rel=1e-5)
    assert str(planned).splitlines()[1:] == [f"  note: {airspeed_note}", f"  note: {wind_note}"]


@pytest.mark.long
def test_wind_shear_alone_gives_no_note():
    level = anser.plan(loads(SHEARED).replace("aircraft[one].start.altitude_m", 300.0, "timing.duration_s", 120.0))
    assert float(level.plan.speed) == 150.0
    assert level.notes() == ()


@pytest.mark.long
def test_a_plan_that_arrives_after_the_flight_is_not_flyable():
    planned = anser.plan(loads(SHEARED).replace("timing.duration_s", 85.0))
    assert planned.problems() == ("the fleet arrives at 87.0 s, the flight ends at 85 s",)
