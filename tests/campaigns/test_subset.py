"""Subset simulation: coverage of known probabilities, and agreement with brute force."""

import numpy as np
import pytest
from scipy import stats

from anser.campaigns import subset_simulation
from anser.campaigns.subset import SubsetPlan, estimate, exceedance
from anser.results.sampling_statistics import log_interval, wilson_interval

DIMENSION = 100
PLAN = SubsetPlan(points=200, share=0.1, levels_max=10, repetitions=8)


class Normals:
    """Points as plain arrays of standard normal numbers from NumPy's generator."""

    def __init__(self, dimension, seed):
        self.dimension, self.seed = dimension, seed

    def sample(self, numbers):
        generator = np.random.default_rng([self.seed, int(numbers[0])])
        return generator.standard_normal((numbers.size, self.dimension))

    def propose(self, points, keep, numbers):
        part = keep[:, None]
        return part * points + np.sqrt(1.0 - part**2) * self.sample(numbers)


def linear(points, numbers=None):
    """Standard normal, whatever the dimension."""
    return points.sum(axis=-1) / np.sqrt(points.shape[-1])


def radius(points, numbers=None):
    """Chi-square: nonlinear, with the failure region on a sphere."""
    return (points**2).sum(axis=-1)


def farthest(points, numbers=None):
    """Three separate failure regions that no chain connects."""
    return points[..., :3].max(axis=-1)


KNOWN = {
    "linear": (linear, stats.norm.isf),
    "radius": (radius, lambda p: stats.chi2.isf(p, DIMENSION)),
    "farthest": (farthest, lambda p: stats.norm.ppf((1.0 - p) ** (1.0 / 3.0))),
}


def simulated(name, probability, seed, plan=PLAN, dimension=DIMENSION):
    function, threshold_of = KNOWN[name]
    threshold = float(threshold_of(probability))
    walked = subset_simulation(Normals(dimension, seed), function, threshold, plan, seed)
    return estimate(walked, threshold, 0.95), walked


def in_interval(name, probability, times, dimension=DIMENSION):
    estimates = [simulated(name, probability, seed, dimension=dimension)[0] for seed in range(times)]
    return sum(interval.low <= probability <= interval.high for interval in estimates)


@pytest.mark.parametrize("name", KNOWN)
def test_intervals_contain_known_probabilities_with_the_stated_frequency(name):
    # of 20 intervals that hold it 95 times of 100 fewer than 17 do in two of 100 tries; the seeds are fixed
    assert in_interval(name, 1e-3, 20) >= 17


@pytest.mark.long
@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("probability", [1e-3, 1e-5, 1e-6])
def test_the_coverage_is_that_of_the_confidence(name, probability):
    # 95 %; four standard deviations of 300 tries are 5 %
    assert in_interval(name, probability, 300) / 300 > 0.90


@pytest.mark.long
def test_a_thousand_dimensions_give_the_same_coverage():
    assert in_interval("linear", 1e-5, 60, dimension=1000) >= 51


@pytest.mark.parametrize(("probability", "points", "fewer"), [(1e-4, 2000, 10), (1e-5, 800, 25)])
def test_the_estimate_agrees_with_brute_force(probability, points, fewer):
    """Brute force with a million points; subset simulation with a fraction."""
    threshold = float(stats.norm.isf(probability))
    generator = np.random.default_rng(3)
    breached = sum(int(np.sum(linear(generator.standard_normal((10_000, 10))) > threshold)) for _ in range(100))
    low, high = wilson_interval(breached, 1_000_000, 0.95)
    ours, walked = simulated("linear", probability, 0, SubsetPlan(points, 0.1, 10, 8), 10)
    assert low < ours.probability < high
    assert low < probability < high
    assert ours.low < probability < ours.high
    assert sum(level.values.size for repetition in walked for level in repetition) < 1_000_000 / fewer


def test_a_frequent_event_needs_one_level_with_wilsons_interval():
    ours, walked = simulated("linear", 0.3, 1)
    assert [len(repetition) for repetition in walked] == [1] * 8
    count = sum(int(np.sum(repetition[0].values > stats.norm.isf(0.3))) for repetition in walked)
    assert (ours.low, ours.high) == wilson_interval(count, 1600, 0.95)
    assert ours.probability == count / 1600


def test_levels_increase_with_the_target_acceptance():
    _, walked = simulated("linear", 1e-5, 2)
    for repetition in walked:
        assert len(repetition) in (4, 5, 6)
        shares = [level.share for level in repetition[:-1]]
        assert all(0.1 <= share < 0.12 for share in shares)  # more where a chain has stayed at the bound
        bounds = [level.bound for level in repetition]
        assert bounds[0] == -np.inf
        assert np.all(np.diff(bounds[1:]) > 0.0)
        for level in repetition:
            assert level.values.size == 200
            assert level.values.min() >= level.bound
            np.testing.assert_array_equal(level.values, linear(level.points))
        # the exceedance is continuous where levels meet
        assert exceedance(repetition, np.nextafter(bounds[2], -np.inf)) == pytest.approx(shares[0] * shares[1])
    accepted = np.mean([level.acceptance for repetition in walked for level in repetition[1:]])
    assert 0.35 < accepted < 0.5


def test_points_of_every_level_have_the_conditional_distribution():
    """The points above a bound have a truncated normal distribution."""
    _, walked = simulated("linear", 1e-3, 3, SubsetPlan(2000, 0.1, 10, 3))
    for repetition in walked:
        bounds = [level.values[9::10] for level in repetition]  # the last of each chain: the least correlated
        for level, values in zip(repetition[1:], bounds[1:], strict=True):
            assert stats.kstest(values, stats.truncnorm(level.bound, np.inf).cdf).pvalue > 1e-3


def test_repetitions_are_independent_and_reproducible():
    once, repeated = simulated("linear", 1e-3, 4), simulated("linear", 1e-3, 4)
    assert once[0] == repeated[0]
    values = [level[0].values for level in once[1]]
    assert not any(np.array_equal(values[0], level_values) for level_values in values[1:])
    assert simulated("linear", 1e-3, 5)[0] != once[0]


def test_infinite_and_equal_values_terminate():
    def stepped(points, numbers):
        """Infinite with probability 1e-3, otherwise 0 or 1."""
        value = linear(points)
        return np.where(value > stats.norm.isf(1e-3), np.inf, np.where(value > 1.5, 1.0, 0.0))

    walked = subset_simulation(Normals(20, 0), stepped, 2.0, PLAN, 0)
    # no level leads from 1 on to infinity: with equal values nothing says what is nearer
    assert all(len(repetition) <= 2 for repetition in walked)
    never = subset_simulation(Normals(20, 0), linear, 40.0, SubsetPlan(100, 0.1, 3, 3), 0)
    assert [len(repetition) for repetition in never] == [3] * 3
    assert estimate(never, 40.0, 0.95).probability is None
    with pytest.raises(ValueError, match="NaN from the limit state"):
        subset_simulation(Normals(20, 0), lambda points, numbers: np.full(len(points), np.nan), 2.0, PLAN, 0)


def test_the_interval_of_logarithms_needs_two_values():
    middle, low, high = log_interval(np.array([1e-4, 1e-6]))
    assert middle == pytest.approx(1e-5)
    assert low * high == pytest.approx(1e-10)
    for single in ([1e-4], [1e-4, 0.0]):
        with pytest.raises(ValueError, match="expected two positive numbers"):
            log_interval(np.array(single))
