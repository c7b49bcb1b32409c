"""What the schema refuses, and that each refusal says where, what arrived and what would be right."""

import copy
import math
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from anser.scenario.errors import ScenarioError
from anser.scenario.load import loads, validate
from anser.scenario.schema import scenario_hash
from anser.scenario.schema_goal import Goal, Waypoint
from anser.scenario.schema_reach import time_to_go_s
from anser.scenario.template import starter_scenario

GOOD = """\
format = 1
name = "two-aircraft"
description = "A base case"
seed = 0
[timing]
duration_s = 120.0
step_s = 0.01
record_period_s = 0.1
replan_period_s = 1.0
freeze_s = 4.0
[wind]
speed_m_s = 0.0
from_deg = 0.0
[fleet]
speed_m_s = 150.0
[limits]
speed_min_m_s = 90.0
alpha_min_deg = -5.0
[hold]
radius_m = 4000.0
[[aircraft]]
name = "alpha"
goal = "ship"
[aircraft.start]
north_m = 9000.0
east_m = 0.0
altitude_m = 1000.0
speed_m_s = 150.0
course_deg = 180.0
[aircraft.gains.rates]
proportional = 10
[[aircraft]]
name = "bravo"
goal = "balloon"
[aircraft.start]
north_m = -8000.0
east_m = 100.0
altitude_m = 1500.0
speed_m_s = 151.0
course_deg = 10.0
[aircraft.rendezvous]
stand_off_up_m = 120.0
[[goal]]
name = "ship"
kind = "surface"
north_m = 0.0
east_m = 0.0
speed_m_s = 8.0
course_deg = 90.0
[[goal]]
name = "balloon"
kind = "airborne"
north_m = 300.0
east_m = 20.0
altitude_m = 1200.0
"""


def changed(*changes: tuple[str, str]) -> str:
    """Replace pieces of the good scenario; each piece must be there, or the case would test nothing."""
    text = GOOD
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def refusal(text: str) -> ScenarioError:
    with pytest.raises(ScenarioError) as caught:
        loads(text, "case.toml")
    message = str(caught.value)
    assert message.splitlines()[0].startswith("case.toml: ")
    assert "pydantic" not in message.lower()
    assert "http" not in message
    assert "Input should" not in message
    return caught.value


