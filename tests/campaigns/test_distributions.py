"""Distributions: agreement with scipy, bounds, and refused definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from anser.campaigns.distributions import Dispersion
from anser.campaigns.study import validate_study
from anser.config import ScenarioError

NORMAL = {"distribution": "normal", "mean": 3.0, "sigma": 2.0}
TRUNCATED = {"distribution": "truncated", "mean": 3.0, "sigma": 2.0, "low": 2.0, "high": 8.0}
UNIFORM = {"distribution": "uniform", "low": -1.0, "high": 4.0}
LOG_NORMAL = {"distribution": "log-normal", "median": 2.0, "sigma": 0.5}
TRIANGULAR = {"distribution": "triangular", "low": 0.0, "mode": 0.0, "high": 0.3}
KNOWN = [
    (NORMAL, stats.norm(3.0, 2.0)),
    (TRUNCATED, stats.truncnorm(-0.5, 2.5, 3.0, 2.0)),
    (UNIFORM, stats.uniform(-1.0, 5.0)),
    (LOG_NORMAL, stats.lognorm(0.5, scale=2.0)),
    (TRIANGULAR, stats.triang(0.0, 0.0, 0.3)),
]


def vary(**keys):
    return Dispersion.model_validate({"path": "wind.speed_m_s", **keys})


@pytest.mark.parametrize(("keys", "known"), KNOWN)
@given(share=st.floats(1e-12, 1.0 - 1e-12))
def test_the_quantile_inverts_the_distribution_function(keys, known, share):
    value = vary(**keys).quantile(np.array([share]))
    assert known.cdf(value[0]) == pytest.approx(share, rel=1e-6, abs=1e-12)


@given(share=st.floats(2.0**-53, 1.0 - 2.0**-53))
def test_a_truncated_value_lies_within_its_bounds(share):
    assert 2.0 <= vary(**TRUNCATED).quantile(np.array([share]))[0] <= 8.0


def test_choices_have_the_weighted_frequencies():
    chosen = vary(distribution="choice", values=["a", "b", "c"], weights=[6.0, 3.0, 1.0])
    values = chosen.quantile((np.arange(1000) + 0.5) / 1000)
    assert [int(np.sum(values == letter)) for letter in "abc"] == [600, 300, 100]
    assert vary(distribution="choice", values=[True, False]).quantile(np.array([0.2, 0.7])).tolist() == [True, False]


def refused(**keys):
    values = {
        "format": 1,
        "name": "test",
        "scenario": "three.toml",
        "sampling": {"flights": 4},
        "vary": [{"path": "wind.speed_m_s", **keys}],
    }
    with pytest.raises(ScenarioError) as caught:
        validate_study(values, "study.toml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"distribution": "normal", "mean": 1.0}, "vary[0].sigma: arrived nothing; expected a value"),
        ({**NORMAL, "sigma": 0.0}, "vary[0].sigma: arrived 0.0; expected a number above 0"),
        ({**NORMAL, "low": 1.0}, "vary[0].low: arrived 1.0; expected no such key: normal has mean, sigma"),
        ({"distribution": "uniform", "low": 2.0, "high": 1.0}, "vary[0].low: arrived 2; expected less than high"),
        ({**TRIANGULAR, "mode": 0.5}, "vary[0].mode: arrived 0.5; expected from low to high"),
        ({**TRUNCATED, "low": 30.0, "high": 31.0}, "vary[0].low: arrived 30 to 31, all beyond 8 sigma"),
        ({"distribution": "choice"}, "vary[0].values: arrived nothing"),
        ({"distribution": "choice", "values": []}, "vary[0].values: arrived a list of 0"),
        ({"distribution": "choice", "values": [1.0, "a"]}, "vary[0].values: arrived numbers and texts"),
        ({"distribution": "choice", "values": [1.0, 1.0]}, "vary[0].values: arrived a value twice"),
        ({"distribution": "choice", "values": ["a"], "how": "add"}, 'vary[0].how: arrived "add" for texts'),
        ({"distribution": "choice", "values": [1.0], "weights": [1.0, 2.0]}, "vary[0].weights: arrived a list of 2"),
        ({"distribution": "beta"}, 'vary[0].distribution: arrived "beta"; expected "normal" or'),
    ],
)
def test_an_invalid_distribution_is_refused_with_its_key(keys, said):
    assert said in refused(**keys)
