"""Flights in batches: equality with single flights, and reasons for flights that cannot start."""

from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
import pytest

import anser
from anser.config import ScenarioError
from anser.missions import fly_many
from anser.missions.flight_batches import FlightCase, _FlightGroup
from anser.missions.series import SeriesSelection
from anser.numerics.arrays import as_array
from anser.numerics.randomness import BlendedRandomness
from anser.results.flight_rows import FlightRow
from anser.results.variable_labels import catalogue_variable

SCENARIOS = Path(__file__).parents[2] / "scenarios"
THREE = anser.load(SCENARIOS / "three-aircraft.toml")
ONE = anser.load(SCENARIOS / "single-aircraft.toml")
SHORT = anser.load(SCENARIOS.parent / "studies" / "short-approach.toml")
_SCALE = 1e-9  # of each number: batches of another shape round otherwise


def assert_row_equals_summary(flight_row, flown):
    """Compare a row with the summary of a flight, up to rounding."""

    def compare(row_value, summary_value, key_path):
        if isinstance(row_value, dict):
            for key, value in row_value.items():
                compare(value, summary_value[key], f"{key_path}/{key}")
        elif isinstance(row_value, list):
            assert len(row_value) == len(summary_value)
            for k, (row_item, summary_item) in enumerate(zip(row_value, summary_value, strict=True)):
                compare(row_item, summary_item, f"{key_path}/{k}")
        elif isinstance(row_value, float):
            assert row_value == pytest.approx(summary_value, rel=_SCALE, abs=_SCALE), key_path
        else:
            assert row_value == summary_value, key_path

    for part in ("aircraft", "fleet", "requirements"):
        compare(getattr(flight_row, part), flown.summary[part], part)
    assert flight_row.met == flown.met


@pytest.mark.long
def test_identical_flights_fly_in_a_batch():
    flight_a, flight_b = fly_many([FlightCase(THREE), FlightCase(THREE)])
    assert flight_a.met
    assert flight_a == flight_b


@pytest.mark.long
def test_float32_flights_agree_with_float64_flights_and_with_a_single_flight():
    # Measured here: 0.2 mm and 2 us; of 256 published flights of three 2 mm and 0.1 ms. Alone and in a batch: 0.03 mm.
    # The paths of the three are bent, and renewed: a step in which they ask for no acceleration would cost a decimetre.
    cases = [*(FlightCase(SHORT, seed=seed) for seed in range(4)), FlightCase(THREE.replace("timing.duration_s", 62.0))]
    exact, rounded = (fly_many(cases, precision=precision) for precision in ("float64", "float32"))
    pairs = zip(
        *([entry for flight_row in flight_rows for entry in flight_row.aircraft] for flight_rows in (exact, rounded)),
        strict=True,
    )
    for entry, rounded_entry in pairs:
        assert rounded_entry["status"] == entry["status"]
        assert rounded_entry["miss_m"] == pytest.approx(entry["miss_m"], abs=5e-3)
        assert rounded_entry["arrival_s"] == pytest.approx(entry["arrival_s"], abs=1e-4)
        assert rounded_entry["miss_m"] != entry["miss_m"]
    single = anser.run(SHORT.replace("seed", 2), precision="float32")
    assert {values.dtype for name, values in single.dataset.items() if name.endswith("_m")} == {np.dtype(float)}
    single_row = FlightRow(
        single.summary["aircraft"], single.summary["fleet"], single.summary["requirements"], single.met
    )
    for key in ("miss_m", "arrival_s", "speed_mean_m_s"):
        assert single_row.aircraft[0][key] == pytest.approx(rounded[2].aircraft[0][key], abs=5e-4), key


def test_a_scenario_that_does_not_allow_float32_gives_a_row_with_the_reason():
    round_earth, lost = THREE.replace("earth", "wgs84"), anser.load(SCENARIOS / "lost-aircraft.toml")
    flight_rows = fly_many([FlightCase(round_earth), FlightCase(lost)], precision="float32")
    assert [flight_row.met for flight_row in flight_rows] == [False, False]
    assert 'precision: arrived "float32" of a round Earth' in flight_rows[0].reason
    assert 'precision: arrived "float32" of one with events' in flight_rows[1].reason
    with pytest.raises(ScenarioError, match="without a centre"):
        anser.run(lost, precision="float32")


