"""Flights in batches come to what each comes to by itself, and say why one cannot begin."""

from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
import pytest

import anser
from anser.missions import fly_many
from anser.missions.flight_batches import FlightCase, _FlightGroup
from anser.missions.series import SeriesSelection
from anser.numerics.arrays import as_array
from anser.numerics.randomness import BlendedRandomness
from anser.results.flight_rows import FlightRow
from anser.results.variable_labels import catalogue_variable

SCENARIOS = Path(__file__).parents[2] / "scenarios"
THREE = anser.load(SCENARIOS / "three-aircraft.toml")
SHORT = anser.load(SCENARIOS.parent / "studies" / "short-approach.toml")
_SCALE = 1e-9  # of each number: batches of another shape round otherwise


def assert_equals(row, flown):
    """What a row has is in the summary, to rounding."""

    def compare(own, other, place):
        if isinstance(own, dict):
            for key, value in own.items():
                compare(value, other[key], f"{place}/{key}")
        elif isinstance(own, list):
            assert len(own) == len(other)
            for k, (one, another) in enumerate(zip(own, other, strict=True)):
                compare(one, another, f"{place}/{k}")
        elif isinstance(own, float):
            assert own == pytest.approx(other, rel=_SCALE, abs=_SCALE), place
        else:
            assert own == other, place

    for part in ("aircraft", "fleet", "requirements"):
        compare(getattr(row, part), flown.summary[part], part)
    assert row.met == flown.met


@pytest.mark.long
def test_flights_that_are_all_the_same_fly_too():
    first, again = fly_many([FlightCase(THREE), FlightCase(THREE)])
    assert first.met
    assert first == again


@pytest.mark.long
def test_flights_in_float32_come_to_those_in_float64_and_a_single_one_to_its_row():
    # Measured here: 0.2 mm and 2 us; of 256 published flights of three 2 mm and 0.1 ms. Alone and in a batch: 0.03 mm.
    # The paths of the three are bent, and renewed: a step in which they ask for no acceleration would cost a decimetre.
    cases = [*(FlightCase(SHORT, seed=seed) for seed in range(4)), FlightCase(THREE.replace("timing.duration_s", 62.0))]
    exact, rounded = (fly_many(cases, precision=precision) for precision in ("float64", "float32"))
    pairs = zip(*([one for row in rows for one in row.aircraft] for rows in (exact, rounded)), strict=True)
    for one, other in pairs:
        assert other["status"] == one["status"]
        assert other["miss_m"] == pytest.approx(one["miss_m"], abs=5e-3)
        assert other["arrival_s"] == pytest.approx(one["arrival_s"], abs=1e-4)
        assert other["miss_m"] != one["miss_m"]
    alone = anser.run(SHORT.replace("seed", 2), precision="float32")
    assert {values.dtype for name, values in alone.dataset.items() if name.endswith("_m")} == {np.dtype(float)}
    found = FlightRow(alone.summary["aircraft"], alone.summary["fleet"], alone.summary["requirements"], alone.met)
    for key in ("miss_m", "arrival_s", "speed_mean_m_s"):
        assert found.aircraft[0][key] == pytest.approx(rounded[2].aircraft[0][key], abs=5e-4), key


def test_what_float32_does_not_fit_is_a_row_with_the_reason():
    round_earth, lost = THREE.replace("earth", "wgs84"), anser.load(SCENARIOS / "lost-aircraft.toml")
    rows = fly_many([FlightCase(round_earth), FlightCase(lost)], precision="float32")
    assert [row.met for row in rows] == [False, False]
    assert 'precision: arrived "float32" of a round Earth' in rows[0].reason
    assert 'precision: arrived "float32" of one with events' in rows[1].reason
    with pytest.raises(anser.config.ScenarioError, match="without a centre"):
        anser.run(lost, precision="float32")


def test_rows_are_the_summaries_of_single_flights():
    first = THREE.replace("timing.duration_s", 75.0)  # the arrival is at 60 s
    other = first.replace("fleet.speed_m_s", 148.0)
    told = []
    rows = fly_many(
        [FlightCase(first), FlightCase(other)],
        lambda what, part: told.append(part),
        on_rows=lambda k, r: told.append(k),
    )
    assert rows[0].met
    assert rows[0].fleet != rows[1].fleet
    assert_equals(rows[0], anser.run(first))
    assert_equals(rows[1], anser.run(other))
    assert told == [0.0, [0, 1], 1.0]


