"""Output error: an independent package, scatter against bounds, coloured noise, the unstable aircraft, refusals."""

import aeroid
import jax.numpy as jnp
import numpy as np
import pytest

from anser.identification.dynamic_models import DynamicModel, ParameterSet, make_manoeuvre
from anser.identification.output_error import estimate_output_error
from support.identification_cases import (
    UNSTABLE_START,
    UNSTABLE_TRUTH,
    short_period,
    unstable_aircraft,
    unstable_measurements,
)
from support.identification_models import SHORT_PERIOD, SHORT_PERIOD_NAMES, UNSTABLE

START = dict(zip(SHORT_PERIOD_NAMES, (-0.8, 1.0, -0.2, -3.5, -1.0, -4.5), strict=True))


def short_period_manoeuvre(rng, noise=0.1):
    """The reference doublet; the input of the case at the end of each step becomes the one at its start."""
    record = short_period(6.0)
    y = record.states + noise * rng.normal(size=record.states.shape)
    inputs = np.append(record.inputs[1:], 0.0)
    return record, make_manoeuvre(SHORT_PERIOD, record.time_s, inputs, y)


def test_sensitivities_are_the_derivatives_of_the_outputs():
    _, manoeuvre = short_period_manoeuvre(np.random.default_rng(0))
    parameters = ParameterSet(SHORT_PERIOD, (*SHORT_PERIOD_NAMES, "alpha(0)"))
    values = np.array([*START.values(), 0.3])
    gain = np.array([[0.05, 0.01], [0.02, 0.1]])
    for correction in (None, gain):
        sensitivities = parameters.predict(values, manoeuvre, correction).sensitivities
        for k, h in enumerate(1e-5 * np.eye(values.size)):
            high, low = (parameters.predict(values + step, manoeuvre, correction).outputs for step in (h, -h))
            np.testing.assert_allclose(sensitivities[..., k], (high - low) / 2e-5, atol=1e-6)


def test_estimates_and_bounds_equal_those_of_an_independent_package():
    record = short_period(6.0)
    y = record.states + 0.1 * np.random.default_rng(1).normal(size=record.states.shape)
    # the package draws straight lines between the samples of an input
    estimate = estimate_output_error(
        SHORT_PERIOD, make_manoeuvre(SHORT_PERIOD, record.time_s, record.inputs, y, held=False), START, noise=(0.1, 0.1)
    )

    def dynamics(_, x, u, p):
        alpha_dot = p["Z_alpha"] * x[0] + p["Z_q"] * x[1] + p["Z_elevator"] * u[0]
        return jnp.stack([alpha_dot, p["M_alpha"] * x[0] + p["M_q"] * x[1] + p["M_elevator"] * u[0]])

    model = aeroid.Model(
        dynamics=dynamics, states=("alpha", "q"), controls=("elevator",), outputs=("alpha", "q"), parameters=START
    )
    channels = {"elevator": record.inputs, "alpha": y[:, 0], "q": y[:, 1]}
    # by its finite differences, the package stops a fifth of a standard error before the minimum
    independent = aeroid.identify(
        model,
        aeroid.FlightData(record.time_s, channels),
        list(SHORT_PERIOD_NAMES),
        weights={"alpha": 10.0, "q": 10.0},
        x0=[0.0, 0.0],
        gradient="jax",
    )
    values = [independent.parameters[name] for name in SHORT_PERIOD_NAMES]
    np.testing.assert_allclose(estimate.values, values, rtol=0.01)
    np.testing.assert_allclose(
        np.sqrt(np.diag(estimate.white_covariance)),
        [independent.stderr[name] for name in SHORT_PERIOD_NAMES],
        rtol=0.01,
    )
    np.testing.assert_allclose(
        estimate.white_covariance / np.sqrt(np.outer(*[np.diag(estimate.white_covariance)] * 2)),
        independent.correlation,
        atol=0.01,
    )


def statistics(estimates, truth):
    """Mean error relative to the truth, coverage of the 95 % intervals, and standard errors over the scatter."""
    values = np.array([estimate.values[: truth.size] for estimate in estimates])
    intervals = np.array([estimate.interval()[: truth.size] for estimate in estimates])
    errors = np.array([estimate.standard_errors[: truth.size] for estimate in estimates])
    covered = (intervals[..., 0] <= truth) & (truth <= intervals[..., 1])
    scatter = np.std(values, axis=0)
    return np.mean(values, axis=0) / truth - 1.0, np.mean(covered, axis=0), np.mean(errors, axis=0) / scatter


