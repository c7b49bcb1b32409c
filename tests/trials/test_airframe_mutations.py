"""A sample of the trial of mutated aircraft files, and the trial's detection of wrong answers."""

import tomllib

import pytest

from anser.aircraft_files.sources import airframe_starter
from trials.airframe_mutations import outcomes, principal_margin, table, try_toml

STARTER = tomllib.loads(airframe_starter())


@pytest.mark.long
def test_a_sample_is_refused_or_right():
    results = list(outcomes(bodies=30, seed=3, every_unit=80))
    assert [outcome for outcome in results if not outcome.good] == []
    assert {outcome.answer for outcome in results} == {"refused", "right"}
    assert {outcome.file for outcome in results} == {"DAVE-ML", "aircraft file"}
    assert table(results).count("\n") > 10


@pytest.mark.long
def test_every_unit_and_a_thousand_bodies_are_refused_or_right():
    assert [outcome for outcome in outcomes(bodies=1000, seed=41) if not outcome.good] == []


@pytest.mark.parametrize(
    ("changes", "refusal", "answer"),
    [
        ({}, "", "right"),
        ({}, "mass", "accepted though wrong"),
        ({"Jzz_kg_m2": 9e3}, "", "refused though right"),
        ({"Jzz_kg_m2": 9e3}, "Jxx_kg", "refused without its place"),
        ({"Jzz_kg_m2": 9e3}, "mass.Jzz", "refused"),
    ],
)
def test_wrong_answers_are_detected(changes, refusal, answer):
    values = {**STARTER, "mass": {**STARTER["mass"], **changes}}
    assert try_toml("mass", "a change", values, refusal).answer == answer


def test_the_margin_is_that_of_a_body():
    assert principal_margin([[2.0, 0, 0], [0, 2.0, 0], [0, 0, 2.0]]) == pytest.approx(1.0)
    assert principal_margin([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 2.5]]) == pytest.approx(-0.2)
