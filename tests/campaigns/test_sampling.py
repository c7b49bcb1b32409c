"""Samples: each flight's own whatever the number of flights, even where asked, correlated as asked."""

import numpy as np
import pytest
from scipy import stats

from anser.campaigns.sampling import flight_seeds, is_independent, sample_study
from campaigns.study_cases import WIND, study_of

COURSE = {"path": "wind.from_deg", "distribution": "normal", "mean": 10.0, "sigma": 5.0}


def values_of(method, flights, **more):
    return sample_study(study_of(sampling={"method": method, "flights": flights}, vary=[WIND, COURSE], **more), {})


def test_more_flights_leave_the_first_as_they_are():
    few, many = values_of("monte-carlo", 10), values_of("monte-carlo", 1000)
    for path in few:
        np.testing.assert_array_equal(few[path], many[path][:10])
    assert np.any(few["wind.speed_m_s"] != values_of("monte-carlo", 10, seed=2)["wind.speed_m_s"])


@pytest.mark.parametrize(("method", "flights"), [("monte-carlo", 4000), ("latin-hypercube", 4000), ("sobol", 4096)])
def test_samples_have_their_distributions_and_are_independent(method, flights):
    found = values_of(method, flights)
    assert stats.kstest(found["wind.speed_m_s"], stats.uniform(0.0, 9.0).cdf).pvalue > 1e-3
    assert stats.kstest(found["wind.from_deg"], stats.norm(10.0, 5.0).cdf).pvalue > 1e-3
    # of independent ones four standard deviations are passed once in 16,000
    assert abs(stats.spearmanr(found["wind.speed_m_s"], found["wind.from_deg"])[0]) < 4.0 / np.sqrt(flights)


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_even_samples_have_one_value_in_each_part(method):
    found = np.sort(values_of(method, 64)["wind.speed_m_s"]) / 9.0
    assert np.array_equal(np.floor(64 * found), np.arange(64))


def test_groups_are_correlated_as_asked():
    group = {"paths": ["wind.speed_m_s", "wind.from_deg"], "coefficients": [[1.0, 0.8], [0.8, 1.0]]}
    found = values_of("monte-carlo", 4000, correlated=[group])
    normals = stats.norm.ppf(found["wind.speed_m_s"] / 9.0), (found["wind.from_deg"] - 10.0) / 5.0
    # standard deviation of the estimate: (1 - 0.8^2) / sqrt(4000) = 0.0057
    assert np.corrcoef(*normals)[0, 1] == pytest.approx(0.8, abs=0.023)
    assert stats.kstest(found["wind.speed_m_s"], stats.uniform(0.0, 9.0).cdf).pvalue > 1e-3


def test_a_grid_has_every_combination():
    choice = {"path": "fleet.planner", "distribution": "choice", "values": ["published", "certified"]}
    study = study_of(sampling={"method": "grid", "levels": 3}, vary=[WIND, choice])
    found = sample_study(study, {})
    np.testing.assert_allclose(found["wind.speed_m_s"], [1.5, 1.5, 4.5, 4.5, 7.5, 7.5])
    assert found["fleet.planner"].tolist() == ["published", "certified"] * 3


def test_every_flight_has_a_seed_of_its_own_and_studies_do_not_share_them():
    one, other = flight_seeds(study_of(seed=1), 10_000), flight_seeds(study_of(seed=2), 10_000)
    assert np.unique(one).size == 10_000
    assert one.max() < 2**32
    assert np.intersect1d(one, other).size == 0


def test_a_saltelli_block_is_a_point_another_and_the_first_with_each_of_its_numbers_from_the_other():
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