def test_scatter_reaches_the_cramer_rao_bound():
    rng, estimates = np.random.default_rng(2), []
    for _ in range(60):
        record, manoeuvre = short_period_manoeuvre(rng)
        estimates.append(estimate_output_error(SHORT_PERIOD, manoeuvre, START))
    error, coverage, ratio = statistics(estimates, record.truth.ravel())
    # six parameters, 60 seeds: the standard error of a scatter is 9 %, of the mean coverage about 1.5 %
    np.testing.assert_allclose(ratio, 1.0, atol=0.3)
    assert 0.90 <= np.mean(coverage) <= 0.99
    assert np.max(np.abs(error[[0, 1, 3, 4, 5]])) < 0.01


def test_bounds_are_corrected_for_coloured_residuals():
    rng, estimates, record = np.random.default_rng(3), [], short_period(6.0)
    for _ in range(40):
        white = rng.normal(size=(record.time_s.size + 100, 2))
        kernel = 0.9 ** np.arange(100)
        coloured = np.stack([np.convolve(x, kernel, "valid")[: record.time_s.size] for x in white.T], axis=1)
        inputs = np.append(record.inputs[1:], 0.0)
        manoeuvre = make_manoeuvre(SHORT_PERIOD, record.time_s, inputs, record.states + 0.1 * coloured)
        estimates.append(estimate_output_error(SHORT_PERIOD, manoeuvre, START))
    _, coverage, ratio = statistics(estimates, record.truth.ravel())
    plain = np.mean([np.sqrt(np.diag(e.white_covariance) / np.diag(e.covariance)) for e in estimates], axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.35)
    assert 0.90 <= np.mean(coverage) <= 0.99
    assert np.max(plain * ratio) < 0.5  # the plain bound is less than half of the scatter


def unstable_manoeuvre(rng):
    record = unstable_aircraft()
    return make_manoeuvre(UNSTABLE, record.time_s, record.inputs, unstable_measurements(record, rng))


FIXED = {"Z_q": UNSTABLE_TRUTH["Z_q"]}
TRUTH = np.array([UNSTABLE_TRUTH[name] for name in UNSTABLE_START])


def test_plain_output_error_of_an_unstable_aircraft_is_wrong_and_says_why():
    rng = np.random.default_rng(4)
    estimates = [
        estimate_output_error(UNSTABLE, unstable_manoeuvre(rng), UNSTABLE_START, fixed=FIXED) for _ in range(10)
    ]
    error, _, _ = statistics(estimates, TRUTH)
    assert np.min(np.abs(error)) > 0.20
    assert "unstable (eigenvalue +0.389 1/s): integrated over 12.5 s, it amplifies" in estimates[0].notes[0]
    with pytest.raises(ValueError, match=r"collinear .*\. The model is unstable \(eigenvalue \+0\.693 1/s\)"):
        estimate_output_error(
            UNSTABLE, unstable_manoeuvre(rng), {name: UNSTABLE_TRUTH[name] for name in UNSTABLE_START}, fixed=FIXED
        )


def stabilized_statistics(seeds):
    rng = np.random.default_rng(0)
    return statistics(
        [
            estimate_output_error(UNSTABLE, unstable_manoeuvre(rng), UNSTABLE_START, fixed=FIXED, stabilized=True)
            for _ in range(seeds)
        ],
        TRUTH,
    )


def test_stabilised_output_error_of_the_unstable_aircraft():
    error, coverage, ratio = stabilized_statistics(30)
    # four standard errors of the mean of 30 seeds, with scatters of 1 to 6 %
    assert np.all(np.abs(error) < 4.0 * np.array([0.011, 0.06, 0.022, 0.019, 0.011]) / np.sqrt(30))
    assert np.mean(coverage) >= 0.90
    np.testing.assert_allclose(ratio, 1.0, atol=0.4)


@pytest.mark.long
def test_stabilised_output_error_over_two_hundred_seeds():
    error, coverage, _ = stabilized_statistics(200)
    assert np.max(np.abs(error)) < 0.01
    assert np.min(coverage) >= 0.90
    assert np.max(coverage) <= 0.99


