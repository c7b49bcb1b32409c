"""Margins: their ranking, whose they are and when, what a derived variable says."""

import copy
import json

import numpy as np
import pytest

from anser.report.derived_variables import HOLD, add_derived_variables, recorded_scenario
from anser.report.flight_margins import Margin, closest_pair, find_flight_margins
from anser.report.flight_overview import aircraft_table, margins_list
from anser.results.separation import nearest_aircraft_distance


@pytest.mark.parametrize(
    ("limit", "value", "is_upper", "utilization"),
    [
        (70.0, 63.0, True, 0.9),
        (90.0, 180.0, False, 0.5),
        (90.0, 45.0, False, 2.0),
        (-1.0, 0.9, False, 0.0),
        (-1.0, -0.5, False, 0.5),
        (5.0, -2.0, True, 0.0),
        (-3.0, -6.0, True, 0.5),
        (90.0, 0.0, False, np.inf),
        (0.0, 3.0, False, 0.0),
        (1.0, None, True, None),
    ],
)
def test_the_part_used_is_1_at_the_limit(limit, value, is_upper, utilization):
    met = value is not None and (value <= limit if is_upper else value >= limit)
    assert Margin("", "limit", "", limit, value, is_upper, met).utilization == (
        None if utilization is None else pytest.approx(utilization)
    )
    assert Margin("", "limit", "", limit, limit, is_upper, True).utilization == (pytest.approx(1.0) if limit else 0.0)


@pytest.fixture(scope="module")
def whole(flight):
    return add_derived_variables(flight[0], recorded_scenario(flight[0]))


def test_the_tightest_comes_first_and_what_was_not_met_before_all(flight, whole):
    summary = copy.deepcopy(flight[1])
    used = [margin.utilization for margin in find_flight_margins(whole, summary)]
    assert used == sorted(used, reverse=True)
    summary["requirements"][0] |= {"value": None, "met": False}
    first, *rest = find_flight_margins(whole, summary)
    assert (first.description, first.utilization, first.is_met) == ("Miss of the rendezvous", None, False)
    assert all(margin.is_met for margin in rest)


def test_a_limit_names_the_aircraft_and_the_instant_of_the_worst(flight, whole):
    margins = {margin.description: margin for margin in find_flight_margins(whole, flight[1])}
    bank = flight[0]["bank_deg"]
    right = margins["Bank angle to the right"]
    assert right.value == float(bank.max())
    assert float(bank.sel(time=right.time_s, aircraft=right.aircraft)) == right.value
    left = margins["Bank angle to the left"]
    assert left.value == -float(bank.min())
    assert margins["Lowest altitude"].value == float(flight[0]["altitude_m"].min())
    assert not margins["Lowest altitude"].is_upper


def test_each_aircraft_is_judged_by_its_own_limits(flight, whole):
    banks = np.abs(whole["bank_deg"].values).max(axis=0)
    own = [{"bank_max_deg": 4.0 * bank} for bank in banks.tolist()]
    own[0]["bank_max_deg"] = 1.25 * float(banks[0])
    changed = whole.assign_attrs(limits=json.dumps(own))
    margins = [
        one
        for one in find_flight_margins(changed, flight[1])
        if one.description.startswith("Bank angle") and one.value > 0.0
    ]
    tightest = max(margins, key=lambda one: one.utilization)
    assert (tightest.aircraft, tightest.utilization) == (str(whole["aircraft"].values[0]), pytest.approx(0.8))
    assert all(margin.limit in [one["bank_max_deg"] for one in own] for margin in margins)


def test_a_limit_passed_only_in_the_hold_is_told_apart(flight, whole):
    arrival = flight[1]["aircraft"][0]["arrival_s"]

    def shown(*times):
        changed = whole.copy(deep=True)
        for time, bank in times:
            changed["bank_deg"].loc[{"time": changed["time"].sel(time=time, method="nearest"), "aircraft": "anna"}] = (
                bank
            )
        first, *rest = find_flight_margins(changed, flight[1])
        assert all(margin.is_met for margin in rest)
        return first, margins_list([first])

    later, html = shown((arrival + 5.0, 71.0))
    assert (later.description, later.aircraft, later.is_met, later.after_arrival) == (
        "Bank angle to the right",
        "anna",
        False,
        True,
    )
    assert '<li class="near">' in html
    assert "passed after the arrival" in html
    assert "not met" not in html
    # the worst lies in the hold, yet it was passed on the way too
    early, html = shown((arrival + 5.0, 75.0), (arrival - 5.0, 71.0))
    assert (early.value, early.after_arrival) == (75.0, False)
    assert '<li class="over">' in html
    assert "not met" in html


