"""Sweeps: labelled flights of every combination; an invalid combination is refused before the first flight."""

from pathlib import Path

import numpy as np
import pytest

import anser
from anser.config import ScenarioError
from anser.missions.sweeps import _coordinate_values, swept_scenarios

THREE = anser.load(Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml")


@pytest.mark.long
def test_every_combination_is_flown_and_labelled():
    data = anser.sweep(THREE, {"wind.speed_m_s": [0.0, 8.0], "goal[0].speed_m_s": [5.0, 10.0]})
    assert dict(data.sizes) == {"wind.speed_m_s": 2, "goal[0].speed_m_s": 2, "aircraft": 3}
    assert data["met"].values.all()
    assert (data["status"] == "arrived").all()
    spread = data["arrival_s"].max("aircraft") - data["arrival_s"].min("aircraft")
    np.testing.assert_allclose(data["arrival_spread_s"], spread, atol=1e-12)
    # What is swept reaches the flights: another wind and another goal are other arrivals.
    arrivals = data["arrival_s"].max("aircraft").values
    assert len(np.unique(arrivals.round(6))) == 4
    single = anser.run(THREE.replace("wind.speed_m_s", 8.0, "goal[0].speed_m_s", 5.0))
    combination = data.sel({"wind.speed_m_s": 8.0, "goal[0].speed_m_s": 5.0})
    for entry in single.summary["aircraft"]:
        aircraft_data = combination.sel(aircraft=entry["name"])
        assert float(aircraft_data["arrival_s"]) == pytest.approx(entry["arrival_s"], abs=1e-9)
        assert float(aircraft_data["miss_m"]) == pytest.approx(entry["miss_m"], abs=1e-6)
    assert data.attrs["scenario_hash"] == THREE.hash
    assert data["arrival_s"].attrs["units"] == "s"


def test_numbers_of_numpy_are_coordinates():
    np.testing.assert_array_equal(_coordinate_values([np.int64(0), np.float32(2.5)]), [0.0, 2.5])
    assert _coordinate_values([np.True_, np.False_]).dtype == bool


def test_the_last_path_varies_fastest():
    variants = swept_scenarios(THREE, {"wind.speed_m_s": [0.0, 5.0], "fleet.speed_m_s": [150.0, 160.0]})
    assert [(variant.wind.speed_m_s, variant.fleet.speed_m_s) for variant in variants] == [
        (0, 150),
        (0, 160),
        (5, 150),
        (5, 160),
    ]


@pytest.mark.parametrize(
    ("swept", "said"),
    [
        ({"wind.speed_m_s": [5.0, -5.0]}, ("wind.speed_m_s = -5.0", "wind.speed_m_s", "sweep of three-aircraft")),
        ({"wind.sped_m_s": [5.0]}, ("wind.sped_m_s",)),
        ({"goal[nobody].speed_m_s": [5.0]}, ("nobody",)),
        ({"aircraft[0].name": ["one", "two"]}, ("same fleet",)),
    ],
)
def test_an_invalid_combination_refuses_the_sweep(swept, said):
    with pytest.raises(ScenarioError) as refusal:
        anser.sweep(THREE, swept)
    for text in said:
        assert text in str(refusal.value)


TWO_NAMES = {"aircraft[1].start.speed_m_s": [150.0], "aircraft[aircraft-2].start.speed_m_s": [140.0]}


@pytest.mark.parametrize(
    "swept",
    [
        {},
        {"wind.speed_m_s": []},
        {"wind.speed_m_s": [1, 1.0]},
        {"wind.speed_m_s": "5"},
        {"wind.speed_m_s": 5},
        TWO_NAMES,
    ],
)
def test_an_invalid_sweep_is_refused(swept):
    with pytest.raises(ValueError, match=r"sweep.*arrived.*expected"):
        swept_scenarios(THREE, swept)


def test_many_refused_combinations_are_counted():
    with pytest.raises(ScenarioError, match="9 of 10 combinations, the first 5 told"):
        swept_scenarios(THREE, {"fleet.speed_m_s": [*range(-9, 0), 150]})
