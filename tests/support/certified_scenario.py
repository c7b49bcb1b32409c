"""A valid scenario for the certified planner, modifications, and checks of their consequences."""

import json

import pytest

from anser.config import ScenarioError
from anser.scenario import loads, validate

GOOD = """\
format = 1
name = "certified"
[timing]
duration_s = 120
[fleet]
speed_m_s = 150
planner = "certified"
[limits]
altitude_min_m = 100
[arrival]
rule = "together"
[separation]
horizontal_m = 500
vertical_m = 150
[[aircraft]]
name = "alpha"
goal = "ship"
start = { north_m = 9000, east_m = 0, altitude_m = 1000, speed_m_s = 150, course_deg = 180 }
[[aircraft]]
name = "bravo"
goal = "buoy"
start = { north_m = -8000, east_m = 100, altitude_m = 1500, speed_m_s = 150, course_deg = 10 }
[[goal]]
name = "ship"
kind = "surface"
north_m = 0
east_m = 0
speed_m_s = 8
course_deg = 60
[[goal]]
name = "buoy"
kind = "surface"
north_m = 300
east_m = 2000
"""
CELL = '[[keep_out]]\nname = "cell"\nnorth_m = 4000\neast_m = 4000\nradius_m = 1000\n'
ALPHA, BRAVO = 'name = "alpha"', 'name = "bravo"'
TOGETHER = 'rule = "together"'
WINDOWS = [
    (TOGETHER, 'rule = "windows"'),
    (ALPHA, f"{ALPHA}\narrive_from_s = 80\narrive_to_s = 90"),
    (BRAVO, f"{BRAVO}\narrive_from_s = 70\narrive_to_s = 100"),
]
TIMES = [(TOGETHER, 'rule = "times"'), (ALPHA, f"{ALPHA}\narrive_s = 80"), (BRAVO, f"{BRAVO}\narrive_s = 90.5")]
SEQUENCE = [(TOGETHER, 'rule = "sequence"\nspacing_s = 20\norder = ["bravo", "alpha"]')]
AT = [(TOGETHER, 'rule = "at"\ntime_s = 90')]
PUBLISHED = [
    ('planner = "certified"\n', ""),
    ('[arrival]\nrule = "together"\n', ""),
    ("[separation]\nhorizontal_m = 500\nvertical_m = 150\n", ""),
]
WHO_A, WHO_B = 'aircraft "alpha"', 'aircraft "bravo"'
ALONE = 'fleet.planner = "certified" beside it'
SAME_GOAL = [('goal = "buoy"', 'goal = "ship"')]
FAST_SHIP = ("speed_m_s = 8\ncourse_deg = 60", "speed_m_s = 155\ncourse_deg = 180")


def changed(changes) -> str:
    """The valid scenario with replaced pieces; each piece must exist in the scenario."""
    text = GOOD
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def and_cell(old="", new=""):
    """Add a keep-out with one modification."""
    assert old in CELL
    return [("[[goal]]", f"{CELL.replace(old, new) if old else CELL}[[goal]]")]


def check_refusal(changes, path: str, whom: str, arrived: str, expected: str) -> None:
    """Check for a refusal with exactly one problem: path, subject, parts of the value found and the expectation."""
    with pytest.raises(ScenarioError) as refused:
        loads(changed(changes), "case.toml")
    assert len(refused.value.problems) == 1, str(refused.value)
    problem = refused.value.problems[0]
    assert (problem.path, problem.subject) == (path, whom)
    assert arrived in problem.arrived
    assert expected in problem.expected


def check_allowed(changes) -> None:
    """Check that the scenario loads, also from the record of its values."""
    scenario = loads(changed(changes))
    reloaded = validate(json.loads(scenario.model_dump_json()))
    assert reloaded == scenario
    assert reloaded.hash == scenario.hash