def test_how_a_path_goes_stands_in_the_table_where_the_summary_says_it(flight):
    rows = flight[1]["aircraft"]
    table = aircraft_table(rows)
    assert "Path</th>" in table
    assert table.count("bent right") == 1
    assert "turns 83 deg" in aircraft_table([rows[0] | {"path": "turns 83 deg"}])
    older = aircraft_table([{key: value for key, value in row.items() if key != "path"} for row in rows])
    assert "Path</th>" not in older
    assert older.count("<td") == table.count("<td") - len(rows)


def test_the_nearest_other_aircraft_is_found_for_each(flight):
    dataset = flight[0].isel(time=slice(None, None, 400))
    places = np.stack([dataset[name].values for name in ("north_m", "east_m", "altitude_m")], axis=-1)
    nearest = nearest_aircraft_distance(places)
    for row in range(nearest.shape[0]):
        for k in range(3):
            others = [np.linalg.norm(places[row, k] - places[row, j]) for j in range(3) if j != k]
            assert nearest[row, k] == pytest.approx(min(others), rel=1e-12)
    assert np.isnan(nearest_aircraft_distance(places[:, [0]])).all()


def test_the_least_distance_names_the_two(flight, whole):
    least, when, one, other = closest_pair(whole)
    assert least == pytest.approx(flight[1]["fleet"]["separation_min_m"], rel=1e-3)
    then = whole.sel(time=when)
    away = [
        float(then[name].sel(aircraft=one) - then[name].sel(aircraft=other))
        for name in ("north_m", "east_m", "altitude_m")
    ]
    assert np.linalg.norm(away) == pytest.approx(least, rel=1e-12)


def test_separation_counts_until_the_first_of_two_arrives(flight):
    dataset = flight[0].copy(deep=True)
    dataset["phase"].values[1000:, 1] = HOLD
    kept = add_derived_variables(dataset, {"separation": {"horizontal_m": 500.0, "vertical_m": 150.0}})[
        "separation_kept"
    ].values
    assert np.isnan(kept[1000:, 1]).all()
    row = dataset.isel(time=1500, aircraft=[0, 2])
    flat = np.hypot(np.ptp(row["north_m"].values), np.ptp(row["east_m"].values)) / 500.0
    tall = np.ptp(row["altitude_m"].values) / 150.0
    # aircraft 1 has arrived: the other two have only one another
    np.testing.assert_allclose(kept[1500, [0, 2]], max(flat, tall), rtol=1e-12)


def test_errors_are_along_and_across_the_plan(flight, whole):
    together = np.sqrt(whole["along_error_m"] ** 2 + whole["across_error_m"] ** 2 + whole["height_error_m"] ** 2)
    away = np.sqrt(
        sum((flight[0][name] - flight[0][f"reference_{name}"]) ** 2 for name in ("north_m", "east_m", "altitude_m"))
    )
    flying = flight[0]["phase"].values != HOLD
    np.testing.assert_allclose(together.values[flying], away.values[flying], atol=1e-9)
    assert np.isnan(together.values[~flying]).all()
    # north of a path that goes west is right of it
    shifted = flight[0].copy(deep=True)
    shifted["north_m"] = shifted["reference_north_m"] + 5.0
    shifted["east_m"] = shifted["reference_east_m"]
    anna = add_derived_variables(shifted, {}).isel(aircraft=0, time=400)
    assert float(anna["across_error_m"]) == pytest.approx(5.0, rel=0.05)


def test_without_a_scenario_there_are_the_requirements_alone(flight):
    dataset = flight[0].assign_attrs(scenario="no JSON")
    assert recorded_scenario(dataset) == {}
    whole = add_derived_variables(dataset, {})
    assert {margin.kind for margin in find_flight_margins(whole, flight[1])} == {"requirement"}
    assert "height_over_floor_m" not in whole
    assert "separation_kept" not in whole