@pytest.mark.long
def test_rows_in_wind_are_the_summaries_of_single_flights():
    still = THREE.replace("timing.duration_s", 75.0)  # in wind the arrival is at 70 s
    windy = still.replace("wind.speed_m_s", 9.0, "wind.from_deg", 250.0)
    rows = fly_many([FlightCase(still), FlightCase(windy)])
    assert_equals(rows[1], anser.run(windy))


@pytest.mark.long
def test_a_flight_that_cannot_begin_is_a_row_with_its_reason():
    high = THREE.replace("aircraft[aircraft-2].start.altitude_m", 15000.0)
    good, bad = fly_many([FlightCase(THREE), FlightCase(high)])
    assert good.met
    assert not bad.met
    assert "aircraft-2" in bad.reason
    assert bad.aircraft == []


@pytest.mark.long
@pytest.mark.parametrize("name", ["uncertain-world", "storm-sampling", "lost-aircraft"])
def test_certified_flights_too(name):
    """With noise: the same numbers are drawn in a batch. With events they are flown one by one."""
    scenario = anser.load(SCENARIOS / f"{name}.toml")
    first, again = fly_many([FlightCase(scenario), FlightCase(scenario)])
    flown = anser.run(scenario)
    assert_equals(first, flown)
    assert_equals(again, flown)


@pytest.mark.long
def test_each_flight_is_judged_by_its_own_separation():
    storm = anser.load(SCENARIOS / "storm-sampling.toml")
    narrow, wide = (storm.replace("separation", {"horizontal_m": apart_m}) for apart_m in (300.0, 500.0))
    rows = fly_many([FlightCase(narrow), FlightCase(wide)])
    assert_equals(rows[0], anser.run(narrow))
    assert_equals(rows[1], anser.run(wide))


@pytest.mark.long
def test_flights_of_other_numbers_draw_other_noise():
    scenario = anser.load(SCENARIOS / "uncertain-world.toml")
    rows = fly_many([FlightCase(scenario, number) for number in range(3)])
    misses = np.array([[one["miss_m"] for one in row.aircraft] for row in rows])
    assert np.all(np.ptp(misses, axis=0) > 1e-3)


class Part(eqx.Module):
    absent: None
    number: Any
    table: Any


def test_what_a_flight_has_not_is_not_counted_among_what_differs():
    """Of a second batch of one group; what differed once stays apart."""
    group = _FlightGroup()

    def of(*numbers):
        return [Part(None, as_array(number), as_array([1.0, 2.0])) for number in numbers]

    first = group.stacked(of(1.0, 2.0), 2)
    second = group.stacked(of(3.0), 2)
    assert first.shared.table is not None
    assert second.batched.number.tolist() == [3.0, 3.0]
    assert second.batched.absent is None
    assert second.shared.table is not None


def test_random_numbers_of_its_own_are_refused_for_what_is_flown_alone():
    source = BlendedRandomness(as_array(np.zeros((1, 2)), np.uint32), as_array([1.0]), as_array(1, np.int32))
    alone = THREE.replace("fleet.planner", "decentralised")
    with pytest.raises(ValueError, match="arrived random numbers of its own; expected 0 and none"):
        fly_many([FlightCase(alone, randomness=source)])


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "every_s"), [("three-aircraft", 0.7), ("uncertain-world", 1.0), ("lost-aircraft", 0.5)]
)
def test_series_are_those_of_single_flights(name, every_s):
    """Also where it is flown alone, with periods that do not fill a segment, and a variable that is not there."""
    scenario = anser.load(SCENARIOS / f"{name}.toml").replace("timing.record_period_s", every_s)
    kept = SeriesSelection.from_period(
        scenario, ("north", "east", "course", "phase", "speed_limited", "clock_lag"), every_s
    )
    (row,) = fly_many([FlightCase(scenario)], series=kept)
    flown = anser.run(scenario).dataset
    np.testing.assert_allclose(kept.times_s(scenario), flown["time"].values, atol=1e-9)
    for key in kept.keys[:-1]:
        single = flown[catalogue_variable(key).name].values.T
        scale = 1e4 if key in ("north", "east") else 100.0
        np.testing.assert_allclose(row.series[key], single, rtol=0.0, atol=_SCALE * scale)
    assert row.series["clock_lag"].shape == row.series["north"].shape
    assert np.isnan(row.series["clock_lag"]).all()