def test_initial_states_are_estimated_with_the_parameters():
    # x' = -a x from x(0) = 2: the response is 2 exp(-a t)
    model = DynamicModel(lambda x, u, theta: (-theta["a"] * x, x), ("x",), ("u",), ("y",))
    time_s = np.arange(200) * 0.02
    y = 2.0 * np.exp(-1.5 * time_s) + 0.01 * np.random.default_rng(5).normal(size=200)
    estimate = estimate_output_error(
        model, make_manoeuvre(model, time_s, np.zeros(200), y, [1.0]), {"a": 1.0}, initial_states=["x"]
    )
    assert estimate.names == ("a", "x(0)")
    np.testing.assert_allclose(estimate.values, [1.5, 2.0], atol=4.0 * np.max(estimate.standard_errors))


def test_input_noise_of_a_stabilised_model_widens_the_intervals_to_the_scatter():
    """x' = a x + b u, unstable, flown with feedback: the influence is that of the response with the correction."""
    model = DynamicModel(lambda x, u, theta: (theta["a"] * x + theta["b"] * u, x), ("x",), ("u",), ("y",))
    time_s, rng, estimates = np.arange(500) * 0.02, np.random.default_rng(7), []
    x, u = np.zeros(500), np.zeros(500)
    for k in range(499):
        u[k] = np.sign(np.sin(2.0 * time_s[k])) - 3.0 * x[k]
        x[k + 1] = np.exp(0.02) * x[k] + (np.exp(0.02) - 1.0) * u[k]
    for _ in range(30):
        y, recorded = x + 0.001 * rng.normal(size=500), u + 0.2 * rng.normal(size=500)
        manoeuvre, start = make_manoeuvre(model, time_s, recorded, y, [0.0]), {"a": 0.8, "b": 1.2}
        estimates.append(estimate_output_error(model, manoeuvre, start, stabilized=True, input_noise=[0.2]))
    _, _, ratio = statistics(estimates, np.ones(2))
    # 30 seeds: the standard error of a scatter is 13 %; the residuals contain input noise too, counted twice
    assert np.all((ratio > 0.7) & (ratio < 1.8))


@pytest.mark.parametrize(
    ("start", "options", "message"),
    [
        ({"a": 1.0, "b": 1.0, "c": 0.5}, {}, "parameters: (a, b|b, a) are collinear"),
        ({"a": 1.0, "c": 0.5, "d": 1.0}, {"fixed": {"b": 1.0}}, "parameters: no excitation of d"),
        ({"a": 800.0, "c": 0.5}, {"fixed": {"b": 1.0}}, "start: the model diverges.*unstable"),
        ({"a": 1.0, "c": np.nan}, {"fixed": {"b": 1.0}}, "start: arrived .*finite numbers"),
        ({"a": 1.0, "c": 1.0}, {"fixed": {"b": 1.0}, "initial_states": ["y"]}, "expected some of x"),
        ({"a": 1.0, "c": 1.0}, {"fixed": {"b": 1.0}, "noise": [0.0]}, "noise: arrived .*positive numbers for y"),
        ({"a": 1.0, "c": 1.0}, {"fixed": {"b": 1.0}, "input_noise": [-1.0]}, "input_noise: .*0 or more, for u"),
        ({"a": 1.0, "c": 1.0}, {"fixed": {"b": 1.0}, "input_noise": [1.0, 1.0]}, "input_noise: .*0 or more, for u"),
    ],
)
def test_models_without_information_are_refused_by_name(start, options, message):
    def equations(x, u, theta):
        return (theta["a"] * theta["b"] - 2.0) * x + theta["c"] * u + 0.0 * theta.get("d", 0.0), x

    model = DynamicModel(equations, ("x",), ("u",), ("y",))
    time_s = np.arange(200) * 0.02
    u = np.sign(np.sin(3.0 * time_s))
    x = np.zeros(200)
    for k in range(199):
        x[k + 1] = x[k] * np.exp(-0.02) + 0.7 * u[k] * (1.0 - np.exp(-0.02))
    y = x + 0.01 * np.random.default_rng(6).normal(size=200)
    with pytest.raises(ValueError, match=message):
        estimate_output_error(model, make_manoeuvre(model, time_s, u, y), start, **options)


def test_arrays_of_another_shape_are_refused_with_the_names_of_the_model():
    with pytest.raises(ValueError, match=r"outputs: arrived shape \(100, 1\); expected \(100, 2\): alpha, q"):
        make_manoeuvre(SHORT_PERIOD, np.arange(100) * 0.02, np.zeros(100), np.zeros(100))
    outputs = jnp.full((100, 2), jnp.nan)
    with pytest.raises(ValueError, match="outputs: arrived 200 numbers of 200 that are not finite"):
        make_manoeuvre(SHORT_PERIOD, np.arange(100) * 0.02, np.zeros(100), outputs)
