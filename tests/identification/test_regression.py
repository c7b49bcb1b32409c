"""Least squares in the time domain: textbook solutions, coverage of intervals with coloured errors, refusals."""

import numpy as np
import pytest

from anser.identification.frequency_regression import regress_spectra
from anser.identification.regression import regress, regress_stepwise, regress_total, regress_with_prior, step_means
from support.identification_cases import (
    UNSTABLE_NOISE,
    UNSTABLE_STEP_S,
    UNSTABLE_TRUTH,
    unstable_aircraft,
    unstable_measurements,
)

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
        (
            {**SIGNALS, "elevator": np.random.default_rng(3).normal(size=400)},
            r"no excitation of elevator \(\d+ % noise\)",
        ),
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


def test_total_least_squares_equals_the_generalised_eigenvector():
    rng = np.random.default_rng(5)
    noise = {"alpha": 0.2, "q": 0.1}
    z = response(rng, 0.3)
    noisy = {name: x + noise[name] * rng.normal(size=x.size) for name, x in SIGNALS.items()}
    estimate = regress_total(noisy, z, TIME_S, noise=noise, response_noise=0.3)
    # the centred columns, scaled to unit noise: the eigenvector of the least eigenvalue is the normal of the plane
    joint = np.column_stack([noisy["alpha"] / 0.2, noisy["q"] / 0.1, z / 0.3])
    joint -= joint.mean(axis=0)
    normal = np.linalg.eigh(joint.T @ joint)[1][:, 0]
    np.testing.assert_allclose(estimate.values[:2], -normal[:2] / normal[2] * 0.3 / [0.2, 0.1], rtol=1e-9)


def test_stepwise_regression_finds_the_regressors_of_the_response():
    rng = np.random.default_rng(6)
    candidates = {
        "alpha2": SIGNALS["alpha"] ** 2,
        **SIGNALS,
        "elevator": np.sign(np.sin(5.0 * TIME_S)),
        "alpha q": SIGNALS["alpha"] * SIGNALS["q"],
    }
    for criterion in ("F", "PSE"):
        z = response(rng)
        estimate = regress_stepwise(candidates, z, TIME_S, criterion=criterion)
        assert estimate.names[:2] == ("q", "alpha")
        assert estimate.notes[0].startswith(f"q enters: R2 {np.corrcoef(SIGNALS['q'], z)[0, 1] ** 2:.4f}")
        assert criterion == "PSE" or estimate.names == ("q", "alpha", "constant")
    with pytest.raises(ValueError, match="no candidate is significant"):
        regress_stepwise(candidates, rng.normal(size=TIME_S.size), TIME_S)


def test_prior_values_enter_with_the_inverse_of_their_variance():
    # one unit regressor: the estimate is the mean of record and prior, weighted with the inverse variances
    rng = np.random.default_rng(7)
    z = 2.0 + rng.normal(size=100)
    estimate = regress_with_prior({"a": np.ones(100)}, z, {"a": (3.0, 0.05)}, constant=False)
    weights = np.array([100.0 / np.var(z, ddof=1), 0.05**-2])
    assert estimate["a"] == pytest.approx(weights @ [z.mean(), 3.0] / weights.sum(), rel=1e-9)
    assert estimate.standard_errors[0] == pytest.approx(weights.sum() ** -0.5, rel=1e-9)


def test_prior_values_tell_collinear_regressors_apart():
    collinear = {**SIGNALS, "elevator": -1.5 * SIGNALS["alpha"]}
    z = response(np.random.default_rng(8))
    estimate = regress_with_prior(collinear, z, {"elevator": (0.4, 0.1)}, TIME_S)
    # the record tells alpha - 1.5 elevator only
    assert estimate["alpha"] - 1.5 * estimate["elevator"] == pytest.approx(1.0, abs=0.05)
    assert estimate["elevator"] == pytest.approx(0.4, abs=1e-3)
    assert estimate.standard_errors[list(estimate.names).index("elevator")] == pytest.approx(0.1, rel=0.02)
    with pytest.raises(ValueError, match=r"regressors and prior: .*collinear"):
        regress_with_prior(collinear, z, {"q": (0.4, 0.1)}, TIME_S)


