"""Filter error: a Kalman filter in NumPy, process noise that output error cannot explain, the unstable aircraft."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from anser.identification.dynamic_models import DynamicModel, make_manoeuvre
from anser.identification.filter_error import estimate_filter_error
from anser.identification.output_error import estimate_output_error
from support.identification_cases import UNSTABLE_START, UNSTABLE_TRUTH, unstable_aircraft, unstable_measurements
from support.identification_models import UNSTABLE

STEP_S, COUNT = 0.05, 400
FIRST_ORDER = DynamicModel(
    lambda x, u, theta: (-theta["a"] * x + theta["b"] * u, x), states=("x",), inputs=("u",), outputs=("y",)
)
TRUTH = {"a": 1.2, "b": 2.0, "density": 0.04, "sigma": 0.1}
TIME_S = np.arange(COUNT) * STEP_S
INPUT = np.sign(np.sin(1.7 * TIME_S))


def gusty_record(rng):
    """First-order response with white noise in its rate, as exact discrete noise, and measurement noise."""
    decay = np.exp(-TRUTH["a"] * STEP_S)
    deviation = np.sqrt(TRUTH["density"] * (1.0 - decay**2) / (2.0 * TRUTH["a"]))
    x = np.zeros(COUNT)
    for k in range(COUNT - 1):
        x[k + 1] = decay * x[k] + (1.0 - decay) * TRUTH["b"] / TRUTH["a"] * INPUT[k] + deviation * rng.normal()
    return x + TRUTH["sigma"] * rng.normal(size=COUNT)


def negative_log_likelihood(unknown, y):
    """Of a scalar Kalman filter, written independently; the filter starts at zero with the measurement's variance."""
    a, b, density, log_variance = unknown
    decay, R = np.exp(-a * STEP_S), np.exp(log_variance)
    Q = density * (1.0 - decay**2) / (2.0 * a)
    x, P, cost = 0.0, R, 0.0
    for k in range(COUNT):
        S, v = P + R, y[k] - x
        cost += 0.5 * (v**2 / S + np.log(S))
        x, P = x + P / S * v, P * R / S
        x, P = decay * x + (1.0 - decay) * b / a * INPUT[k], decay**2 * P + Q
    return cost


def estimate(y):
    manoeuvre = make_manoeuvre(FIRST_ORDER, TIME_S, INPUT, y)
    return estimate_filter_error(FIRST_ORDER, manoeuvre, {"a": 1.0, "b": 1.0}, {"x": 0.1})


def test_estimate_is_a_stationary_point_of_an_independent_likelihood():
    y = gusty_record(np.random.default_rng(0))
    fit = estimate(y)
    innovations = fit.residuals[:, 0]
    # the measurement's variance is not among the results: the likelihood is minimised over it
    costs = {s: negative_log_likelihood([*fit.values, 2.0 * np.log(s)], y) for s in np.linspace(0.05, 0.15, 201)}
    sigma = min(costs, key=costs.get)
    point = np.array([*fit.values, 2.0 * np.log(sigma)])
    slope = approx_fprime(point, negative_log_likelihood, 1e-6, y)
    # slopes in units of the standard errors; Runge-Kutta and trapezoidal noise differ from the exact ones by 1e-3
    assert np.all(np.abs(slope[:3] * fit.standard_errors) < 0.05)
    assert np.std(innovations) == pytest.approx(np.sqrt(TRUTH["sigma"] ** 2 + 0.01), rel=0.3)
    assert fit.whiteness.share_outside[0] < 0.12


@pytest.mark.long
def test_process_noise_is_estimated_and_output_error_misses_the_truth_more_often():
    rng, covered, plain_covered, densities = np.random.default_rng(1), [], [], []
    truth = np.array([TRUTH["a"], TRUTH["b"]])
    for _ in range(40):
        y = gusty_record(rng)
        fit = estimate(y)
        plain = estimate_output_error(FIRST_ORDER, make_manoeuvre(FIRST_ORDER, TIME_S, INPUT, y), {"a": 1.0, "b": 1.0})
        densities.append(fit["noise(x)"])
        covered.append(np.abs(fit.values[:2] - truth) < 1.96 * fit.standard_errors[:2])
        plain_covered.append(np.abs(plain.values - truth) < 1.96 * np.sqrt(np.diag(plain.white_covariance)))
    assert np.mean(densities) == pytest.approx(TRUTH["density"], rel=0.1)
    assert 0.90 <= np.mean(covered) <= 0.99
    assert np.mean(plain_covered) < 0.7


def unstable_statistics(seeds):
    rng, record, values, covered = np.random.default_rng(0), unstable_aircraft(), [], []
    truth = np.array([UNSTABLE_TRUTH[name] for name in UNSTABLE_START])
    for _ in range(seeds):
        manoeuvre = make_manoeuvre(UNSTABLE, record.time_s, record.inputs, unstable_measurements(record, rng))
        fit = estimate_filter_error(
            UNSTABLE, manoeuvre, UNSTABLE_START, {"w": 1e-2, "q": 1e-4}, fixed={"Z_q": UNSTABLE_TRUTH["Z_q"]}
        )
        values.append(fit.values[:5])
        low, high = fit.interval()[:5].T
        covered.append((low <= truth) & (truth <= high))
    return np.mean(values, axis=0) / truth - 1.0, np.mean(covered, axis=0)


@pytest.mark.long
def test_unstable_aircraft_by_filter_error():
    error, coverage = unstable_statistics(10)
    # four standard errors of the mean of 10 seeds, with scatters of 1 to 6 %
    assert np.all(np.abs(error) < 4.0 * np.array([0.011, 0.06, 0.022, 0.019, 0.011]) / np.sqrt(10))
    assert np.mean(coverage) >= 0.90


@pytest.mark.long
def test_unstable_aircraft_by_filter_error_over_two_hundred_seeds():
    error, coverage = unstable_statistics(200)
    assert np.max(np.abs(error)) < 0.01
    assert np.min(coverage) >= 0.90
    assert np.max(coverage) <= 0.99


@pytest.mark.parametrize(
    ("process_noise", "start", "message"),
    [
        ({}, {"a": 1.0, "b": 1.0}, "process_noise: arrived {}"),
        ({"x": -1.0}, {"a": 1.0, "b": 1.0}, "process_noise: arrived .*-1.0"),
        ({"x": 0.1}, {"a": -1e200, "b": 1.0}, "start: the model diverges"),
    ],
)
def test_filters_without_information_are_refused(process_noise, start, message):
    manoeuvre = make_manoeuvre(FIRST_ORDER, TIME_S, INPUT, gusty_record(np.random.default_rng(2)))
    with pytest.raises(ValueError, match=message):
        estimate_filter_error(FIRST_ORDER, manoeuvre, start, process_noise)
