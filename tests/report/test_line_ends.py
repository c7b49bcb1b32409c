"""Names at the ends of lines: as near as they can be, never on one another."""

import numpy as np
import pytest

from anser.report.labels import spread_positions


def test_what_is_far_enough_apart_stays():
    np.testing.assert_array_equal(spread_positions(np.array([0.1, 0.4, 0.9]), 0.2), [0.1, 0.4, 0.9])


@pytest.mark.parametrize("seed", range(4))
def test_neighbours_keep_the_gap_and_the_whole_stays_inside(seed):
    wanted = np.sort(np.random.default_rng(seed).beta(0.3, 0.3, 12))
    found = spread_positions(wanted, 0.08)
    assert np.min(np.diff(found)) > 0.08 - 1e-12
    assert found[0] >= 0.0
    assert found[-1] <= 1.0 + 1e-12


def test_equal_ends_are_spread_about_them():
    np.testing.assert_allclose(spread_positions(np.full(5, 0.5), 0.1), [0.3, 0.4, 0.5, 0.6, 0.7], atol=1e-15)
    np.testing.assert_allclose(spread_positions(np.zeros(3), 0.1), [0.0, 0.1, 0.2], atol=1e-15)


def test_too_many_reach_beyond_both_ends():
    found = spread_positions(np.linspace(0.0, 1.0, 11), 0.2)
    assert found[0] == pytest.approx(-0.5)
    assert found[-1] == pytest.approx(1.5)