PUBLISHED_SPEED = ("speed_m_s = 150.0\n", 'speed_m_s = 150.0\nspeed_profile = "published"\n')
WAYPOINT_GOAL = (
    "north_m = 0.0\neast_m = 0.0\nspeed_m_s = 8.0\ncourse_deg = 90.0\n",
    "waypoints = [{time_s = 0, north_m = 0, east_m = 0, altitude_m = 0},"
    " {time_s = 50, north_m = 0, east_m = 500, altitude_m = 0}]\n",
)

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
    "unknown key": (
        [("stand_off_up_m", "stand_of_up_m")],
        ("aircraft[1].rendezvous.stand_of_up_m", 'aircraft "bravo"', '"stand_of_up_m"', 'perhaps "stand_off_up_m"'),
    ),
    "misspelt required key": (
        [("duration_s", "duratoin_s")],
        ("timing.duratoin_s", "", '"duratoin_s"', 'perhaps "duration_s"'),
    ),
    "unknown table": ([("[wind]", "[winds]")], ("winds", "", '"winds"', 'perhaps "wind"')),
    "key with odd letters": (
        [("seed = 0", '"a\\n b" = 0')],
        ('"a\\n b"', "", "'a\\n b'", "one of the keys"),
    ),
    "key like no other": ([("seed", "qqq")], ("qqq", "", '"qqq"', "one of the keys format, name")),
    "missing key": (
        [("course_deg = 180.0\n", "")],
        ("aircraft[0].start.course_deg", 'aircraft "alpha"', "nothing", "a number from -360 to 360 deg"),
    ),
    "missing format": ([("format = 1\n", "")], ("format", "", "nothing", "2 or 1, the formats")),
    "other format": ([("format = 1", "format = 3")], ("format", "", "3", "2 or 1, the formats")),
    "format as a boolean": ([("format = 1", "format = true")], ("format", "", "true", "2 or 1, the formats")),
    "format with a point": ([("format = 1", "format = 1.0")], ("format", "", "1.0", "2 or 1, the formats")),
    "string for a number": (
        [("speed_m_s = 151.0", 'speed_m_s = "fast"')],
        ("aircraft[1].start.speed_m_s", 'aircraft "bravo"', '"fast"', "a number from 1 to 340 m/s"),
    ),
    "boolean for a number": ([("seed = 0", "seed = false")], ("seed", "", "false", "a whole number from 0")),
    "fraction for a whole number": ([("seed = 0", "seed = 1.5")], ("seed", "", "1.5", "a whole number")),
    "boolean for a float": (
        [("from_deg = 0.0", "from_deg = true")],
        ("wind.from_deg", "", "true", "a number from -360"),
    ),
    "number for a string": ([('"ship"', "3")], ("aircraft[0].goal", 'aircraft "alpha"', "3", "a name of 1 to 64")),
    "date for a string": ([('"A base case"', "2020-01-01")], ("description", "", "2020-01-01", "a text in quotes")),
    "NaN": ([("freeze_s = 4.0", "freeze_s = nan")], ("timing.freeze_s", "", "nan", "a number from 0 to 600 s")),
    "infinity": ([("freeze_s = 4.0", "freeze_s = inf")], ("timing.freeze_s", "", "inf", "a number from 0 to 600 s")),
    "endless number": (
        [("freeze_s = 4.0", "freeze_s = 0x1" + "0" * 5000)],
        ("timing.freeze_s", "", "a whole number of 20001 bits", "a number from 0 to 600 s"),
    ),
    "out of range": (
        [("step_s = 0.01", "step_s = 0.2")],
        ("timing.step_s", "", "0.2", "a number from 0.001 to 0.05 s"),
    ),
    "no slug": ([('"two-aircraft"', '"Two Aircraft"')], ("name", "", '"Two Aircraft"', "small letters")),
    "wrong word": (
        [('"surface"', '"floating"')],
        ("goal[0].kind", 'goal "ship"', '"floating"', '"surface" or "airborne"'),
    ),
    "gain below zero": (
        [("proportional = 10", "proportional = -1")],
        ("aircraft[0].gains.rates.proportional", 'aircraft "alpha"', "-1", "a list of three such numbers"),
    ),
    "gains for two axes": (
        [("proportional = 10", "proportional = [1, 2]")],
        ("aircraft[0].gains.rates.proportional", 'aircraft "alpha"', "a list of 2", "a list of three such numbers"),
    ),
    "one wrong gain of three": (
        [("proportional = 10", 'proportional = [1, "2", 3]')],
        ("aircraft[0].gains.rates.proportional[1]", 'aircraft "alpha"', '"2"', "a number from 0 to 1000"),
    ),
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
    "airborne goal on the surface": (
        [("altitude_m = 1200.0", "altitude_m = 49.0")],
        ("goal[1].altitude_m", 'goal "balloon"', "49", 'at 50 m or higher; for a lower one, kind = "surface"'),
    ),
    "airborne goal that sinks to the surface": (
        [("altitude_m = 1200.0", "altitude_m = 1200.0\nclimb_rate_m_s = -9.6")],
        ("goal[1].climb_rate_m_s", 'goal "balloon"', "-9.6, which brings it to 48.0 m", "at 50 m or higher"),
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
    "waypoint times that do not grow": (
        [WAYPOINT_GOAL, ("time_s = 50", "time_s = 0")],
        ("goal[0].waypoints[1].time_s", 'goal "ship"', "0", "more than the 0 s of the waypoint before"),
    ),
    "waypoint times that begin late": (
        [WAYPOINT_GOAL, ("time_s = 0,", "time_s = 1,")],
        ("goal[0].waypoints[0].time_s", 'goal "ship"', "1", "0: the first waypoint"),
    ),
    "wrong value in a waypoint": (
        [WAYPOINT_GOAL, ("east_m = 500", 'east_m = "far"')],
        ("goal[0].waypoints[1].east_m", 'goal "ship"', '"far"', "a number from -500000 to 500000 m"),
    ),
    "no waypoint": (
        [WAYPOINT_GOAL, (WAYPOINT_GOAL[1], "waypoints = []\n")],
        ("goal[0].waypoints", 'goal "ship"', "a list of 0", "at least one"),
    ),
    "waypoints and a speed": (
        [WAYPOINT_GOAL, ("waypoints =", "speed_m_s = 3\nwaypoints =")],
        ("goal[0].speed_m_s", 'goal "ship"', "3 beside waypoints", "not both"),
    ),
    "neither waypoints nor a place": (
        [("north_m = 300.0\n", "")],
        ("goal[1].north_m", 'goal "balloon"', "nothing", "either north_m and east_m"),
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
    "records between steps": (
        [("record_period_s = 0.1", "record_period_s = 0.015")],
        ("timing.record_period_s", "", "0.015", "a whole multiple of step_s, which is 0.01 s"),
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
def test_a_refusal_says_where_what_and_what_would_be_right(case: str) -> None:
    changes, (path, whom, arrived, expected) = CASES[case]
    error = refusal(changed(*changes))
    assert len(error.problems) == 1, str(error)
    problem = error.problems[0]
    assert problem.path == path
    assert problem.whom == whom
    assert arrived in problem.arrived
    assert expected in problem.expected
    for part in (path, whom, arrived, expected):
        assert part in str(error).splitlines()[1]


def test_the_good_scenario_loads() -> None:
    scenario = loads(GOOD)
    assert scenario.aircraft[0].gains.rates.proportional == (10.0, 10.0, 10.0)
    assert scenario.goal_of(scenario.aircraft[1]).name == "balloon"


def test_no_aircraft() -> None:
    before, after = GOOD.index("[[aircraft]]"), GOOD.index("[[goal]]")
    (problem,) = refusal(GOOD[:before] + GOOD[after:]).problems
    assert (problem.path, problem.arrived) == ("aircraft", "nothing")
    assert "[[aircraft]]" in problem.expected
    (problem,) = refusal("aircraft = []\n" + GOOD[:before] + GOOD[after:]).problems
    assert (problem.path, problem.arrived) == ("aircraft", "a list of 0")


def test_single_brackets_for_a_list_of_tables() -> None:
    before, after = GOOD.index("[[goal]]"), len(GOOD)
    text = GOOD[:before] + '[goal]\nname = "ship"\nkind = "surface"\n' + GOOD[after:]
    (problem,) = refusal(text).problems
    assert (problem.path, problem.arrived) == ("goal", "a table")
    assert "double brackets" in problem.expected


def test_a_value_where_a_table_belongs() -> None:
    text = GOOD.replace("[hold]\nradius_m = 4000.0\n", "").replace("seed = 0", "hold = 3")
    (problem,) = refusal(text).problems
    assert (problem.path, problem.arrived, problem.expected) == ("hold", "3", "a table [hold]")


def test_all_problems_are_told_together() -> None:
    text = changed(("speed_m_s = 151.0", "speed_m_s = nan"), ('"surface"', '"sea"'), ("step_s = 0.01", "step = 0.01"))
    error = refusal(text)
    assert [problem.path for problem in error.problems] == [
        "timing.step",
        "aircraft[1].start.speed_m_s",
        "goal[0].kind",
    ]
    assert str(error).startswith("case.toml: 3 problems\n")
    # between tables too
    error = refusal(changed(("speed_m_s = 151.0", "speed_m_s = 80"), ("stand_off_up_m = 120.0", "stand_off_up_m = 99")))
    assert [problem.path for problem in error.problems] == ["aircraft[1].start.speed_m_s", "aircraft[1].rendezvous"]


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
def test_allowed_at_the_edge(changes: list[tuple[str, str]]) -> None:
    loads(changed(*changes))


def test_frozen() -> None:
    scenario = loads(GOOD)
    with pytest.raises(ValidationError):
        scenario.wind.speed_m_s = 3.0  # type: ignore[misc]


def test_wind_blows_from_where_it_comes() -> None:
    text = changed(
        ("[wind]\nspeed_m_s = 0.0\nfrom_deg = 0.0", "[wind]\nspeed_m_s = 10.0\nfrom_deg = 240.0\nup_m_s = 1")
    )
    # from 240 deg means towards 60 deg; tolerance: rounding of sine and cosine
    expected = (10 * math.cos(math.radians(60)), 10 * math.sin(math.radians(60)), 1.0)
    assert loads(text).wind.velocity_m_s(0.0) == pytest.approx(expected, abs=1e-13)


def test_waypoints_are_followed_and_the_last_is_kept() -> None:
    points = [(0.0, 0.0, 0.0, 100.0), (10.0, 50.0, -20.0, 100.0), (30.0, 50.0, 20.0, 160.0)]
    waypoints = tuple(Waypoint(time_s=t, north_m=n, east_m=e, altitude_m=h) for t, n, e, h in points)
    goal = Goal(name="drone", kind="airborne", waypoints=waypoints)
    for time_s, north_m, east_m, altitude_m in points:
        assert goal.position_m(time_s) == (north_m, east_m, altitude_m)
    assert goal.position_m(5.0) == (25.0, -10.0, 100.0)
    assert goal.position_m(25.0) == (50.0, 10.0, 145.0)
    assert goal.position_m(1e5) == (50.0, 20.0, 160.0)


component = st.floats(-200.0, 200.0)
distance = st.floats(-2e4, 2e4)


@given(
    st.tuples(distance, distance, distance).filter(lambda r: math.hypot(*r) > 1.0),
    st.tuples(component, component, component),
    st.floats(50.0, 300.0),
)
@settings(deadline=None, max_examples=50)
def test_time_to_go_is_a_meeting_and_the_first(relative, velocity, speed) -> None:
    time_s = time_to_go_s(relative, velocity, speed)

    def gap_m(t: float) -> float:
        return math.hypot(*(r + w * t for r, w in zip(relative, velocity, strict=True))) - speed * t

    if time_s is None:
        # never within reach (theory section 7): the gap stays open at all times looked at
        assert all(gap_m(t) > 0 for t in (1.0, 10.0, 100.0, 1e3, 1e4, 1e6))
        return
    # the path flown until then, to the rounding of distances that long
    assert abs(gap_m(time_s)) <= 1e-8 * (math.hypot(*relative) + (math.hypot(*velocity) + speed) * time_s)
    assert all(gap_m(share * time_s) > -1e-8 * speed * time_s for share in (0.1, 0.5, 0.9))


def test_time_to_go_by_hand() -> None:
    # standing: distance/speed; equal speeds, head on: closing at twice the speed; equal speeds, tail chase: never
    assert time_to_go_s((3000.0, 4000.0, 0.0), (0.0, 0.0, 0.0), 100.0) == 50.0
    assert time_to_go_s((1000.0, 0.0, 0.0), (-100.0, 0.0, 0.0), 100.0) == 5.0
    assert time_to_go_s((1000.0, 0.0, 0.0), (100.0, 0.0, 0.0), 100.0) is None
    # faster than the aircraft but coming: (2 V, V): 1000/(300) s
    assert time_to_go_s((1000.0, 0.0, 0.0), (-200.0, 0.0, 0.0), 100.0) == pytest.approx(1000.0 / 300.0, rel=1e-14)


def leaves(value: object, path: tuple = ()) -> list[tuple]:
    """List the paths of all values and tables."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(leaf for key, child in items for leaf in leaves(child, (*path, key)))]


VALUES = tomllib.loads(starter_scenario())
junk = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
    st.lists(st.floats(), max_size=4),
    st.dictionaries(st.text(max_size=5), st.integers(), max_size=2),
    st.sampled_from([[{}], [[[]]], {"name": {}}, [{"name": 3}], 10**400]),
)


@given(st.sampled_from(leaves(VALUES)[1:]), junk)
@settings(deadline=None, max_examples=150)
def test_whatever_arrives_anywhere_is_loaded_or_refused_in_plain_words(path: tuple, value: object) -> None:
    values = copy.deepcopy(VALUES)
    table = values
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    message = ""
    try:
        validate(values)
    except ScenarioError as error:
        message = str(error)
    for line in message.splitlines()[1:]:
        assert ": arrived " in line
        assert "; expected " in line


def test_hash_ignores_the_way_of_writing() -> None:
    reference = scenario_hash(loads(GOOD))
    assert len(reference) == 64
    assert loads(GOOD).hash == reference
    same = [
        "# a comment\n" + GOOD,
        changed(("seed = 0\n", "")),  # the default, left out
        changed(("freeze_s = 4.0", "freeze_s = 4")),
        changed(("proportional = 10", "proportional = [10.0, 10.0, 10.0]")),
        changed(("north_m = 9000.0\neast_m = 0.0", "east_m = 0.0\nnorth_m = 9000.0")),
        changed(('name = "ship"\nkind = "surface"', 'kind = "surface"\nname = "ship"')),
    ]
    assert {scenario_hash(loads(text)) for text in same} == {reference}


@pytest.mark.parametrize(
    "change",
    [
        ("seed = 0", "seed = 1"),
        ('"A base case"', '"The base case"'),
        ('"two-aircraft"', '"other"'),
        ("freeze_s = 4.0", "freeze_s = 4.000001"),
        ("from_deg = 0.0", "from_deg = 0.1"),
        ("[fleet]\nspeed_m_s = 150", "[fleet]\nspeed_m_s = 151"),
        ("radius_m = 4000", "radius_m = 4001"),
        ("proportional = 10", "proportional = [10, 10, 11]"),
        ("proportional = 10", "derivative = 2"),
        ("north_m = -8000.0", "north_m = -8001.0"),
        ("stand_off_up_m = 120", "stand_off_north_m = 0"),
        ("course_deg = 90", "course_deg = 91"),
        ("[hold]", "[guidance]\nposition_gain_per_s = 0\n[hold]"),
        ("[hold]", '[hold]\ndirection = "left"'),
        ("[hold]", "[earth]\nlatitude_deg = 46\n[hold]"),
        ("[hold]", "[requirements]\nmiss_max_m = 4\n[hold]"),
        ('goal = "ship"', 'goal = "ship"\nvariant = "s119"'),
        ('goal = "ship"', 'goal = "ship"\nx_cg_over_c = 0.3'),
        ('goal = "ship"', 'goal = "ship"\nbend = "left"'),
        WAYPOINT_GOAL,
    ],
)
def test_hash_changes_with_any_value(change: tuple[str, str]) -> None:
    assert loads(changed(change)).hash != loads(GOOD).hash