@pytest.mark.parametrize(
    "nominal",
    [
        ONE.replace("timing.duration_s", 60.0, "timing.step_s", 0.02),  # the arrival is at 33 s
        # the arrival is at 60 s, in wind at 63 s
        pytest.param(THREE.replace("timing.duration_s", 66.0, "timing.step_s", 0.02), marks=pytest.mark.long),
    ],
    ids=["one aircraft", "three aircraft"],
)
def test_rows_are_the_summaries_of_single_flights(nominal):
    windy = nominal.replace("wind.speed_m_s", 3.0, "wind.from_deg", 250.0)
    calls = []
    flight_rows = fly_many(
        [FlightCase(nominal), FlightCase(windy)],
        lambda message, share: calls.append(share),
        on_rows=lambda k, r: calls.append(k),
    )
    assert flight_rows[0].met
    assert flight_rows[0].aircraft != flight_rows[1].aircraft
    assert_row_equals_summary(flight_rows[0], anser.run(nominal))
    assert_row_equals_summary(flight_rows[1], anser.run(windy))
    *shares, rows, last_share = calls
    assert shares[0] == 0.0
    assert len(shares) > 5  # the share grows within the batch
    assert shares == sorted(shares)
    assert (shares[-1], rows, last_share) == (1.0, [0, 1], 1.0)


@pytest.mark.long
def test_rows_of_excited_aircraft_that_change_are_the_summaries_of_single_flights():
    """Changes of an aircraft need no stop of the flight, so that a campaign flies them in batches."""
    name = SHORT.aircraft[0].name
    scenario = SHORT.replace(
        "event",
        [{"time_s": 5.0, "kind": "aircraft-changes", "aircraft": name, "deviation": {"cg_shift": 0.03, "drag": 1.2}}],
        "excitation",
        [{"inputs": ["elevator", "rudder"], "signal": "doublet", "amplitude": [1.0, 0.5], "start_s": 6.0}],
    )
    stronger = scenario.replace("event[0].deviation.drag", 1.4, "excitation[0].amplitude", 2.0)
    rows, healthy = fly_many([FlightCase(scenario), FlightCase(stronger)]), fly_many([FlightCase(SHORT)])[0]
    for row, flown in zip(rows, (scenario, stronger), strict=True):
        assert_row_equals_summary(row, anser.run(flown))
    assert len({row.aircraft[0]["miss_m"] for row in (*rows, healthy)}) == 3


@pytest.mark.long
def test_a_flight_that_cannot_start_gives_a_row_with_the_reason():
    high = THREE.replace("aircraft[aircraft-2].start.altitude_m", 15000.0)
    good, bad = fly_many([FlightCase(THREE), FlightCase(high)])
    assert good.met
    assert not bad.met
    assert "aircraft-2" in bad.reason
    assert bad.aircraft == []


def test_a_flight_that_cannot_be_built_gives_a_row_with_the_reason():
    numbers = []
    cases = [FlightCase(ONE.replace("parts.controller", name)) for name in ("nowhere:Law", "elsewhere:Law")]
    rows = fly_many(cases, on_rows=lambda finished, _: numbers.extend(finished))
    assert numbers == [0, 1]
    for row, name in zip(rows, ("nowhere:Law", "elsewhere:Law"), strict=True):
        assert row.reason.startswith(f'parts.controller: arrived "{name}"')
        assert not row.met


@pytest.mark.long
@pytest.mark.parametrize("name", ["uncertain-world", "storm-sampling", "lost-aircraft"])
def test_rows_of_certified_flights_are_the_summaries_of_single_flights(name):
    """Noise: a batch has the same random numbers. Events: the scenarios are flown singly."""
    scenario = anser.load(SCENARIOS / f"{name}.toml")
    row_a, row_b = fly_many([FlightCase(scenario), FlightCase(scenario)])
    flown = anser.run(scenario)
    assert_row_equals_summary(row_a, flown)
    assert_row_equals_summary(row_b, flown)


