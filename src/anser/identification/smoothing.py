"""Global Fourier smoothing of measured time histories: smoothed values, time derivative, and level of the noise."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.fft import dct, dst

_NOISE_BAND = 0.6
"""Fraction of the highest frequency above which all Fourier coefficients are taken for noise."""
_EXCEEDANCE = 4.0
"""Power of a Fourier coefficient, relative to the power of the noise, above which the coefficient is signal."""
_DECAY = 6
"""Exponent with which the signal's power falls with frequency: amplitudes of a smooth signal fall with the cube."""
_NEGLIGIBLE_NOISE = 1e-5
"""Ratio of noise to the signal's standard deviation below which nothing is filtered, as for simulated data."""
_SAMPLES_MIN = 16


class Smoothed(NamedTuple):
    """Smoothed time histories, their time derivatives (unit per s), and standard deviation of the measurement noise."""

    values: Float[np.ndarray, "*channel sample"]
    rate: Float[np.ndarray, "*channel sample"]
    noise: Float[np.ndarray, "*channel"]


def smooth(values: Float[np.ndarray, "*channel sample"], step_s: float, *, shared: bool = False) -> Smoothed:
    """Smooth and differentiate measured time histories by global Fourier smoothing.

    The straight line through the end values is subtracted, and the remainder is expanded in a sine series. The mean
    power of the upper 40 % of the frequencies is taken as white noise, and the coefficients get Wiener weights. If the
    noise is negligible, nothing is filtered. Source: C. Lanczos, *Applied Analysis* (1956), section 5.11; E. A.
    Morelli, "Estimating Noise Characteristics from Flight Test Data Using Optimal Fourier Smoothing", *J. Aircraft*
    32(4), 1995.

    Parameters
    ----------
    values
        Samples at a constant period, along the last axis; any unit.
    step_s
        Sampling period, s.
    shared
        True: all channels get the same weights, so both sides of an equation are filtered alike. False: each channel
        gets weights from its noise.

    Raises
    ------
    ValueError
        If there are fewer than 16 samples, or a value is not finite.
    """
    values = np.asarray(values, dtype=float)
    count = values.shape[-1]
    if count < _SAMPLES_MIN or not np.all(np.isfinite(values)):
        arrived = f"{count} samples" if count < _SAMPLES_MIN else "values that are not finite"
        raise ValueError(f"smoothing: arrived {arrived}; expected at least {_SAMPLES_MIN} finite samples")
    intervals = count - 1
    position = np.linspace(0.0, 1.0, count)
    ends = _ends(values)
    line = ends[0][..., None] + (ends[1] - ends[0])[..., None] * position
    coefficients = _sine_sums((values - line)[..., 1:-1]) / intervals
    numbers = np.arange(1, intervals)
    power = coefficients**2
    noise_power = np.mean(power[..., int(_NOISE_BAND * numbers.size) :], axis=-1)
    noise = np.sqrt(noise_power * intervals / 2.0)
    weights = _wiener(power, noise_power, numbers)
    clean = noise < _NEGLIGIBLE_NOISE * np.std(values, axis=-1)
    weights = np.where(clean[..., None], 1.0, weights)
    kept = coefficients * (np.min(weights, axis=0) if shared else weights)
    smoothed = line + _padded(0.5 * _sine_sums(kept))
    # derivative of sin(k pi t / T) at all samples, ends included, by a cosine transform
    frequency = np.pi * numbers / (intervals * step_s)
    spectrum = np.concatenate([np.zeros_like(kept[..., :1]), kept * frequency, np.zeros_like(kept[..., :1])], axis=-1)
    rate = 0.5 * np.asarray(dct(spectrum, type=1, axis=-1)) + ((ends[1] - ends[0]) / (intervals * step_s))[..., None]
    return Smoothed(smoothed, rate, noise)


def noise_level(values: Float[np.ndarray, "*channel sample"]) -> Float[np.ndarray, "*channel"]:
    """Return the standard deviation of the white noise of each channel, from the upper 40 % of the frequencies.

    Raises ValueError if there are fewer than 16 samples, or a value is not finite.
    """
    return smooth(values, 1.0).noise


def integrate(rate: Float[np.ndarray, "*channel sample"], step_s: float) -> Float[np.ndarray, "*channel sample"]:
    """Return the time integrals of rates by the trapezoidal rule, 0 at the first sample."""
    increments = 0.5 * step_s * (rate[..., 1:] + rate[..., :-1])
    return np.concatenate([np.zeros_like(rate[..., :1]), np.cumsum(increments, axis=-1)], axis=-1)


def _ends(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of time histories at start and end, from parabolas through the outer 15 samples or fewer.

    If the samples deviate smoothly from the parabola, not by noise, the measured end value is returned instead.
    """
    length = min(15, values.shape[-1] // 2)
    basis = np.vander(np.arange(length, dtype=float), 3)
    projection = basis @ np.linalg.pinv(basis)
    sides = values[..., :length], values[..., ::-1][..., :length]
    ends = []
    for side in sides:
        fitted = side @ projection.T
        error = side - fitted
        # Successive differences of white noise have twice its variance; those of a smooth misfit are small.
        is_noise = np.sum(np.diff(error, axis=-1) ** 2, axis=-1) > np.sum(error**2, axis=-1)
        ends.append(np.where(is_noise, fitted[..., 0], side[..., 0]))
    return ends[0], ends[1]


def _wiener(power: np.ndarray, noise_power: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    width = max(5, numbers.size // 100)
    kernel = np.ones(width) / width
    local = np.apply_along_axis(lambda row: np.convolve(row, kernel, mode="same"), -1, power)
    above = local > _EXCEEDANCE * noise_power[..., None]
    # beyond the first long stretch at the level of the noise, chance exceedances are no signal
    last = np.where(above.all(axis=-1), numbers[-1], numbers[np.argmin(_sustained(above, width), axis=-1)])
    ratio = (_EXCEEDANCE - 1.0) * (last[..., None] / numbers) ** _DECAY
    return ratio / (1.0 + ratio)


def _sustained(above: np.ndarray, width: int) -> np.ndarray:
    """Return for each flag of `above` whether this flag or one of the next `width` - 1 flags is true."""
    padded = np.concatenate([above, np.zeros((*above.shape[:-1], width - 1), dtype=bool)], axis=-1)
    return np.any(np.lib.stride_tricks.sliding_window_view(padded, width, axis=-1), axis=-1)


def _sine_sums(values: np.ndarray) -> np.ndarray:
    """Return 2 sum_i values_i sin(pi k i / n), i, k = 1..n-1; a second transform gives the values times 2 n."""
    return np.asarray(dst(values, type=1, axis=-1))


def _padded(inner: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros_like(inner[..., :1]), inner, np.zeros_like(inner[..., :1])], axis=-1)
