"""Readable and unreadable files, and the scenarios distributed with anser."""

import math
import pickle
import tomllib
from pathlib import Path

import numpy as np
import pytest

from anser.config import ScenarioError
from anser.config.errors import describe_value
from anser.scenario import load, loads, validate
from anser.scenario.schema_reach import time_to_go_s

SHIPPED = sorted((Path(__file__).parents[2] / "scenarios").glob("*.toml"))
NAMES = ["climb-and-turn", "single-aircraft", "storm-sampling", "three-aircraft", "twenty-aircraft"]


def refused(path: Path) -> ScenarioError:
    with pytest.raises(ScenarioError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: 1 problem\n")
    return caught.value


def shipped(name: str) -> Path:
    return next(path for path in SHIPPED if path.stem == name)


def test_shipped_scenarios_are_there() -> None:
    assert set(NAMES) <= {path.stem for path in SHIPPED}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scenarios_load(path: Path) -> None:
    scenario = load(path)
    assert scenario.name == path.stem
    assert scenario.description


def test_the_published_fleet() -> None:
    # theory section 8, table of the three-aircraft case
    scenario = load(str(shipped("three-aircraft")))
    starts = [(a.start.north_m, a.start.east_m, a.start.altitude_m, a.start.course_deg) for a in scenario.aircraft]
    assert starts == [(1000, 9000, 1000, -90), (-2000, -8000, 1500, 20), (-6000, 5000, 1250, 0)]
    assert [a.start.speed_m_s for a in scenario.aircraft] == [150.0] * 3
    assert [a.rendezvous.stand_off_m for a in scenario.aircraft] == [(0.0, 0.0, 300.0)] * 3
    goals = [scenario.goal_of(a) for a in scenario.aircraft]
    assert [(g.north_m, g.east_m, g.altitude_m) for g in goals] == [(100, 0, 0), (0, 0, 0), (0, 100, 0)]
    velocities = [g.velocity_m_s() for g in goals]
    assert velocities[:2] == [(25.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    assert velocities[2] == pytest.approx((0.0, 15.0, 0.0), abs=1e-14)  # rounding of cos 90 deg


def test_the_twenty_aircraft_match_the_description_of_their_file() -> None:
    scenario = load(shipped("twenty-aircraft"))
    assert (len(scenario.aircraft), len(scenario.goal)) == (20, 12)
    starts = np.array([aircraft.start.position_m for aircraft in scenario.aircraft])
    goals = [scenario.goal_of(aircraft) for aircraft in scenario.aircraft]
    offsets = np.array([aircraft.rendezvous.stand_off_m for aircraft in scenario.aircraft])
    relative_m = np.array([goal.position_m(0.0) for goal in goals]) + offsets - starts
    through_air = np.array([goal.velocity_m_s() for goal in goals]) - scenario.wind.velocity_m_s(0.0)
    assert np.hypot(starts[:, 0], starts[:, 1]).min() >= 12e3
    assert np.hypot(starts[:, 0], starts[:, 1]).max() < 25.1e3
    inward = np.rad2deg(np.arctan2(relative_m[:, 1], relative_m[:, 0]))
    courses = np.array([aircraft.start.course_deg for aircraft in scenario.aircraft])
    assert np.abs((courses - inward + 180.0) % 360.0 - 180.0).max() <= 60.0
    # at the time of the farthest all rendezvous points are well outside each other's 500 m or 150 m
    times = [time_to_go_s((*r,), (*w,), scenario.fleet.speed_m_s) for r, w in zip(relative_m, through_air, strict=True)]
    arrival_s = max(time for time in times if time is not None)
    assert 40.0 < arrival_s - min(time for time in times if time is not None) < 60.0
    points = np.array([goal.position_m(arrival_s) for goal in goals]) + offsets
    for index, point in enumerate(points):
        distances = np.abs(points[:index] - point)
        assert np.all((np.hypot(distances[:, 0], distances[:, 1]) >= 700.0) | (distances[:, 2] >= 200.0))


def test_the_published_tracking_case() -> None:
    # theory section 5, end: the path ends at N 5000, E 2000, 2000 m, level, course 60 deg
    scenario = load(shipped("climb-and-turn"))
    (aircraft,) = scenario.aircraft
    coordinate_pairs = zip(scenario.goal_of(aircraft).position_m(30.0), aircraft.rendezvous.stand_off_m, strict=True)
    assert tuple(a + b for a, b in coordinate_pairs) == (5000.0, 2000.0, 2000.0)
    assert (aircraft.rendezvous.course_deg, aircraft.rendezvous.path_angle_deg) == (60.0, 0.0)
    assert (scenario.timing.replan_period_s, scenario.guidance.position_gain_per_s) == (0.0, 0.0)


def test_the_storm_drifts_with_its_wind_and_the_paths_have_similar_lengths() -> None:
    scenario = load(shipped("storm-sampling"))
    wind = scenario.wind.velocity_m_s(0.0)
    lengths_m = []
    for aircraft in scenario.aircraft:
        goal = scenario.goal_of(aircraft)
        drift = tuple(v - w for v, w in zip(goal.velocity_m_s(), wind, strict=True))
        assert drift == pytest.approx((0.0, 0.0, 0.0), abs=1e-13)  # rounding of sine and cosine
        parts = zip(goal.position_m(0.0), aircraft.rendezvous.stand_off_m, aircraft.start.position_m, strict=True)
        relative = tuple(g + s - a for g, s, a in parts)
        time_s = time_to_go_s(relative, drift, scenario.fleet.speed_m_s)
        assert time_s is not None
        lengths_m.append(time_s * scenario.fleet.speed_m_s)
        assert 10_000 <= math.hypot(aircraft.start.north_m, aircraft.start.east_m) <= 16_000
    # more than a fifth apart would ask for extreme detours
    assert max(lengths_m) / min(lengths_m) < 1.2


def test_a_missing_file_is_reported_with_a_suggestion(tmp_path: Path) -> None:
    (problem,) = refused(tmp_path / "none.toml").problems
    assert problem.arrived == "no file of this name"
    assert problem.expected == "the path of a scenario file"
    (tmp_path / "mine.toml").touch()
    (problem,) = refused(tmp_path / "mien.toml").problems
    assert problem.expected == f"the path of a scenario file, perhaps {describe_value(str(tmp_path / 'mine.toml'))}"
    (tmp_path / "e33_singlebr.toml").touch()
    (problem,) = refused(tmp_path / "missing.toml").problems  # the suffix does not make the names similar
    assert problem.expected == "the path of a scenario file"
    (problem,) = refused(tmp_path / "nowhere" / "mine.toml").problems
    assert problem.expected == "the path of a scenario file"


def test_a_folder_is_refused(tmp_path: Path) -> None:
    (problem,) = refused(tmp_path).problems
    assert problem.arrived == "a folder"
    assert "scenario file" in problem.expected


def test_a_path_through_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    (problem,) = refused(tmp_path / "file" / "case.toml").problems
    assert problem.arrived == "a path that cannot be read (Not a directory)"


def test_an_invalid_path_is_refused() -> None:
    with pytest.raises(ScenarioError, match="a path that cannot be read"):
        load("case\0.toml")


def test_a_file_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes('format = 1\nname = "Zürich"\n'.encode("latin-1"))
    (problem,) = refused(path).problems
    assert problem.arrived == "bytes that are not UTF-8 (in line 2)"
    assert problem.expected == "a text file in UTF-8"


def test_syntax_error_names_line_and_column(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text('format = 1\nname = "case\n[timing]\n')
    (problem,) = refused(path).problems
    assert problem.path == "line 2, column 13"
    assert 'name = "case' in problem.arrived
    assert problem.expected.startswith("valid TOML: ")


def test_syntax_error_at_the_end() -> None:
    with pytest.raises(ScenarioError) as caught:
        loads("format = 1\nx = [1,")
    assert caught.value.problems[0].path == "line 2, at the end"
    assert str(caught.value).startswith("<string>: ")


def test_a_duplicate_key_is_refused() -> None:
    with pytest.raises(ScenarioError) as caught:
        loads("format = 1\nformat = 1\n")
    assert caught.value.problems[0].path == "line 2, column 11"
    assert caught.value.problems[0].expected == "the key format once: line 1 has it too"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[goal]\n[goal]\n", "Cannot declare [goal] twice; a scenario has one table [[goal]] or more"),
        ("[[aircraft]]\n[aircraft]\n", "Cannot declare [aircraft] twice; a scenario has one table [[aircraft]]"),
        ("[goal]\n[[goal]]\n", "Cannot overwrite a value; a scenario has one table [[goal]] or more"),
        ("goal = {a = 1}\n[[goal]]\n", "Cannot mutate immutable namespace [goal]; a scenario has one table [[goal]]"),
        ("[[aircraft]]\n[start]\n[[aircraft]]\n[start]\n", "[start] twice; an aircraft has a table [aircraft.start]"),
        ("[[aircraft]]\n[aircraft.start]\n[aircraft.start]\n", "[aircraft.start] twice; a scenario has one table"),
        ("[timing]\n[timing]\n", "Cannot declare [timing] twice"),
        ("[[goal]]\nx = 1\n[[goal]]\nx = 2\nx = 3\n", "the key goal[1].x once: line 4 has it too"),
        ("x = 12,05 # m\n", "after a statement; with a decimal point, 12.05"),
        ("x = {a = -12,0, b = 3}\n", "; with a decimal point, -12.0"),
    ],
)
def test_toml_errors_are_explained_in_terms_of_a_scenario(text: str, said: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        loads(text)
    (problem,) = caught.value.problems
    assert said in problem.expected
    assert "('" not in problem.expected


def test_a_table_of_an_aircraft_without_its_prefix_is_explained() -> None:
    with pytest.raises(ScenarioError) as caught:
        loads('format = 1\n[[aircraft]]\nname = "a"\n[start]\nnorth_m = 1.0\n')
    (problem,) = (finding for finding in caught.value.problems if finding.path == "start")
    assert problem.expected.startswith("perhaps the table [aircraft.start]; the keys here are format, name")


def test_text_beyond_the_limits_of_python_is_refused() -> None:
    with pytest.raises(ScenarioError, match="more than 32 levels"):
        loads("x = " + "[" * 100_000)
    with pytest.raises(ScenarioError, match="text that cannot be read"):
        loads("x = " + "1" * 10_000)


def test_byte_order_mark_and_windows_line_ends_are_read(tmp_path: Path) -> None:
    original = shipped("three-aircraft")
    path = tmp_path / "case.toml"
    path.write_bytes(b"\xef\xbb\xbf" + original.read_bytes().replace(b"\n", b"\r\n"))
    assert load(path).hash == load(original).hash


def test_nested_values_are_validated() -> None:
    text = shipped("single-aircraft").read_text(encoding="utf-8")
    values = tomllib.loads(text)
    assert validate(values).hash == loads(text).hash
    values["aircraft"][0]["goal"] = "nowhere"
    with pytest.raises(ScenarioError, match=r'^<values>: 1 problem\n  aircraft\[0\]\.goal \(aircraft "aircraft-1"\)'):
        validate(values)


def test_error_survives_another_process() -> None:
    with pytest.raises(ScenarioError) as caught:
        loads("format = 3", "case.toml")
    unpickled = pickle.loads(pickle.dumps(caught.value))
    assert str(unpickled) == str(caught.value)
    assert unpickled.problems == caught.value.problems


LINES = """\
format = 2
name = "lines"
timing.duration_s = 90.0
note = '''
speed_m_s = 1
[fleet]
'''

[fleet]
sped_m_s = 150.0  # misspelt

[[aircraft]]
name = "north"
goal = "buoy"
start = { north_m = 8000, east_m = 500, altitude_m = "1200 ft", speed_m_s = 150, course_deg = 190 }

[[aircraft]]
name = "south"
goal = "buoy"
[aircraft.start]
north_m = -8000
east_m = 500
altitude_m = 1000
speed_m_s = "150"
course_deg = 0

[[goal]]
name = "buoy"
kind = "surface"
waypoints = [
  { time_s = 0, north_m = 0, east_m = 0, altitude_m = 0 },
  { time_s = 9, north_m = 0, est_m = 0, altitude_m = 0 },
]
"""


def test_each_problem_names_the_line_of_its_key() -> None:
    with pytest.raises(ScenarioError) as caught:
        loads(LINES, "lines.toml")
    lines_by_path = {problem.path: problem.line for problem in caught.value.problems}
    assert lines_by_path == {
        "fleet.sped_m_s": 10,
        "aircraft[0].start.altitude_m": 15,
        "aircraft[1].start.speed_m_s": 24,
        "goal[0].waypoints[1].est_m": 30,
        "note": 4,
    }
    text = str(caught.value)
    assert '\n  line 10, fleet.sped_m_s: arrived the unknown key "sped_m_s"' in text
    assert 'line 15, aircraft[0].start.altitude_m (aircraft "north"): arrived "1200 ft"' in text
    assert "1200 ft is 365.76 m: write 365.76" in text
    assert "from 1 to 340 m/s; write 150, without quotes" in text


def test_a_missing_key_names_the_line_of_its_table() -> None:
    text = LINES.replace("sped_m_s = 150.0  # misspelt", 'planner = "certified"')
    with pytest.raises(ScenarioError, match=r"line 9, fleet\.speed_m_s: arrived nothing"):
        loads(text)


def test_values_without_a_file_have_no_lines() -> None:
    with pytest.raises(ScenarioError) as caught:
        validate(tomllib.loads(LINES))
    assert {problem.line for problem in caught.value.problems} == {None}


def test_a_unit_after_a_number_is_reported() -> None:
    text = shipped("three-aircraft").read_text().replace("speed_m_s = 150.0", "speed_m_s = 150 m/s", 1)
    with pytest.raises(ScenarioError, match="150 alone, in the unit that the key's name ends with"):
        loads(text)
