"""Positions of names at line ends: close to the targets, without overlap."""

import numpy as np
import pytest

from anser.report.labels import spread_positions


def test_distant_positions_are_unchanged():
    np.testing.assert_array_equal(spread_positions(np.array([0.1, 0.4, 0.9]), 0.2), [0.1, 0.4, 0.9])


@pytest.mark.parametrize("seed", range(4))
def test_neighbours_keep_the_gap_within_the_range(seed):
    targets = np.sort(np.random.default_rng(seed).beta(0.3, 0.3, 12))
    positions = spread_positions(targets, 0.08)
    assert np.min(np.diff(positions)) > 0.08 - 1e-12
    assert positions[0] >= 0.0
    assert positions[-1] <= 1.0 + 1e-12


def test_equal_positions_are_spread_symmetrically():
    np.testing.assert_allclose(spread_positions(np.full(5, 0.5), 0.1), [0.3, 0.4, 0.5, 0.6, 0.7], atol=1e-15)
    np.testing.assert_allclose(spread_positions(np.zeros(3), 0.1), [0.0, 0.1, 0.2], atol=1e-15)


def test_too_many_positions_exceed_the_range_on_both_sides():
    positions = spread_positions(np.linspace(0.0, 1.0, 11), 0.2)
    assert positions[0] == pytest.approx(-0.5)
    assert positions[-1] == pytest.approx(1.5)