def test_step_means_of_a_linear_system_with_held_input_satisfy_its_equation():
    # x' = -x + u, u held: the mean of x over a step follows from the exact solution to O(step^2)
    step, x, u = 0.01, [0.0], np.sign(np.sin(np.arange(1000) * 0.02))
    for value in u[:-1]:
        x.append(value + (x[-1] - value) * np.exp(-step))
    means, rate, times = step_means({"x": x, "u": u}, x, np.arange(1000) * step, held=["u"])
    np.testing.assert_allclose(rate, -means["x"] + means["u"], atol=step**2)
    assert times[0] == pytest.approx(0.5 * step)


@pytest.fixture(scope="module")
def unstable_estimates():
    """Estimates of Z_w, Z_d, M_w, M_q, M_d of the unstable aircraft under feedback, by method and seed; Z_q is known."""
    record, rng = unstable_aircraft(), np.random.default_rng(0)
    time_s, delta, Z_q = record.time_s, record.inputs, UNSTABLE_TRUTH["Z_q"]
    noise = dict(zip(("w", "q"), UNSTABLE_NOISE[:2], strict=True))
    mean_noise = {name: level / np.sqrt(2.0) for name, level in noise.items()}
    z_noise = float(np.hypot(UNSTABLE_NOISE[2], Z_q * noise["q"]))
    rate_noise = np.sqrt(2.0) * noise["q"] / UNSTABLE_STEP_S
    estimates = {name: [] for name in ("plain", "ordinary", "total", "frequency")}
    for _ in range(200):
        w, q, a_z = unstable_measurements(record, rng).T
        states, z = {"w": w, "q": q, "delta": delta}, a_z - Z_q * q
        forces = {"w": w, "delta": delta}
        means, rate, times = step_means(states, q, time_s, held=["delta"])
        force, moment, options = (forces, z, time_s), (means, rate, times), {"constant": False}
        estimates["plain"].append((regress(*force, **options), regress(*moment, **options)))
        estimates["ordinary"].append(
            (regress(*force, noise={"w": noise["w"]}, **options), regress(*moment, noise=mean_noise, **options))
        )
        estimates["total"].append(
            (
                regress_total(*force, noise={"w": noise["w"]}, response_noise=z_noise, **options),
                regress_total(*moment, noise=mean_noise, response_noise=rate_noise, **options),
            )
        )
        estimates["frequency"].append(
            (
                regress_spectra(*force, steady_start=True, noise={"w": noise["w"]}),
                regress_spectra(
                    *(states, q, time_s), differentiate=True, held=["delta"], steady_start=True, noise=noise
                ),
            )
        )
    return estimates


def mean_error_and_coverage(estimates):
    truth = np.array([UNSTABLE_TRUTH[name] for name in ("Z_w", "Z_d", "M_w", "M_q", "M_d")])
    values = np.array([np.concatenate([e.values for e in pair]) for pair in estimates])
    intervals = np.array([np.concatenate([e.interval() for e in pair]) for pair in estimates])
    covered = (intervals[..., 0] <= truth) & (truth <= intervals[..., 1])
    return np.mean(values, axis=0) / truth - 1.0, np.mean(covered, axis=0)


@pytest.mark.parametrize("method", ["ordinary", "total", "frequency"])
def test_unstable_aircraft_under_feedback(unstable_estimates, method):
    error, coverage = mean_error_and_coverage(unstable_estimates[method])
    # the mean of 200 seeds has a standard error of at most 1 % (Z_d)
    assert np.max(np.abs(error)) < 0.01
    assert np.min(coverage) >= 0.90
    assert np.max(coverage) <= 0.99


def test_noise_of_the_regressors_biases_the_uncorrected_regression(unstable_estimates):
    error, coverage = mean_error_and_coverage(unstable_estimates["plain"])
    assert np.min(np.abs(error)) > 0.05
    assert np.max(coverage) < 0.60
