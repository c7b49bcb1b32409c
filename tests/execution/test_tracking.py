"""The climb-and-turn of the gallery: the shipped scenario, with what the gallery was asked for."""

from importlib import resources
from pathlib import Path

import pytest

from anser.execution import CLIMB_AND_TURN
from anser.execution.tracking import climb_and_turn
from anser.scenario import ScenarioError, load

SHIPPED = Path(__file__).parents[2] / "scenarios" / CLIMB_AND_TURN


def test_the_copy_is_the_shipped_scenario():
    copy = resources.files("anser.execution").joinpath(f"data/{CLIMB_AND_TURN}").read_text(encoding="utf-8")
    assert copy == SHIPPED.read_text(encoding="utf-8")
    usual, shipped = climb_and_turn(), load(SHIPPED)
    assert usual.aircraft == shipped.aircraft
    assert usual.requirements == shipped.requirements


def test_variant_and_inversion_are_those_asked_for():
    (aircraft,) = climb_and_turn("s119", "incremental").aircraft
    assert (aircraft.variant, aircraft.gains.inversion) == ("s119", "incremental")
    with pytest.raises(ScenarioError, match="variant"):
        climb_and_turn("nonesuch")
