"""Goals: refusals, and motion along waypoints."""

import pytest

from anser.scenario.schema_aircraft import Goal, Waypoint
from support.two_aircraft import WAYPOINT_GOAL, assert_told

# one change of the good scenario, then: path, whom, what arrived (a part), what would be right (a part)
CASES = {
    "airborne goal on the surface": (
        [("altitude_m = 1200.0", "altitude_m = 49.0")],
        ("goal[1].altitude_m", 'goal "balloon"', "49", 'at 50 m or higher; for a lower one, kind = "surface"'),
    ),
    "airborne goal that sinks to the surface": (
        [("altitude_m = 1200.0", "altitude_m = 1200.0\nclimb_rate_m_s = -9.6")],
        ("goal[1].climb_rate_m_s", 'goal "balloon"', "-9.6, which brings it to 48.0 m", "at 50 m or higher"),
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
}


@pytest.mark.parametrize("case", CASES)
def test_a_refusal_names_the_key_its_value_and_the_expected_value(case: str) -> None:
    assert_told(*CASES[case])


def test_waypoints_are_followed_and_the_last_is_kept() -> None:
    points = [(0.0, 0.0, 0.0, 100.0), (10.0, 50.0, -20.0, 100.0), (30.0, 50.0, 20.0, 160.0)]
    waypoints = tuple(Waypoint(time_s=t, north_m=n, east_m=e, altitude_m=h) for t, n, e, h in points)
    goal = Goal(name="drone", kind="airborne", waypoints=waypoints)
    for time_s, north_m, east_m, altitude_m in points:
        assert goal.position_m(time_s) == (north_m, east_m, altitude_m)
    assert goal.position_m(5.0) == (25.0, -10.0, 100.0)
    assert goal.position_m(25.0) == (50.0, 10.0, 145.0)
    assert goal.position_m(1e5) == (50.0, 20.0, 160.0)
