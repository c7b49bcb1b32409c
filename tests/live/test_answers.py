"""Answers of the live page: entries made from the record of a plan."""

import pytest

import anser
from anser.live.answers import _separation_entry, make_answer
from support.plan_case import plan_case


@pytest.mark.parametrize(
    ("separation_m", "required_m", "distances_m", "is_met"),
    [
        ((500.0, 100.0), [500.0, 100.0], [510.0, 50.49], True),  # the scaled measure 512.5 is no distance
        ((600.0, 100.0), [600.0, 100.0], [510.0, 50.49], False),
        ((512.0, 0.0), [512.0], [512.5], True),
        (None, [], [512.5], True),
    ],
)
def test_the_closest_pair_has_its_distances_in_the_plane_and_in_altitude(separation_m, required_m, distances_m, is_met):
    samples, details = plan_case(separation_m=separation_m)
    entry = _separation_entry(details.scenario, samples)
    assert entry["pair"] == ["anna", "bert"]
    assert (entry["required_m"], entry["distances_m"], entry["is_met"]) == (required_m, distances_m, is_met)


def test_a_plan_of_the_published_planner_is_not_certified():
    answer, planned = make_answer(anser.load("scenarios/single-aircraft.toml"), lambda text: None)
    assert planned.problems() == ()
    assert (answer["status"], answer["certified"]) == ("planned", False)
