"""Global Fourier smoothing: a known signal with known noise, its derivative, and the limits of what is accepted."""

import numpy as np
import pytest

from anser.identification.smoothing import integrate, smooth

STEP_S = 0.02
TIME = np.arange(0.0, 20.0, STEP_S)
SIGNAL = np.sin(2.0 * TIME) * np.exp(-0.1 * TIME) + 0.3 * np.sin(5.0 * TIME) + 0.1 * TIME
RATE = (2.0 * np.cos(2.0 * TIME) - 0.1 * np.sin(2.0 * TIME)) * np.exp(-0.1 * TIME) + 1.5 * np.cos(5.0 * TIME) + 0.1


@pytest.mark.parametrize("sigma", [1e-3, 1e-2, 1e-1])
def test_noise_is_measured_and_removed(sigma):
    noise = sigma * np.random.default_rng(1).standard_normal((20, TIME.size))
    smoothed = smooth(SIGNAL + noise, STEP_S)
    # 400 coefficients and 20 rows: the mean of the estimates has a standard error of 0.8 %
    assert np.mean(smoothed.noise) == pytest.approx(sigma, rel=0.04)
    # a signal of bandwidth 5 rad/s needs a sixth of the band at most: sqrt(1/6) of the noise remains
    assert np.std(smoothed.values - SIGNAL) < 0.42 * sigma
    # central differences have an error of sigma / (sqrt(2) step); the filter must divide it at least by 4
    assert np.std(smoothed.rate - RATE) < 0.25 * sigma / (np.sqrt(2.0) * STEP_S)


def test_a_clean_signal_is_kept_and_differentiated_far_better_than_by_differences():
    smoothed = smooth(SIGNAL, STEP_S)
    np.testing.assert_allclose(smoothed.values, SIGNAL, rtol=0.0, atol=1e-12)
    inner = slice(25, -25)  # the odd continuation bends the derivative within half a second of the ends
    differences = np.gradient(SIGNAL, STEP_S)
    assert np.abs(smoothed.rate - RATE)[inner].max() < 0.05 * np.abs(differences - RATE)[inner].max()
    assert np.abs(smoothed.rate - RATE).max() < 0.03


def test_white_noise_alone_leaves_next_to_nothing():
    noise = np.random.default_rng(2).standard_normal((20, TIME.size))
    assert np.std(smooth(noise, STEP_S).values) < 0.3


def test_the_integral_inverts_the_derivative():
    integral = integrate(RATE, STEP_S)
    # trapezoidal rule: step^2 / 12 times the change of the second derivative, below 1e-3
    np.testing.assert_allclose(integral, SIGNAL - SIGNAL[0], rtol=0.0, atol=1e-3)


def test_short_and_unfinished_histories_are_refused():
    with pytest.raises(ValueError, match="arrived 10 samples; expected at least 16"):
        smooth(np.zeros(10), STEP_S)
    with pytest.raises(ValueError, match="not finite"):
        smooth(np.array([*np.zeros(20), np.nan]), STEP_S)
