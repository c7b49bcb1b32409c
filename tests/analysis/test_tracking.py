"""Climb-and-turn of the gallery: the shipped scenario with the requested variant and inversion."""

from pathlib import Path

import pytest

from anser.analysis import climb_and_turn
from anser.config import ScenarioError
from anser.missions import run
from anser.scenario import load

SHIPPED = Path(__file__).parents[2] / "scenarios" / "climb-and-turn.toml"


def test_the_case_is_the_shipped_scenario():
    default, shipped = climb_and_turn(), load(SHIPPED)
    assert default.aircraft == shipped.aircraft
    assert default.requirements == shipped.requirements


def test_variant_and_inversion_are_those_requested():
    (aircraft,) = climb_and_turn("s119", "incremental").aircraft
    assert (aircraft.variant, aircraft.gains.inversion) == ("s119", "incremental")
    with pytest.raises(ScenarioError, match="variant"):
        climb_and_turn("nonesuch")


@pytest.mark.long
def test_the_complete_f16_flies_the_case_within_the_requirements():
    """The tables are not symmetric: the bank has to carry a side force (tests/control/test_side_force.py)."""
    flight = run(climb_and_turn("tp1538"))
    assert flight.met
    (aircraft,) = flight.summary["aircraft"]
    # The arrival is after the planned time, in the hold, where no planned point exists.
    assert aircraft["arrival_s"] > aircraft["planned_arrival_s"]
    assert aircraft["position_error_max_m"] < 1.5
