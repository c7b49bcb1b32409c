"""Regression of Fourier transforms: published cases with known truth, coverage of the intervals, exact transforms."""

import functools

import numpy as np
import pytest
from scipy.signal import lfilter

import anser
from anser.identification import frequency_regression
from anser.identification.frequency_regression import fourier_transforms, regress_spectra
from support.identification_cases import SHORT_PERIOD_FREQUENCIES_HZ, short_period

# Scatter over seeds of Z_alpha, Z_q, Z_delta, M_alpha, M_q, M_delta: the project's reference figures, section 1.
CASES = {
    "stable, doublet, 4 s": ((4.0, -4.3, "doublet"), (0.018, 0.021, 0.040, 0.032, 0.028, 0.054)),
    "stable, doublet, 10 s": ((10.0, -4.3, "doublet"), (0.013, 0.014, 0.031, 0.030, 0.021, 0.045)),
    "stable, 3-2-1-1, 20 s": ((20.0, -4.3, "3-2-1-1"), (0.008, 0.007, 0.019, 0.014, 0.013, 0.030)),
    "unstable, doublet, 4 s": ((4.0, 1.0, "doublet"), (0.018, 0.014, 0.029, 0.023, 0.016, 0.037)),
    "unstable, 3-2-1-1, 10 s": ((10.0, 1.0, "3-2-1-1"), (0.006, 0.007, 0.017, 0.006, 0.007, 0.018)),
}


