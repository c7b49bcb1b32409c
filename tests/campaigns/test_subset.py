"""Subset simulation: known probabilities are in its intervals as often as they say, and brute force agrees."""

import numpy as np
import pytest
from scipy import stats

from anser.campaigns import subset_simulation
from anser.campaigns.subset import Normals, SubsetPlan, estimate, exceedance
from anser.results.sampling_statistics import log_interval, wilson_interval

DIMENSION = 100
PLAN = SubsetPlan(points=200, share=0.1, levels_max=10, repetitions=8)


def linear(points, numbers=None):
    """Standard normal, whatever the dimension."""
    return points.sum(axis=-1) / np.sqrt(points.shape[-1])


def radius(points, numbers=None):
    """Chi-square: neither linear nor near one point."""
    return (points**2).sum(axis=-1)


def farthest(points, numbers=None):
    """Three regions apart, between which no chain goes."""
    return points[..., :3].max(axis=-1)


KNOWN = {
    "linear": (linear, stats.norm.isf),
    "radius": (radius, lambda p: stats.chi2.isf(p, DIMENSION)),
    "farthest": (farthest, lambda p: stats.norm.ppf((1.0 - p) ** (1.0 / 3.0))),
}


def found(name, probability, seed, plan=PLAN, dimension=DIMENSION):
    function, threshold_of = KNOWN[name]
    threshold = float(threshold_of(probability))
    walked = subset_simulation(Normals(dimension, seed), function, threshold, plan, seed)
    return estimate(walked, threshold, 0.95), walked


def in_interval(name, probability, times, dimension=DIMENSION):
    each = [found(name, probability, seed, dimension=dimension)[0] for seed in range(times)]
    return sum(one.low <= probability <= one.high for one in each)


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_probability_is_in_the_interval_as_often_as_it_says(name):
    # of 20 intervals that hold it 95 times of 100 fewer than 17 do in two of 100 tries; the seeds are fixed
    assert in_interval(name, 1e-3, 20) >= 17


@pytest.mark.long
@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("probability", [1e-3, 1e-5, 1e-6])
def test_the_coverage_is_that_of_the_confidence(name, probability):
    # 95 %; four standard deviations of 300 tries are 5 %
    assert in_interval(name, probability, 300) / 300 > 0.90


@pytest.mark.long
def test_a_thousand_dimensions_are_no_harder():
    assert in_interval("linear", 1e-5, 60, dimension=1000) >= 51


@pytest.mark.parametrize(("probability", "points", "fewer"), [(1e-4, 2000, 10), (1e-5, 800, 25)])
def test_it_is_within_the_interval_of_brute_force(probability, points, fewer):
    """Of a million, with so many times fewer points of its own."""
    threshold = float(stats.norm.isf(probability))
    generator = np.random.default_rng(3)
    breached = sum(int(np.sum(linear(generator.standard_normal((10_000, 10))) > threshold)) for _ in range(100))
    low, high = wilson_interval(breached, 1_000_000, 0.95)
    ours, walked = found("linear", probability, 0, SubsetPlan(points, 0.1, 10, 8), 10)
    assert low < ours.probability < high
    assert low < probability < high
    assert ours.low < probability < ours.high
    assert sum(level.values.size for one in walked for level in one) < 1_000_000 / fewer


def test_what_is_not_rare_needs_one_level_and_has_wilsons_interval():
    ours, walked = found("linear", 0.3, 1)
    assert [len(one) for one in walked] == [1] * 8
    count = sum(int(np.sum(one[0].values > stats.norm.isf(0.3))) for one in walked)
    assert (ours.low, ours.high) == wilson_interval(count, 1600, 0.95)
    assert ours.probability == count / 1600


def test_levels_lead_on_and_their_moves_are_accepted_as_asked():
    _, walked = found("linear", 1e-5, 2)
    for one in walked:
        assert len(one) in (4, 5, 6)
        shares = [level.share for level in one[:-1]]
        assert all(0.1 <= share < 0.12 for share in shares)  # more where a chain has stayed at the bound
        bounds = [level.bound for level in one]
        assert bounds[0] == -np.inf
        assert np.all(np.diff(bounds[1:]) > 0.0)
        for level in one:
            assert level.values.size == 200
            assert level.values.min() >= level.bound
            np.testing.assert_array_equal(level.values, linear(level.points))
        # the exceedance is continuous where levels meet
        assert exceedance(one, np.nextafter(bounds[2], -np.inf)) == pytest.approx(shares[0] * shares[1])
    accepted = np.mean([level.acceptance for one in walked for level in one[1:]])
    assert 0.35 < accepted < 0.5


def test_points_of_every_level_are_as_the_condition_says():
    """Beyond a bound a standard normal is a truncated one."""
    _, walked = found("linear", 1e-3, 3, SubsetPlan(2000, 0.1, 10, 3))
    for one in walked:
        ends = [level.values[9::10] for level in one]  # the last of each chain: the least correlated
        for level, values in zip(one[1:], ends[1:], strict=True):
            assert stats.kstest(values, stats.truncnorm(level.bound, np.inf).cdf).pvalue > 1e-3


def test_repetitions_are_independent_and_the_same_seed_is_the_same():
    once, again = found("linear", 1e-3, 4), found("linear", 1e-3, 4)
    assert once[0] == again[0]
    values = [one[0].values for one in once[1]]
    assert not any(np.array_equal(values[0], other) for other in values[1:])
    assert found("linear", 1e-3, 5)[0] != once[0]


def test_infinite_values_and_equal_ones_end_somewhere():
    def stepped(points, numbers):
        """Infinite in one of a thousand, elsewhere one of two values."""
        value = linear(points)
        return np.where(value > stats.norm.isf(1e-3), np.inf, np.where(value > 1.5, 1.0, 0.0))

    walked = subset_simulation(Normals(20, 0), stepped, 2.0, PLAN, 0)
    # no level leads from 1 on to infinity: with equal values nothing says what is nearer
    assert all(len(one) <= 2 for one in walked)
    never = subset_simulation(Normals(20, 0), linear, 40.0, SubsetPlan(100, 0.1, 3, 3), 0)
    assert [len(one) for one in never] == [3] * 3
    assert estimate(never, 40.0, 0.95).probability is None
    with pytest.raises(ValueError, match="NaN from the limit state"):
        subset_simulation(Normals(20, 0), lambda points, numbers: np.full(len(points), np.nan), 2.0, PLAN, 0)


def test_the_interval_of_logarithms_needs_two():
    middle, low, high = log_interval(np.array([1e-4, 1e-6]))
    assert middle == pytest.approx(1e-5)
    assert low * high == pytest.approx(1e-10)
    for few in ([1e-4], [1e-4, 0.0]):
        with pytest.raises(ValueError, match="expected two positive numbers"):
            log_interval(np.array(few))
