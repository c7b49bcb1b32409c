"""A scenario of two aircraft that the tests of the schema change, and what its refusals must tell."""

import pytest

from anser.config import ScenarioError
from anser.scenario import loads

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
PUBLISHED_SPEED = ("speed_m_s = 150.0\n", 'speed_m_s = 150.0\nspeed_profile = "published"\n')
WAYPOINT_GOAL = (
    "north_m = 0.0\neast_m = 0.0\nspeed_m_s = 8.0\ncourse_deg = 90.0\n",
    "waypoints = [{time_s = 0, north_m = 0, east_m = 0, altitude_m = 0},"
    " {time_s = 50, north_m = 0, east_m = 500, altitude_m = 0}]\n",
)


def changed(*changes: tuple[str, str]) -> str:
    """The valid scenario with replaced pieces; each piece must exist in the scenario."""
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


def assert_told(changes: list[tuple[str, str]], problem_texts: tuple[str, str, str, str]) -> None:
    """Check for exactly one problem in the changed scenario: path, subject, value found and expectation."""
    path, subject, arrived, expected = problem_texts
    error = refusal(changed(*changes))
    assert len(error.problems) == 1, str(error)
    problem = error.problems[0]
    assert problem.path == path
    assert problem.subject == subject
    assert arrived in problem.arrived
    assert expected in problem.expected
    for part in problem_texts:
        assert part in str(error).splitlines()[1]