@pytest.mark.long
def test_each_flight_is_checked_against_its_separation():
    storm = anser.load(SCENARIOS / "storm-sampling.toml")
    narrow, wide = (storm.replace("separation", {"horizontal_m": separation_m}) for separation_m in (300.0, 500.0))
    flight_rows = fly_many([FlightCase(narrow), FlightCase(wide)])
    assert_row_equals_summary(flight_rows[0], anser.run(narrow))
    assert_row_equals_summary(flight_rows[1], anser.run(wide))


@pytest.mark.long
def test_each_flight_is_checked_against_its_keep_outs():
    storm = anser.load(SCENARIOS / "storm-sampling.toml")
    cell = {"name": "cell", "north_m": 3000.0, "east_m": 2500.0, "radius_m": 600.0, "speed_m_s": 3.0}
    near, far = (storm.replace("keep_out", [cell | {"radius_m": radius_m}]) for radius_m in (600.0, 300.0))
    for row, scenario in zip(fly_many([FlightCase(near), FlightCase(far)]), (near, far), strict=True):
        assert_row_equals_summary(row, anser.run(scenario))
        assert all(0.0 <= entry["keep_out_room_min_m"] < 10_000.0 for entry in row.aircraft)


@pytest.mark.long
def test_flights_with_different_numbers_have_different_noise():
    scenario = anser.load(SCENARIOS / "uncertain-world.toml")
    flight_rows = fly_many([FlightCase(scenario, number) for number in range(3)])
    misses = np.array([[entry["miss_m"] for entry in flight_row.aircraft] for flight_row in flight_rows])
    assert np.all(np.ptp(misses, axis=0) > 1e-3)


class Part(eqx.Module):
    absent: None
    number: Any
    table: Any


def test_absent_parts_are_not_counted_among_differing_leaves():
    """Second batch of a group: a leaf that differed once stays batched."""
    group = _FlightGroup()

    def make_parts(*numbers):
        return [Part(None, as_array(number), as_array([1.0, 2.0])) for number in numbers]

    batch_a = group.stacked(make_parts(1.0, 2.0), 2)
    batch_b = group.stacked(make_parts(3.0), 2)
    assert batch_a.shared.table is not None
    assert batch_b.batched.number.tolist() == [3.0, 3.0]
    assert batch_b.batched.absent is None
    assert batch_b.shared.table is not None


def test_a_source_of_random_numbers_is_refused_for_a_singly_flown_scenario():
    source = BlendedRandomness(as_array(np.zeros((1, 2)), np.uint32), as_array([1.0]), as_array(1, np.int32))
    alone = THREE.replace("fleet.planner", "decentralised")
    with pytest.raises(ValueError, match="arrived random numbers of its own; expected 0 and none"):
        fly_many([FlightCase(alone, randomness=source)])


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "every_s"), [("three-aircraft", 0.7), ("uncertain-world", 1.0), ("lost-aircraft", 0.5)]
)
def test_series_equal_the_records_of_single_flights(name, every_s):
    """Includes singly flown scenarios, periods that do not divide a segment, and an absent variable."""
    scenario = anser.load(SCENARIOS / f"{name}.toml").replace("timing.record_period_s", every_s)
    selection = SeriesSelection.from_period(
        scenario, ("north", "east", "course", "phase", "speed_limited", "clock_lag"), every_s
    )
    (flight_row,) = fly_many([FlightCase(scenario)], series=selection)
    flown = anser.run(scenario).dataset
    np.testing.assert_allclose(selection.times_s(scenario), flown["time"].values, atol=1e-9)
    for key in selection.keys[:-1]:
        single = flown[catalogue_variable(key).name].values.T
        scale = 1e4 if key in ("north", "east") else 100.0
        np.testing.assert_allclose(flight_row.series[key], single, rtol=0.0, atol=_SCALE * scale)
    assert flight_row.series["clock_lag"].shape == flight_row.series["north"].shape
    assert np.isnan(flight_row.series["clock_lag"]).all()
