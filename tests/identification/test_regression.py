"""Least squares in the time domain: textbook solutions, coverage of intervals with coloured errors, refusals."""

import numpy as np
import pytest

from anser.identification.regression import regress

TIME_S = np.arange(400) * 0.02
SIGNALS = {"alpha": np.sin(2.0 * TIME_S), "q": np.cos(3.0 * TIME_S)}


def response(rng, noise=0.1):
    return 0.5 + SIGNALS["alpha"] - 2.0 * SIGNALS["q"] + noise * rng.normal(size=TIME_S.size)


def test_independent_samples_give_the_textbook_solution():
    z = response(np.random.default_rng(0))
    estimate = regress(SIGNALS, z)
    X = np.stack([*SIGNALS.values(), np.ones_like(z)], axis=1)
    theta = np.linalg.solve(X.T @ X, X.T @ z)
    residuals = z - X @ theta
    covariance = residuals @ residuals / (z.size - 3) * np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(estimate.values, theta, rtol=1e-10)
    np.testing.assert_allclose(estimate.covariance, covariance, rtol=1e-10)
    # Student's distribution with 397 degrees of freedom (tables: 1.966)
    half = estimate.interval(0.95)[:, 1] - estimate.values
    np.testing.assert_allclose(half / estimate.standard_errors, 1.966, atol=1e-3)
    assert estimate.r_squared[0] == pytest.approx(1.0 - np.sum(residuals**2) / np.sum((z - z.mean()) ** 2))


def test_variance_inflation_is_that_of_the_regression_on_the_remaining_regressors():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 400))
    regressors = {"a": a, "b": 0.8 * a + 0.6 * b + 3.0}
    estimate = regress(regressors, response(rng))
    r = np.corrcoef(*regressors.values())[0, 1]
    np.testing.assert_allclose(estimate.variance_inflation[:2], 1.0 / (1.0 - r**2), rtol=1e-9)


def test_table_shows_an_interval_beside_every_value_and_the_dataset_has_labels():
    estimate = regress(SIGNALS, response(np.random.default_rng(2)), TIME_S, response_name="Cm")
    lines = str(estimate).splitlines()
    for name, line in zip(estimate.names, lines[2:5], strict=True):
        assert name in line
        assert " to " in line
    dataset = estimate.dataset
    assert float(dataset["estimate"].sel(parameter="q")) == estimate["q"]
    assert dataset["residual"].dims == ("time", "response")
    assert estimate.whiteness.share_outside[0] < 0.15


@pytest.mark.parametrize(
    ("regressors", "message"),
    [
        ({**SIGNALS, "elevator": -1.5 * SIGNALS["alpha"]}, r"(alpha, elevator|elevator, alpha) are collinear"),
        ({**SIGNALS, "elevator": np.full(400, 0.3)}, "no excitation of elevator"),
        ({**SIGNALS, "elevator": np.random.default_rng(3).normal(size=400)}, "elevator: no excitation"),
        ({**SIGNALS, "elevator": np.where(TIME_S > 1.0, np.nan, 1.0)}, "elevator: arrived 349 samples of 400"),
        ({**SIGNALS, "elevator": np.ones(399)}, r"elevator: arrived an array of shape \(399,\)"),
    ],
)
def test_regressions_without_information_are_refused_by_name(regressors, message):
    with pytest.raises(ValueError, match=message):
        regress(regressors, response(np.random.default_rng(0)), TIME_S)


def test_unequal_steps_are_refused():
    with pytest.raises(ValueError, match="equal steps"):
        regress(SIGNALS, response(np.random.default_rng(0)), TIME_S**1.1)


def coverage(time_s):
    """Share of 95 % intervals that contain the truth, for errors of first order with a correlation of 0.9."""
    rng, covered = np.random.default_rng(4), []
    for _ in range(200):
        white = rng.normal(size=TIME_S.size + 200)
        error = np.convolve(white, 0.9 ** np.arange(200), "valid")[: TIME_S.size]
        estimate = regress(SIGNALS, response(rng, 0.0) + 0.1 * error, time_s)
        low, high = estimate.interval()[:2].T
        covered.append((low <= [1.0, -2.0]) & (high >= [1.0, -2.0]))
    return np.mean(covered)


def test_intervals_of_a_record_cover_the_truth_under_coloured_errors_and_plain_intervals_do_not():
    assert 0.90 <= coverage(TIME_S) <= 0.99
    assert coverage(None) < 0.7
