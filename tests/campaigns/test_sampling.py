"""Samples: independent of the number of flights, evenly distributed or correlated as configured."""

import numpy as np
import pytest
from scipy import stats

from anser.campaigns.sampling import flight_seeds, is_independent, sample_study
from campaigns.study_cases import WIND, study_of

COURSE = {"path": "wind.from_deg", "distribution": "normal", "mean": 10.0, "sigma": 5.0}


def values_of(method, flights, **changes):
    return sample_study(study_of(sampling={"method": method, "flights": flights}, vary=[WIND, COURSE], **changes), {})


def test_additional_flights_leave_the_first_unchanged():
    ten, thousand = values_of("monte-carlo", 10), values_of("monte-carlo", 1000)
    for path in ten:
        np.testing.assert_array_equal(ten[path], thousand[path][:10])
    assert np.any(ten["wind.speed_m_s"] != values_of("monte-carlo", 10, seed=2)["wind.speed_m_s"])


@pytest.mark.parametrize(("method", "flights"), [("monte-carlo", 4000), ("latin-hypercube", 4000), ("sobol", 4096)])
def test_samples_have_their_distributions_and_are_independent(method, flights):
    samples = values_of(method, flights)
    assert stats.kstest(samples["wind.speed_m_s"], stats.uniform(0.0, 9.0).cdf).pvalue > 1e-3
    assert stats.kstest(samples["wind.from_deg"], stats.norm(10.0, 5.0).cdf).pvalue > 1e-3
    # of independent ones four standard deviations are passed once in 16,000
    assert abs(stats.spearmanr(samples["wind.speed_m_s"], samples["wind.from_deg"])[0]) < 4.0 / np.sqrt(flights)


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_even_samples_have_one_value_in_each_interval(method):
    samples = np.sort(values_of(method, 64)["wind.speed_m_s"]) / 9.0
    assert np.array_equal(np.floor(64 * samples), np.arange(64))


def test_groups_have_the_configured_correlation():
    group = {"paths": ["wind.speed_m_s", "wind.from_deg"], "coefficients": [[1.0, 0.8], [0.8, 1.0]]}
    samples = values_of("monte-carlo", 4000, correlated=[group])
    normals = stats.norm.ppf(samples["wind.speed_m_s"] / 9.0), (samples["wind.from_deg"] - 10.0) / 5.0
    # standard deviation of the estimate: (1 - 0.8^2) / sqrt(4000) = 0.0057
    assert np.corrcoef(*normals)[0, 1] == pytest.approx(0.8, abs=0.023)
    assert stats.kstest(samples["wind.speed_m_s"], stats.uniform(0.0, 9.0).cdf).pvalue > 1e-3


def test_a_grid_has_every_combination():
    choice = {"path": "fleet.planner", "distribution": "choice", "values": ["published", "certified"]}
    study = study_of(sampling={"method": "grid", "levels": 3}, vary=[WIND, choice])
    samples = sample_study(study, {})
    np.testing.assert_allclose(samples["wind.speed_m_s"], [1.5, 1.5, 4.5, 4.5, 7.5, 7.5])
    assert samples["fleet.planner"].tolist() == ["published", "certified"] * 3


def test_flight_seeds_are_unique_within_and_between_studies():
    seeds_1, seeds_2 = flight_seeds(study_of(seed=1), 10_000), flight_seeds(study_of(seed=2), 10_000)
    assert np.unique(seeds_1).size == 10_000
    assert seeds_1.max() < 2**32
    assert np.intersect1d(seeds_1, seeds_2).size == 0


def test_a_saltelli_block_exchanges_one_input_at_a_time():
    study = study_of(sampling={"method": "saltelli", "flights": 16}, vary=[WIND, COURSE])
    assert study.block == 4
    values = np.stack(list(sample_study(study, {}).values()), axis=1).reshape(16, 4, 2)
    a, swapped, b = values[:, 0], values[:, 1:3], values[:, 3]
    for k in range(2):
        np.testing.assert_array_equal(swapped[:, k, k], b[:, k])
        np.testing.assert_array_equal(swapped[:, k, 1 - k], a[:, 1 - k])
    assert not np.any(a == b)
    seeds = flight_seeds(study, 64).reshape(16, 4)
    assert (seeds[:, :3] == seeds[:, :1]).all()
    assert np.unique(seeds[:, [0, 3]]).size == 32
    np.testing.assert_array_equal(is_independent(study, np.arange(8)), [True, False, False, True] * 2)
    assert is_independent(study_of(), np.arange(8)).all()
