"""Separation and keep-outs of a scenario: refusals, accepted cases, and the geometry of both."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.scenario.schema_airspace import KeepOut, Separation
from support.certified_scenario import (
    CELL,
    WHO_A,
    WHO_B,
    and_cell,
    check_allowed,
    check_refusal,
)

# changes of the good scenario, then: path, whom, what arrived (a part), what would be right (a part)
CASES = {
    "altitude alone": (
        [("horizontal_m = 500\n", "")],
        ("separation.vertical_m", "", "150 without horizontal_m", "horizontal_m above 0 beside it"),
    ),
    "separation out of range": (
        [("vertical_m = 150", "vertical_m = 5001")],
        ("separation.vertical_m", "", "5001", "a number from 0 to 5000 m"),
    ),
    "reserve below zero": (
        [("vertical_m = 150", "reserve_m = -1")],
        ("separation.reserve_m", "", "-1", "a number from 0 to 1000 m"),
    ),
    "starts too close": (
        [("north_m = -8000, east_m = 100, altitude_m = 1500", "north_m = 9300, east_m = 399.99, altitude_m = 1149.9")],
        (
            "aircraft[1].start",
            WHO_B,
            'a start 499.9 m in the plane and 149.9 m in altitude from aircraft[0] "alpha"',
            "a start 500 m away in the plane or 150 m in altitude",
        ),
    ),
    "starts one above the other where altitude does not count": (
        [
            ("vertical_m = 150\n", ""),
            ("north_m = -8000, east_m = 100, altitude_m = 1500", "north_m = 9000, east_m = 300, altitude_m = 5000"),
        ],
        ("aircraft[1].start", WHO_B, "300.0 m in the plane and 4000.0 m", "a start 500 m away in the plane, as"),
    ),
    "keep-out as a table": (
        [("[[goal]]", f"{CELL.replace('[[keep_out]]', '[keep_out]')}[[goal]]")],
        ("keep_out", "", "a table", "tables [[keep_out]], in double brackets"),
    ),
    "keep-out without a radius": (
        and_cell("radius_m = 1000\n", ""),
        ("keep_out[0].radius_m", 'keep_out "cell"', "nothing", "a number from 10 to 200000 m"),
    ),
    "keep-out with a key of a goal": (
        and_cell("radius_m = 1000", "radius_m = 1000\naltitude_m = 0"),
        ("keep_out[0].altitude_m", 'keep_out "cell"', "unknown key", "one of the keys name, north_m"),
    ),
    "keep-out upside down": (
        and_cell("radius_m = 1000", "radius_m = 1000\nbottom_m = 900\ntop_m = 900"),
        ("keep_out[0].bottom_m", 'keep_out "cell"', "900", "less than top_m, which is 900 m"),
    ),
    "keep-out named twice": (
        [*and_cell(), *and_cell()],
        ("keep_out[1].name", 'keep_out "cell"', '"cell", already the name of keep_out[0]', "a name of its own"),
    ),
    "start inside a keep-out": (
        and_cell("north_m = 4000\neast_m = 4000", "north_m = 8500\neast_m = 800"),
        (
            "aircraft[0].start",
            WHO_A,
            'a start inside keep_out[0] "cell"',
            "a start at least 1000 m from its middle, below 0 m or above 15240 m",
        ),
    ),
    "rendezvous inside a keep-out that stands": (
        and_cell("north_m = 4000\neast_m = 4000", "north_m = 0\neast_m = 2500\nbottom_m = 200\ntop_m = 301"),
        (
            "aircraft[1].rendezvous",
            WHO_B,
            'inside keep_out[0] "cell", which moves as goal "buoy" does',
            "a rendezvous point at least 1000 m from its middle, below 200 m or above 301 m",
        ),
    ),
    "rendezvous inside a keep-out that goes along": (
        and_cell("north_m = 4000\neast_m = 4000", "north_m = 0\neast_m = 0\nspeed_m_s = 8\ncourse_deg = 60"),
        ("aircraft[0].rendezvous", WHO_A, 'which moves as goal "ship" does', "at least 1000 m from its middle"),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_refusal_names_the_key_its_value_and_the_expected_value(case: str) -> None:
    changes, problem = CASES[case]
    check_refusal(changes, *problem)


ALLOWED = {
    "starts just far enough apart": [
        ("north_m = -8000, east_m = 100, altitude_m = 1500", "north_m = 9300, east_m = 400, altitude_m = 1000")
    ],
    "starts just high enough apart": [
        ("north_m = -8000, east_m = 100, altitude_m = 1500", "north_m = 9000, east_m = 0, altitude_m = 1150")
    ],
    "keep-out": and_cell(),
    "start on the side of a keep-out": and_cell("north_m = 4000\neast_m = 4000", "north_m = 9000\neast_m = 1000"),
    "start under a keep-out": and_cell("north_m = 4000\neast_m = 4000", "north_m = 9000\neast_m = 0\nbottom_m = 1000"),
    "keep-out that passes over a buoy": and_cell(
        "north_m = 4000\neast_m = 4000", "north_m = 300\neast_m = 2500\nspeed_m_s = 20"
    ),
}


@pytest.mark.parametrize("case", ALLOWED)
def test_an_accepted_scenario_loads_again_from_its_record(case: str) -> None:
    check_allowed(ALLOWED[case])


positions = st.tuples(st.floats(-3e3, 3e3), st.floats(-3e3, 3e3), st.floats(0.0, 3e3))


@given(positions, positions, st.floats(1.0, 3e3), st.floats(0.0, 2e3))
@settings(deadline=None, max_examples=60)
def test_separation_is_that_of_a_cylinder(position_a, position_b, horizontal_m: float, vertical_m: float) -> None:
    """Separation is symmetric: outside an upright cylinder, of infinite height without vertical_m."""
    separation = Separation(horizontal_m=horizontal_m, vertical_m=vertical_m)
    is_separated = separation.is_satisfied(position_a, position_b)
    assert separation.is_satisfied(position_b, position_a) is is_separated
    in_plane = (position_a[0] - position_b[0]) ** 2 + (position_a[1] - position_b[1]) ** 2 < horizontal_m**2
    in_height = vertical_m == 0.0 or abs(position_a[2] - position_b[2]) < vertical_m
    assert is_separated is not (in_plane and in_height)


def test_a_keep_out_holds_its_inside_and_not_its_surface() -> None:
    cell = KeepOut(name="cell", north_m=100.0, east_m=-50.0, radius_m=500.0, bottom_m=1000.0, top_m=2000.0)
    inside = [(100.0 + n, -50.0 + e, up) for n, e, up in itertools.product((0, 299), (0, -399), (1000.1, 1999.9))]
    assert all(cell.contains(at) for at in inside)
    outside = [(400.0, -450.0, 1500.0), (100.0, -50.0, 1000.0), (100.0, -50.0, 2000.0), (601.0, -50.0, 1500.0)]
    assert not any(cell.contains(at) for at in outside)
