"""Evaluation of requirements by the worst aircraft, on the right side of the limit."""

import pytest

from anser.results.requirements import REQUIREMENT_NAMES, Requirement, evaluate_requirements

ROW = {
    "arrival_s": 50.0,
    "planned_arrival_s": 50.5,
    "miss_m": 3.0,
    "speed_min_m_s": 120.0,
    "speed_max_m_s": 160.0,
    "clearance_min_m": 290.0,
    "keep_out_room_min_m": 40.0,
    "tables_left_s": 0.0,
    "position_error_max_m": 20.0,
}
WORSE = {
    "arrival_s": 52.0,
    "planned_arrival_s": 50.5,
    "miss_m": 9.0,
    "speed_min_m_s": 110.0,
    "speed_max_m_s": 170.0,
    "clearance_min_m": 160.0,
    "keep_out_room_min_m": 5.0,
    "tables_left_s": 2.0,
    "position_error_max_m": 30.0,
}
FLEET = {"arrival_spread_s": 2.0, "separation_min_m": 500.0, "separation_ratio_min": 1.2}
WORST = {
    "miss_max_m": 9.0,
    "arrival_error_max_s": 1.5,
    "arrival_spread_max_s": 2.0,
    "position_error_max_m": 30.0,
    "speed_max_m_s": 170.0,
    "tables_left_max_s": 2.0,
    "separation_min_m": 500.0,
    "separation_ratio_min": 1.2,
    "keep_out_room_min_m": 5.0,
    "clearance_min_m": 160.0,
    "speed_min_m_s": 110.0,
}


def test_every_requirement_has_a_case():
    assert set(WORST) == set(REQUIREMENT_NAMES)


@pytest.mark.parametrize("name", REQUIREMENT_NAMES)
@pytest.mark.parametrize("offset", [-0.1, 0.0, 0.1])
def test_the_worst_value_is_compared_with_the_limit(name, offset):
    limit = WORST[name] + offset
    # An upper limit has "max" in its name, a lower one "min".
    below = "max" in name
    is_met = offset >= 0.0 if below else offset <= 0.0
    (entry,) = evaluate_requirements([Requirement(name, limit)], [ROW, WORSE], FLEET, [])
    assert entry == {"name": name, "limit": limit, "value": WORST[name], "met": is_met}


@pytest.mark.parametrize("name", ["separation_min_m", "separation_ratio_min"])
def test_the_separation_of_an_aircraft_that_left_counts_and_that_of_a_single_aircraft_does_not(name):
    requirement, close = Requirement(name, 600.0), {**FLEET, "separation_ratio_min": 500.0}
    for fleet in ([ROW, WORSE], [ROW, {**WORSE, "left_s": 30.0}], [{**ROW, "left_s": 30.0}, {**WORSE, "left_s": 30.0}]):
        (entry,) = evaluate_requirements([requirement], fleet, close, [])
        assert (entry["value"], entry["met"]) == (500.0, False)
    (alone,) = evaluate_requirements([requirement], [ROW], {**close, name: None}, [])
    assert (alone["value"], alone["met"]) == (None, True)


def test_each_kind_of_goal_has_the_clearance_with_the_least_margin():
    # 290 of 280 m are a margin of 10, 160 of 100 m one of 60
    same_kind = evaluate_requirements([], [ROW, WORSE], FLEET, [("surface", 290.0, 280.0), ("surface", 160.0, 100.0)])
    assert same_kind == [{"name": "clearance_surface_min_m", "limit": 280.0, "value": 290.0, "met": True}]
    different_kinds = evaluate_requirements(
        [], [ROW, WORSE], FLEET, [("surface", 290.0, 150.0), ("airborne", 160.0, 161.0)]
    )
    assert [(entry["name"], entry["met"]) for entry in different_kinds] == [
        ("clearance_surface_min_m", True),
        ("clearance_airborne_min_m", False),
    ]


def test_a_missing_number_is_not_met():
    (entry,) = evaluate_requirements(
        [Requirement("clearance_min_m", 1.0)], [ROW, WORSE | {"clearance_min_m": None}], FLEET, []
    )
    assert (entry["value"], entry["met"]) == (None, False)
    (entry,) = evaluate_requirements([], [ROW, ROW], FLEET, [("surface", 2.0, 1.0), ("surface", None, 1.0)])
    assert (entry["value"], entry["met"]) == (None, False)


def test_an_unknown_requirement_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"'mis_max_m' is unknown; known are miss_max_m"):
        Requirement("mis_max_m", 1.0)