@pytest.fixture(scope="module", autouse=True)
def transforms_of_each_record():
    """The transforms of a record, the same for every seed, are built once."""
    built = {}

    def of(time_s, frequencies_hz, **options):
        key = time_s.tobytes(), np.asarray(frequencies_hz).tobytes(), *sorted(options.items())
        if key not in built:
            built[key] = fourier_transforms(time_s, frequencies_hz, **options)
        return built[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(frequency_regression, "fourier_transforms", of)
        yield


@functools.cache
def estimates_of(case, seeds=100, **options):
    """Values, errors, intervals and plain errors (seed, parameter) of both equations, with noise of 0.1."""
    record, rng, rows = short_period(*case), np.random.default_rng(0), []
    for _ in range(seeds):
        alpha, q = (record.states + 0.1 * rng.normal(size=record.states.shape)).T
        regressors = {"alpha": alpha, "q": q, "elevator": record.inputs}
        fits = [
            regress_spectra(
                *(regressors, rate_of, record.time_s, SHORT_PERIOD_FREQUENCIES_HZ),
                **{"differentiate": True, "held": ["elevator"], "hold": "preceding", "steady_start": True, **options},
            )
            for rate_of in (alpha, q)
        ]
        rows.append([np.concatenate([getattr(fit, name) for fit in fits]) for name in ("values", "standard_errors")])
        rows[-1].append(np.concatenate([fit.interval() for fit in fits]))
        rows[-1].append(np.concatenate([np.sqrt(np.diag(fit.white_covariance)) for fit in fits]))
    return record.truth.ravel(), *(np.array(column) for column in zip(*rows, strict=True))


@pytest.mark.parametrize("name", CASES)
def test_corrected_transforms_reach_the_reference(name):
    case, scatter = CASES[name]
    truth, values, _, intervals, _ = estimates_of(case)
    error = np.abs(np.mean(values, axis=0) - truth)
    assert np.all((error < 0.005 * np.abs(truth)) | (error < 0.5 * np.std(values, axis=0)))
    # 15 %, and twice the standard error of a scatter over 100 seeds, 7 %
    assert np.all(np.std(values, axis=0) < 1.15 * np.array(scatter) * 1.14 + 0.0005)
    coverage = np.mean((intervals[..., 0] <= truth) & (truth <= intervals[..., 1]), axis=0)
    assert np.mean(coverage) == pytest.approx(0.96, abs=0.03)
    assert np.min(coverage) >= 0.84  # a coverage of 0.90 over 100 seeds has a standard error of 0.03
    assert np.mean(coverage) <= 0.99


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_reference_over_two_thousand_seeds(name):
    case, scatter = CASES[name]
    truth, values, _, intervals, _ = estimates_of(case, 2000)
    error = np.abs(np.mean(values, axis=0) - truth)
    assert np.all((error < 0.005 * np.abs(truth)) | (error < 0.5 * np.std(values, axis=0)))
    # 15 %; the reference has 100 to 200 seeds (standard error 5 to 7 %) and three decimals
    assert np.all(np.std(values, axis=0) < 1.15 * np.array(scatter) * 1.07 + 0.0005)
    coverage = np.mean((intervals[..., 0] <= truth) & (truth <= intervals[..., 1]), axis=0)
    assert np.min(coverage) >= 0.90
    assert np.max(coverage) <= 0.99


def test_uncorrected_transforms_have_the_bias_of_the_publication():
    truth, values, *_ = estimates_of(CASES["stable, doublet, 10 s"][0], corrected=False)
    published = [-0.600, 0.949, -0.117, -4.361, -1.252, -5.250]
    # of 100 seeds here and 200 there
    tolerance = 3.0 * np.std(values, axis=0) * np.sqrt(1.0 / 100.0 + 1.0 / 200.0)
    assert np.all(np.abs(np.mean(values, axis=0) - published) < tolerance)
    assert np.all(np.abs(np.mean(values, axis=0) - truth)[3:] > 1.0 * np.std(values, axis=0)[3:])


def test_plain_covariance_fails_where_the_corrected_covariance_covers():
    ratios, corrected = [], []
    for case, _ in CASES.values():
        _, values, errors, _, plain = estimates_of(case)
        ratios.append(np.mean(plain, axis=0) / np.std(values, axis=0))
        corrected.append(np.mean(errors, axis=0) / np.std(values, axis=0))
    # the published formula, s^2 (X* X)^-1: standard errors from 0.6 to more than twice the scatter
    assert np.min(ratios) < 0.75
    assert np.max(ratios) > 2.0
    # the scatter over 100 seeds has a standard error of 7 %
    np.testing.assert_allclose(corrected, 1.0, atol=0.4)


def test_transforms_of_an_exponential_are_those_of_the_analysis():
    # x = exp(-t / 2): transform (1 - exp(-(1/2 + i w) T)) / (1/2 + i w), and of its rate -1/2 of that
    time_s, frequencies = np.arange(2001) * 0.005, np.array([0.13, 0.4, 1.0])
    s = 0.5 + 2j * np.pi * frequencies
    exact = (1.0 - np.exp(-s * 10.0)) / s
    F = fourier_transforms(time_s, frequencies)
    window = (1.0 - np.exp(-2j * np.pi * frequencies * 10.0)) / (2j * np.pi * frequencies)
    x = np.exp(-0.5 * time_s)
    mean = 0.2 * (1.0 - np.exp(-5.0))
    np.testing.assert_allclose(F.signal @ x, exact - mean * window, atol=1e-4)
    np.testing.assert_allclose(F.derivative @ x, -0.5 * (exact - mean * window), atol=1e-3)
    # a constant and a constant rate drop out
    np.testing.assert_allclose(F.signal @ np.ones(2001), 0.0, atol=1e-12)
    np.testing.assert_allclose(F.held @ np.ones(2001), 0.0, atol=1e-12)
    np.testing.assert_allclose(F.derivative @ time_s, 0.0, atol=1e-3)  # (w step)^2 / 12 times the transform of 1


def test_transform_of_a_held_input_is_that_of_its_pulse_without_the_filter_of_the_hold():
    # a pulse from 0.2 to 0.7 s: (exp(-0.2 i w) - exp(-0.7 i w)) / i w; the hold filters with sinc(w step / 2)
    time_s, frequencies = np.arange(21) * 0.1, np.array([0.3, 1.0, 2.0])
    s = 2j * np.pi * frequencies
    for hold, first in (("following", 2), ("preceding", 3)):
        pulse = np.zeros(21)
        pulse[first : first + 5] = 1.0
        F = fourier_transforms(time_s, frequencies, hold=hold, steady_start=True)
        filtered = np.sinc(frequencies * 0.1) * (F.held @ pulse)
        np.testing.assert_allclose(filtered, (np.exp(-0.2 * s) - np.exp(-0.7 * s)) / s, atol=1e-12)


def roll_rate(u, gust, damping, effect, step_s=0.02):
    """Solution of p' = damping (p - gust) + effect u with inputs that are held over a step."""
    fade, p = np.exp(damping * step_s), np.zeros(u.size)
    for k in range(u.size - 1):
        p[k + 1] = fade * p[k] + (1.0 - fade) * (gust[k] - effect / damping * u[k])
    return p


def test_instruments_take_out_the_bias_of_gusts_that_cause_a_part_of_the_motion():
    rng, time_s, truth = np.random.default_rng(0), np.arange(1000) * 0.02, np.array([-2.0, -10.0])
    u = anser.multisine(0.02, (0.1, 1.5), 20.0)(time_s)
    # the motion of a model with other parameters follows the commanded motion and has no gusts
    instruments = {"p": roll_rate(u, np.zeros(1000), -1.5, -8.0)}
    errors, covered, plain = [], [], []
    for _ in range(60):
        gust = lfilter([0.18], [1.0, -0.82], 0.5 * rng.normal(size=1000))  # up to 10 rad/s, as over a span at 120 m/s
        p = roll_rate(u, gust, *truth)
        z = truth[0] * (p - gust) + truth[1] * u
        estimate = regress_spectra({"p": p, "u": u}, z, time_s, instruments=instruments)
        errors.append(estimate.values - truth)
        low, high = estimate.interval().T
        covered.append((low < truth) & (truth < high))
        plain.append(regress_spectra({"p": p, "u": u}, z, time_s).values - truth)
    assert abs(np.mean(plain, axis=0)[0]) > 0.1 * abs(truth[0])
    # four standard errors of the mean
    assert np.all(np.abs(np.mean(errors, axis=0)) < 4.0 * np.std(errors, axis=0) / np.sqrt(60.0))
    assert 0.90 <= np.mean(covered) <= 0.99


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frequencies_hz": [0.0, 0.1, 0.2, 0.3]}, "frequencies_hz: arrived .*above 0 and below 25 Hz"),
        ({"frequencies_hz": [0.1, 0.2, 0.3]}, "arrived 3 for 3 parameters"),
        ({"held": ["rudder"]}, "held: arrived .*rudder.*; expected names of regressors: alpha, q, elevator"),
        ({"noise": {"alpha": 5.0}}, "no excitation of alpha"),
    ],
)
def test_transforms_that_tell_nothing_are_refused(options, message):
    record = short_period(10.0)
    alpha, q = record.states.T
    with pytest.raises(ValueError, match=message):
        regress_spectra({"alpha": alpha, "q": q, "elevator": record.inputs}, alpha, record.time_s, **options)
