"""Conflicts of several aircraft are reported as one problem."""

from pathlib import Path

import pytest

from anser.config import ScenarioError
from anser.scenario import load
from anser.scenario.schema_airspace_checks import connected_groups

THREE = load(Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml")


def test_connected_groups_are_the_connected_components():
    links = {(1, 4), (4, 5), (2, 3)}
    assert connected_groups(7, lambda i, j: (j, i) in links or (i, j) in links) == [[1, 4, 5], [2, 3]]
    assert connected_groups(4, lambda i, j: False) == []
    assert connected_groups(4, lambda i, j: True) == [[0, 1, 2, 3]]


def four(**change):
    """Four distant aircraft, each with its own goal, with the same changes to all four."""
    template = THREE.aircraft[0].model_dump(mode="json", exclude_unset=True)
    goal = {"kind": "surface", "east_m": 0.0}
    aircraft, goals = [], []
    for k in range(4):
        start = {**template["start"], "north_m": 1000.0 + 3000.0 * k}
        aircraft.append({**template, "name": f"a{k}", "goal": f"g{k}", "start": start} | change)
        goals.append({**goal, "name": f"g{k}", "north_m": 500.0 * k})
    return THREE.replace("aircraft", aircraft, "goal", goals)


def test_four_aircraft_at_one_rendezvous_are_one_problem_that_names_all():
    assert len(four().aircraft) == 4
    with pytest.raises(ScenarioError) as caught:
        four(goal="g1")
    (problem,) = caught.value.problems
    assert problem.path == "aircraft[1].rendezvous"
    for k in range(4):
        assert f'"a{k}"' in str(problem)


def test_four_aircraft_at_one_start_are_one_problem_that_names_all():
    with pytest.raises(ScenarioError) as caught:
        four(start=four().aircraft[0].start.model_dump())
    (problem,) = caught.value.problems
    assert problem.path == "aircraft[1].start"
    for k in range(4):
        assert f'"a{k}"' in str(problem)


def test_starts_closer_than_the_separation_are_one_problem_with_the_closest_pair():
    certified = four().replace("fleet.planner", "certified")
    separated = certified.replace("separation.horizontal_m", 2900.0)
    assert separated.separation.horizontal_m == 2900.0
    with pytest.raises(ScenarioError) as caught:
        certified.replace("separation.horizontal_m", 3100.0)
    (problem,) = caught.value.problems
    assert "3000.0 m in the plane" in problem.arrived
    assert "the closest of 3 pairs" in problem.arrived
    for k in range(4):
        assert f'"a{k}"' in problem.arrived
