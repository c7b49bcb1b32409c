"""Agreement of comparisons and outcomes."""

import math
from dataclasses import replace

import pytest

from anser.verification import Check
from anser.verification.checks import Comparison, Outcome

GOOD = Comparison("alpha", "V 300 ft/s", "deg", 8.49, 8.4926, 0.005)
CHECK = Check("key", "title", "[SL]", "half the last digit", "Nothing to add.", lambda: (GOOD,))


def test_an_error_within_the_tolerance_passes():
    assert GOOD.error == pytest.approx(0.0026)
    assert GOOD.passes
    assert GOOD.severity == pytest.approx(0.52)


@pytest.mark.parametrize("obtained", [8.4951, 8.4849, -8.49, 0.0])
def test_an_error_beyond_the_tolerance_fails(obtained):
    wrong = replace(GOOD, obtained=obtained)
    assert not wrong.passes
    assert wrong.severity > 1.0


def test_an_error_equal_to_the_tolerance_passes():
    edge = Comparison("x", "", "", 1.0, 1.5, 0.5)
    assert edge.passes
    assert edge.severity == 1.0
    exact = Comparison("x", "", "", 1.0, 1.0, 0.0)
    assert exact.passes
    assert exact.severity == 0.0
    different = replace(exact, obtained=1.0 + 1e-15)
    assert not different.passes
    assert different.severity == math.inf


@pytest.mark.parametrize("obtained", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("published", [True, False])
def test_a_figure_that_is_not_finite_fails_and_is_worst(obtained, published):
    expected_and_tolerance = (1.0, 1e300) if published else (None, None)
    broken = Comparison("x", "", "", expected_and_tolerance[0], obtained, expected_and_tolerance[1])
    assert not broken.passes
    assert broken.severity == math.inf


def test_a_comparison_without_published_figure_neither_passes_nor_fails():
    listed = Comparison("x", "t 30 s", "ft", None, 123.0, None)
    assert not listed.judged
    assert not listed.passes
    assert not listed.fails
    assert listed.error is None
    assert listed.severity == 0.0


@pytest.mark.parametrize(
    ("expected", "tolerance"),
    [(1.0, None), (None, 1.0), (1.0, -0.1), (1.0, math.nan), (1.0, math.inf), (math.nan, 1.0), (math.inf, 1.0)],
)
def test_a_figure_without_a_usable_tolerance_is_refused(expected, tolerance):
    with pytest.raises(ValueError, match="alpha, V 300"):
        Comparison("alpha", "V 300 ft/s", "deg", expected, 1.0, tolerance)


def test_an_outcome_passes_only_if_every_comparison_agrees():
    wrong = replace(GOOD, obtained=9.0)
    assert Outcome(CHECK, (GOOD, GOOD), 0.1).passes
    assert not Outcome(CHECK, (GOOD, wrong), 0.1).passes
    assert not Outcome(CHECK, (), 0.1).passes
    assert not Outcome(CHECK, (GOOD,), 0.1, "ValueError: no").passes
