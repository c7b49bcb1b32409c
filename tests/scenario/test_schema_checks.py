"""Refusals between the tables of a scenario, and accepted boundary cases."""

import pytest

from anser.scenario import loads
from support.two_aircraft import PUBLISHED_SPEED, WAYPOINT_GOAL, assert_told, changed

JET_GOAL = """\
[[goal]]
name = "jet"
kind = "airborne"
north_m = 0
east_m = 0
altitude_m = 5000
speed_m_s = 300
"""

# one change of the good scenario, then: path, whom, what arrived (a part), what would be right (a part)
CASES = {
    "aircraft named twice": (
        [('"bravo"', '"alpha"')],
        ("aircraft[1].name", "", '"alpha", already the name of aircraft[0]', "a name of its own"),
    ),
    "goal named twice": (
        [('name = "balloon"', 'name = "ship"'), ('goal = "balloon"', 'goal = "ship"')],
        ("goal[1].name", "", '"ship", already the name of goal[0]', "a name of its own"),
    ),
    "unknown goal": (
        [('goal = "balloon"', 'goal = "ballon"')],
        ("aircraft[1].goal", 'aircraft "bravo"', '"ballon"', '("ship", "balloon")'),
    ),
    "same start": (
        [
            (
                "north_m = -8000.0\neast_m = 100.0\naltitude_m = 1500.0",
                "north_m = 9000.0\neast_m = 0.0\naltitude_m = 1000.0",
            )
        ],
        ("aircraft[1].start", 'aircraft "bravo"', 'the place of aircraft[0] "alpha"', "at least 10 m"),
    ),
    "same rendezvous": (
        [
            ('goal = "ship"', 'goal = "balloon"'),
            ("[aircraft.gains", "[aircraft.rendezvous]\nstand_off_up_m = 121\n[aircraft.gains"),
        ],
        (
            "aircraft[1].rendezvous",
            'aircraft "bravo"',
            'the rendezvous point of aircraft[0] "alpha"',
            "at least 10 m apart",
        ),
    ),
    "start above the thrust tables": (
        [("altitude_m = 1000.0", "altitude_m = 15241.0")],
        ("aircraft[0].start.altitude_m", 'aircraft "alpha"', "15241", "a number from 0 to 15240 m"),
    ),
    "start below the floor": (
        [("altitude_m = 1000.0", "altitude_m = 99.0")],
        ("aircraft[0].start.altitude_m", 'aircraft "alpha"', "99", "at least limits.altitude_min_m, which is 100 m"),
    ),
    "start too slow": (
        [("speed_m_s = 151.0", "speed_m_s = 89.0")],
        ("aircraft[1].start.speed_m_s", 'aircraft "bravo"', "89", "limits.speed_min_m_s (90 m/s)"),
    ),
    "start too fast": (
        [("speed_m_s = 151.0", "speed_m_s = 241.0")],
        ("aircraft[1].start.speed_m_s", 'aircraft "bravo"', "241", "limits.speed_max_m_s (240 m/s)"),
    ),
    "start too steep": (
        [("course_deg = 180.0", "course_deg = 180.0\npath_angle_deg = 40")],
        ("aircraft[0].start.path_angle_deg", 'aircraft "alpha"', "40, a climb rate of 96.4 m/s", "which is 80 m/s"),
    ),
    "arrival too steep": (
        [("stand_off_up_m = 120.0", "stand_off_up_m = 120.0\npath_angle_deg = -40")],
        ("aircraft[1].rendezvous.path_angle_deg", 'aircraft "bravo"', "-96.4 m/s", "which is 80 m/s"),
    ),
    "stand-off above the surface": (
        [
            (
                "[aircraft.gains",
                "[aircraft.rendezvous]\nstand_off_up_m = 149.9\nstand_off_north_m = 900\n[aircraft.gains",
            )
        ],
        (
            "aircraft[0].rendezvous.stand_off_up_m",
            'aircraft "alpha"',
            "149.9",
            'at least 150 m above the surface goal "ship"; this is the scope of anser',
        ),
    ),
    "stand-off in the air": (
        [("stand_off_up_m = 120.0", "stand_off_up_m = 50\nstand_off_north_m = 50\nstand_off_east_m = 50")],
        (
            "aircraft[1].rendezvous",
            'aircraft "bravo"',
            "a stand-off of 86.6 m",
            'at least 100 m from the airborne goal "balloon"; this is the scope of anser',
        ),
    ),
    "goal that outruns its aircraft": (
        [("north_m = 300.0\neast_m = 20.0", "north_m = 300.0\neast_m = 20.0\nspeed_m_s = 160")],
        ("aircraft[1].goal", 'aircraft "bravo"', '"balloon", which moves at 160.0 m/s through the air', "= 150 m/s"),
    ),
    "goal that outruns its aircraft in the wind": (
        # 140 m/s over the ground, northwards, against a wind of 20 m/s from the north
        [
            ("north_m = 300.0\neast_m = 20.0", "north_m = 300.0\neast_m = 20.0\nspeed_m_s = 140"),
            ("[wind]\nspeed_m_s = 0.0", "[wind]\nspeed_m_s = 20.0"),
        ],
        ("aircraft[1].goal", 'aircraft "bravo"', '"balloon", which moves at 160.0 m/s through the air', "= 150 m/s"),
    ),
    "waypoints too far apart": (
        [WAYPOINT_GOAL, ("east_m = 500,", "east_m = 8000,")],
        (
            "goal[0].waypoints[1]",
            'goal "ship"',
            "160.0 m/s through the air",
            "less than fleet.speed_m_s, which is 150 m/s",
        ),
    ),
    "wind as fast as the fleet": (
        [
            ("[wind]\nspeed_m_s = 0.0", "[wind]\nspeed_m_s = 60.0"),
            ("[fleet]\nspeed_m_s = 150", "[fleet]\nspeed_m_s = 60"),
            ("speed_min_m_s = 90", "speed_min_m_s = 40"),
        ],
        ("wind.speed_m_s", "", "60", "slower than fleet.speed_m_s, which is 60 m/s"),
    ),
    "fleet at the lower limit": (
        [("[fleet]\nspeed_m_s = 150", "[fleet]\nspeed_m_s = 90")],
        ("fleet.speed_m_s", "", "90", "limits.speed_min_m_s (90 m/s)"),
    ),
    "fleet above the limits": (
        [("[fleet]\nspeed_m_s = 150", "[fleet]\nspeed_m_s = 250")],
        ("fleet.speed_m_s", "", "250", "limits.speed_max_m_s (240 m/s)"),
    ),
    "speed limits crossed": (
        [("speed_min_m_s = 90", "speed_min_m_s = 240")],
        ("limits.speed_min_m_s", "", "240", "less than speed_max_m_s, which is 240 m/s"),
    ),
    "angle limits crossed": (
        [("alpha_min_deg = -5", "alpha_min_deg = 30")],
        ("limits.alpha_min_deg", "", "30", "less than alpha_max_deg, which is 25 deg"),
    ),
    "frozen all the time": (
        [("freeze_s = 4.0", "freeze_s = 120.0")],
        ("timing.freeze_s", "", "120", "less than duration_s, which is 120 s"),
    ),
    "flight too short": (
        [("duration_s = 120.0", "duration_s = 58.0"), PUBLISHED_SPEED],
        # 9000 m north, 700 m up at 150 m/s, the ship crossing at 8 m/s: sqrt(9000^2 + 700^2)/sqrt(150^2 - 8^2)
        ("timing.duration_s", "", "58", 'more than 60.3 s, the shortest flight from "alpha" to goal "ship"'),
    ),
    "flight too short for any descent": (
        [("duration_s = 120.0", "duration_s = 47.0")],
        # the same at sqrt(150^2 + 2 * 9.80665 * 700) = 190.4 m/s, which no drag would allow
        ("timing.duration_s", "", "47", "more than 47.5 s, the shortest flight"),
    ),
    "flight too short for waypoints": (
        [WAYPOINT_GOAL, ("duration_s = 120.0", "duration_s = 59.0"), PUBLISHED_SPEED],
        ("timing.duration_s", "", "59", 'a longer flight: "alpha" does not get to goal "ship"'),
    ),
    "an end between steps": (
        [("duration_s = 120.0", "duration_s = 120.005")],
        ("timing.duration_s", "", "120.005", "a whole multiple of step_s, which is 0.01 s, such as 120 or 120.01"),
    ),
    "records between steps": (
        [("record_period_s = 0.1", "record_period_s = 0.015")],
        ("timing.record_period_s", "", "0.015", "a whole multiple of step_s, which is 0.01 s, such as 0.01 or 0.02"),
    ),
    "default records between steps": (
        [
            ("record_period_s = 0.1\nreplan_period_s = 1.0", "replan_period_s = 1.6"),
            ("duration_s = 120.0\nstep_s = 0.01", "duration_s = 121.6\nstep_s = 0.016"),
        ],
        ("timing.record_period_s", "", "the default 0.1", "a whole multiple of step_s, which is 0.016 s"),
    ),
    "plans between steps": (
        [("replan_period_s = 1.0", "replan_period_s = 0.005")],
        ("timing.replan_period_s", "", "0.005", "a whole multiple of step_s, which is 0.01 s"),
    ),
    "hold too tight": (
        # 150^2/(9.80665 tan 60 deg) = 1324.7 m
        [("radius_m = 4000", "radius_m = 1300")],
        ("hold.radius_m", "", "1300", "at least 1325 m"),
    ),
    "default hold too tight": (
        # 150^2/(9.80665 tan 25 deg) = 4920 m
        [("radius_m = 4000.0\n", ""), ("[hold]", ""), ("[limits]", "[limits]\nbank_max_deg = 25")],
        ("hold.radius_m", "", "4000, the default", "write [hold] with radius_m = 5000.0, or more"),
    ),
    "start at the rendezvous": (
        [
            (
                "north_m = -8000.0\neast_m = 100.0\naltitude_m = 1500.0",
                "north_m = 300.0\neast_m = 20.0\naltitude_m = 1320.0",
            )
        ],
        ("aircraft[1].start", 'aircraft "bravo"', "the rendezvous point itself", "at least 1 s of flight"),
    ),
    "rendezvous below the floor": (
        [("stand_off_up_m = 120.0", "stand_off_up_m = -1150.0")],
        (
            "aircraft[1].rendezvous.stand_off_up_m",
            'aircraft "bravo"',
            "at 50.0 m altitude",
            "limits.altitude_min_m (100 m)",
        ),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_refusal_names_the_key_its_value_and_the_expected_value(case: str) -> None:
    assert_told(*CASES[case])


@pytest.mark.parametrize(
    "changes",
    [
        [("stand_off_up_m = 120.0", "stand_off_up_m = 100.0")],  # exactly the minimum in the air
        [("[aircraft.gains", "[aircraft.rendezvous]\nstand_off_up_m = 150\n[aircraft.gains")],  # and above the surface
        [("speed_m_s = 8.0", "speed_m_s = 149.0"), ("duration_s = 120.0", "duration_s = 7200")],  # slower by a little
        [
            ("east_m = 20.0", "east_m = 20.0\nspeed_m_s = 200\ncourse_deg = 180")
        ],  # faster, but comes towards the aircraft
        [("replan_period_s = 1.0", "replan_period_s = 0")],
        [("freeze_s = 4.0", "freeze_s = 4")],  # a whole number for a float
        [WAYPOINT_GOAL],
        # a goal that no one flies to, and that would outrun everyone
        [
            ("[[goal]]", f"{JET_GOAL}[[goal]]"),
        ],
        # 160 m/s over the ground with a tail wind of 20 m/s: 140 m/s through the air
        [
            ("east_m = 20.0", "east_m = 20.0\nspeed_m_s = 160"),
            ("[wind]\nspeed_m_s = 0.0\nfrom_deg = 0.0", "[wind]\nspeed_m_s = 20.0\nfrom_deg = 180.0"),
            ("duration_s = 120.0", "duration_s = 7200"),
        ],
    ],
)
def test_boundary_cases_are_accepted(changes: list[tuple[str, str]]) -> None:
    loads(changed(*changes))
