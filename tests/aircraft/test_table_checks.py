"""The search for suspect table entries: known suspects of TP-1538, planted outliers, and smooth tables."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import suspect_points
from anser.aircraft.table_checks import GriddedTable, _last_digit
from support.tp1538_build_up import AXES, DATA, TABLES

TP1538 = {
    name: GriddedTable(tuple(AXES[axis] for axis in table["axes"]), TABLES[name])
    for name, table in DATA["tables"].items()
}
LISTED = [(name, *(x for x in place if x is not None)) for name, *place in DATA["suspect"]["points"]]


@pytest.fixture(scope="module")
def found():
    return suspect_points(TP1538)


@pytest.mark.parametrize("point", LISTED, ids=str)
def test_the_search_finds_every_known_suspect(found, point):
    name, *location = point
    assert any(
        suspect.table == name and tuple(location) in (suspect.location, *suspect.neighbours) for suspect in found
    )


def test_the_search_finds_at_most_twice_the_known_suspects(found):
    """Cz at 70 deg is one suspect with several points; 13 points are listed."""
    assert len(LISTED) == 13
    assert len(found) <= 2 * len(LISTED)
    assert [suspect.score for suspect in found] == sorted((suspect.score for suspect in found), reverse=True)


def test_the_worst_suspect_is_the_misprint_of_the_flap_table(found):
    assert found[0][:3] == ("Cm_lef", (25.0, -6.0), -0.1607)


def smooth(alphas, betas, phase=0.0):
    a, b = np.meshgrid(alphas, betas, indexing="ij")
    return np.round(np.sin(a / 25 + phase) * np.cos(b / 20) + 0.002 * a, 4)


@settings(deadline=None, max_examples=30)
@given(row=st.integers(1, 18), column=st.integers(1, 17), size=st.sampled_from([-0.6, 0.6]))
def test_the_search_finds_a_planted_outlier(row, column, size):
    values = smooth(AXES["alpha1"], AXES["beta1"])
    values[row, column] += size
    axes = (AXES["alpha1"], AXES["beta1"])
    worst = suspect_points({"C": GriddedTable(axes, values)})[0]
    assert worst.location == (axes[0][row], axes[1][column])


@pytest.mark.parametrize("decimals", [7, 16])
def test_the_search_finds_an_outlier_among_very_small_values(decimals):
    """Derivatives per degree, of the size of 1e-5."""
    axes = AXES["alpha1"], AXES["beta1"]
    values = 1e-5 * smooth(*axes)
    values[7, 5] += 6e-6
    worst = suspect_points({"C": GriddedTable(axes, np.round(values, decimals))})[0]
    assert worst.location == (axes[0][7], axes[1][5])


@pytest.mark.parametrize(("unit", "expected"), [(1e-3, 1e-3), (1e-5, 1e-5), (1e-8, 1e-8), (1e-10, 0.0), (np.pi, 0.0)])
def test_the_last_digit_is_that_of_the_printed_values(unit, expected):
    values = np.random.default_rng(1).integers(-400, 400, 60) * unit
    assert _last_digit(values) == pytest.approx(expected, rel=1e-12)


def test_smooth_and_short_tables_have_no_suspects():
    axes = (AXES["alpha1"], AXES["beta1"])
    tables = {
        "C": GriddedTable(axes, smooth(*axes)),
        "line": GriddedTable(axes[:1], np.arange(20.0)),
        "small": GriddedTable((np.arange(2.0), np.arange(2.0)), np.eye(2)),
        "flat": GriddedTable(axes, np.zeros((20, 19))),
    }
    assert suspect_points(tables) == ()


def test_a_suspect_common_to_most_tables_is_reported_once():
    axes = (AXES["alpha1"], AXES["beta1"])
    tables = {}
    for k in range(6):
        values = smooth(*axes, phase=0.3 * k)
        values[10, 4] += 0.5
        tables[f"C{k}"] = GriddedTable(axes, values)
    together = [suspect for suspect in suspect_points(tables) if suspect.table == "all"]
    assert [suspect.location for suspect in together] == [(axes[0][10], axes[1][4])]
