"""Coverage of confidence intervals over artificial campaigns with known distributions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from anser.results.sampling_statistics import order_statistic_interval, quantile, wilson_interval

CAMPAIGNS, FLIGHTS = 4000, 300


def test_wilson_intervals_have_the_nominal_coverage():
    probability = 0.93
    success_counts = np.random.default_rng(1).binomial(FLIGHTS, probability, CAMPAIGNS)
    bounds = np.array([wilson_interval(int(successes), FLIGHTS) for successes in success_counts])
    covered = np.mean((bounds[:, 0] <= probability) & (probability <= bounds[:, 1]))
    assert 0.94 <= covered <= 0.96


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_order_statistics_have_at_least_the_nominal_coverage(share):
    rng = np.random.default_rng(2)
    bounds = [order_statistic_interval(rng.exponential(size=FLIGHTS), share) for _ in range(CAMPAIGNS)]
    low, high = np.array(bounds).T
    truth = stats.expon.ppf(share)
    # at least 95 %; four standard deviations of 4,000 campaigns are 1.4 %, of the whole 0.7 % below
    assert np.mean((low <= truth) & (truth <= high)) >= 0.943


def test_failures_count_as_the_worst():
    values = np.r_[np.arange(95.0), np.full(5, np.inf)]
    assert quantile(values, 0.95) == 94.0
    assert quantile(values, 0.96) == np.inf
    assert quantile(np.arange(1.0, 101.0), 0.55) == 55.0  # 0.55 x 100 is a little more than 55 in floating point
    low, high = order_statistic_interval(values, 0.95)
    assert low < 94.0
    assert high == np.inf


@given(values=arrays(float, st.integers(1, 60), elements=st.floats(-1e6, 1e6)), share=st.floats(0.01, 0.99))
def test_an_interval_contains_its_quantile_and_widens_with_the_confidence(values, share):
    low, high = order_statistic_interval(values, share, 0.9)
    wider_low, wider_high = order_statistic_interval(values, share, 0.99)
    assert low <= quantile(values, share) <= high
    assert wider_low <= low
    assert high <= wider_high


def test_invalid_samples_are_refused():
    with pytest.raises(ValueError, match="arrived NaN"):
        order_statistic_interval(np.array([1.0, np.nan]), 0.5)
    with pytest.raises(ValueError, match="arrived 3 successes of 2 flights"):
        wilson_interval(3, 2)
