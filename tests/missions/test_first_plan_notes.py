"""First plans: notes (mean airspeed, wind at the rendezvous), end of the flight, rough time of the last arrival."""

import pytest

import anser
from anser.missions.first_plan import _rough_flight_time_s
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


@pytest.mark.parametrize(
    ("arrival", "first", "second", "last_s"),
    [
        ('rule = "together"', "", "", 60.0),  # 6 km against the wind, and 9 km with it
        ('rule = "sequence"\nspacing_s = 40.0', "", "", 100.0),
        ('rule = "sequence"\nspacing_s = 10.0\norder = ["second", "first"]', "", "", 60.0),
        (
            'rule = "windows"',
            "arrive_from_s = 20.0\narrive_to_s = 50.0",
            "arrive_from_s = 80.0\narrive_to_s = 90.0",
            80.0,
        ),
        ('rule = "times"', "arrive_s = 55.0", "arrive_s = 58.0", 58.0),
        ('rule = "at"\ntime_s = 70.0', "", "", 70.0),
    ],
)
def test_programs_are_prepared_for_the_last_arrival(arrival, first, second, last_s):
    """Two aircraft at the altitude of their rendezvous, in a wind of 50 m/s from north."""
    scenario = loads(
        'format = 2\nname = "two"\ntiming.duration_s = 300.0\nfleet.speed_m_s = 150.0\n'
        f"wind = {{ speed_m_s = 50.0, from_deg = 0.0 }}\n[arrival]\n{arrival}\n"
        f"{_level_aircraft('first', -6000.0, 1000.0, 0.0, first)}"
        f"{_level_aircraft('second', 9000.0, 1300.0, 180.0, second)}"
        '[[goal]]\nname = "boat"\nkind = "surface"\nnorth_m = 0.0\neast_m = 0.0\n'
    )
    assert _rough_flight_time_s(scenario) == pytest.approx(last_s, rel=1e-12)


def _level_aircraft(name, north_m, altitude_m, course_deg, arrival):
    return (
        f'[[aircraft]]\nname = "{name}"\ngoal = "boat"\n{arrival}\nrendezvous = {{ stand_off_up_m = {altitude_m} }}\n'
        f"start = {{ north_m = {north_m}, east_m = 0.0, altitude_m = {altitude_m}, speed_m_s = 150.0, "
        f"course_deg = {course_deg} }}\n"
    )
