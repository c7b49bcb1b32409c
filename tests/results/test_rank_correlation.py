"""Rank correlation: equal to scipy's, with an interval, also for infinite outputs."""

import numpy as np
import pytest
from scipy import stats

from anser.results.sampling_statistics import rank_correlation


def test_the_correlation_is_spearmans_with_infinite_as_greatest():
    rng = np.random.default_rng(1)
    x = rng.normal(size=200)
    y = x + rng.normal(size=200)
    correlation, low, high = rank_correlation(x, y)
    assert correlation == pytest.approx(stats.spearmanr(x, y).statistic, rel=1e-12)
    assert low < correlation < high
    infinite_outputs = np.where(y == y.max(), np.inf, y)
    assert rank_correlation(x, infinite_outputs)[0] == correlation


def test_the_interval_has_the_nominal_coverage():
    rng, covered, cases = np.random.default_rng(2), 0, 400
    truth = 6.0 / np.pi * np.arcsin(0.6 / 2.0)  # of normal numbers with the correlation 0.6
    for _ in range(cases):
        x = rng.normal(size=60)
        y = 0.6 * x + 0.8 * rng.normal(size=60)
        _, low, high = rank_correlation(x, y, 0.9)
        covered += low <= truth <= high
    # three standard deviations of a binomial share, and one part in a hundred for the approximation
    assert covered / cases == pytest.approx(0.9, abs=3.0 * np.sqrt(0.09 / cases) + 0.01)


def test_a_perfect_order_has_an_interval():
    correlation, low, high = rank_correlation(np.arange(20.0), np.exp(np.arange(20.0)))
    assert correlation == 1.0
    assert 0.9 < low <= high <= 1.0


@pytest.mark.parametrize(
    ("x", "y", "said"),
    [
        (np.arange(3.0), np.arange(3.0), "3 pairs"),
        (np.ones(9), np.arange(9.0), "all alike"),
        (np.arange(9.0), np.array([*range(8), np.nan]), "NaN"),
    ],
)
def test_inputs_without_ranks_are_refused(x, y, said):
    with pytest.raises(ValueError, match=said):
        rank_correlation(x, y)
