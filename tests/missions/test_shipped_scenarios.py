"""Flights of the other shipped scenarios: required accuracy."""

from pathlib import Path

import pytest

import anser
from anser.results.flight_rows import CLEARANCE_MIN_M
from anser.scenario import load, loads

pytestmark = pytest.mark.long


SCENARIOS = Path(__file__).parents[2] / "scenarios"


@pytest.mark.parametrize("name", ["single-aircraft", "storm-sampling"])
def test_the_goals_are_met_together_with_clearance(name):
    # Measured: 0.04 m; 0.06 m and 0.0001 s.
    flown = anser.run(load(SCENARIOS / f"{name}.toml"))
    assert flown.met
    entries = flown.summary["aircraft"]
    assert max(entry["miss_m"] for entry in entries) <= 3.0
    assert flown.summary["fleet"]["arrival_spread_s"] <= 0.05
    for entry, aircraft in zip(entries, flown.scenario.aircraft, strict=True):
        assert entry["clearance_min_m"] >= CLEARANCE_MIN_M[flown.scenario.goal_of(aircraft).kind]


def test_climb_and_turn_on_velocity_commands_alone():
    # Published: under 1.5 m at all times (theory section 5). Measured 1.08 m with the published gains.
    flown = anser.run(load(SCENARIOS / "climb-and-turn.toml"))
    assert flown.scenario.guidance.position_gain_per_s == 0.0
    assert flown.summary["aircraft"][0]["position_error_max_m"] < 1.5


def test_climb_and_turn_with_position_feedback():
    text = (SCENARIOS / "climb-and-turn.toml").read_text()
    flown = anser.run(loads(text.replace("position_gain_per_s = 0.0", "position_gain_per_s = 0.3")))
    arrival = flown.summary["aircraft"][0]["arrival_s"]
    error = flown.dataset.position_error_m.sel(time=slice(10.0, arrival))
    # Measured 0.13 m from 10 s on.
    assert float(error.max()) < 0.3
