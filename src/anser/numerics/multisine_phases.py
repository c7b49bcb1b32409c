"""Phases with which a sum of harmonics has a small range of values, for multisine inputs of flight tests."""

import functools
from collections.abc import Callable

import numpy as np


@functools.lru_cache(maxsize=256)
def multisine_phases(harmonics: tuple[int, ...], amplitudes: tuple[float, ...]) -> tuple[float, ...]:
    """Return phases (rad) that give a sum of cosines a small relative peak factor.

    `harmonics` are the rising numbers of periods of each cosine in the period of the sum. The relative peak factor is
    (greatest - least value) / (2 sqrt(2) root mean square); 1 for a sine, 1.0 to 1.15 for the result. Equal arguments
    always give equal phases. If the number of cosines times the greatest harmonic exceeds 3600, the phases are
    Schroeder's, with a peak factor of 1.2 to 1.5. Sources: M. R. Schroeder, IEEE Trans. Information Theory 16(1), 1970;
    E. A. Morelli, AIAA-2003-5371 (peak factor).
    """
    k, A = np.asarray(harmonics, dtype=float), np.asarray(amplitudes)
    count = k.size
    if count * k[-1] > _OPTIMIZED_MAX:
        powers = A**2 / np.sum(A**2)
        return tuple((-2.0 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(powers)[:-1])])).tolist())
    angles = 2.0 * np.pi * np.outer(np.arange(_OPTIMIZED_SAMPLES * int(k[-1])) / (_OPTIMIZED_SAMPLES * int(k[-1])), k)
    scale = A / np.sqrt(0.5 * np.sum(A**2))
    cosines, sines = np.cos(angles) * scale, np.sin(angles) * scale

    # einsum: of matrices this small, the threads of a linear algebra library make the products slower
    def total(phases: np.ndarray) -> np.ndarray:
        return np.einsum("tk,k->t", cosines, np.cos(phases)) - np.einsum("tk,k->t", sines, np.sin(phases))

    def smooth_range(phases: np.ndarray, sharpness: float) -> tuple[float, np.ndarray]:
        """Return the range of the sum's values, smoothed less for greater `sharpness`, and its derivatives."""
        u, cosine, sine = total(phases), np.cos(phases), np.sin(phases)
        high, low = np.exp(sharpness * (u - u.max())), np.exp(-sharpness * (u - u.min()))
        value = np.ptp(u) + (np.log(high.sum()) + np.log(low.sum())) / sharpness
        weights = high / high.sum() - low / low.sum()
        gradient = sine * np.einsum("t,tk->k", weights, cosines) + cosine * np.einsum("t,tk->k", weights, sines)
        return value, -gradient

    number = np.arange(1, count + 1)
    starts = [-np.pi * number * (number - 1) / count]
    starts += list(np.random.default_rng(0).uniform(-np.pi, np.pi, (_RANDOM_STARTS, count)))
    results = []
    for start in starts:
        phases = start
        for sharpness in _SHARPNESS:
            phases = _minimize(functools.partial(smooth_range, sharpness=sharpness), phases)
        results.append((np.ptp(total(phases)), phases))
    return tuple(min(results, key=lambda result: result[0])[1].tolist())


def sum_of_harmonics(
    harmonics: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray, periods: np.ndarray
) -> np.ndarray:
    """Return the values of a sum of cosines over one period, with phases in rad.

    `harmonics` are the rising numbers of periods of the cosines in the period of the sum. `periods` must be equally
    spaced times from 0 to 1 inclusive, in units of the period.
    """
    if harmonics.size * harmonics[-1] <= _OPTIMIZED_MAX:
        return np.sum(amplitudes * np.cos(2.0 * np.pi * periods[:, None] * harmonics + phases), axis=1)
    count = periods.size - 1
    spectrum = np.zeros(count // 2 + 1, dtype=complex)
    spectrum[harmonics] = 0.5 * count * amplitudes * np.exp(1j * phases)
    values = np.fft.irfft(spectrum, count)
    return np.append(values, values[0])


def _minimize(function: Callable[[np.ndarray], tuple[float, np.ndarray]], start: np.ndarray) -> np.ndarray:
    """Return the arguments at a local minimum (BFGS) of a function that returns value and gradient."""
    x, (value, gradient) = start, function(start)
    inverse_hessian = np.eye(x.size) * min(1.0, 0.3 / max(float(np.abs(gradient).max()), 1e-12))
    for _ in range(_ITERATIONS):
        direction = -np.einsum("jk,k->j", inverse_hessian, gradient)
        slope = float(np.sum(direction * gradient))
        if slope > -_SLOPE_MIN:
            break
        for step in _STEPS:
            new_x = x + step * direction
            new_value, new_gradient = function(new_x)
            if new_value <= value + 1e-4 * step * slope:
                break
        else:
            break
        s, y = new_x - x, new_gradient - gradient
        curvature = float(np.sum(s * y))
        if curvature > 1e-14:
            H_y = np.einsum("jk,k->j", inverse_hessian, y)
            ratio = (1.0 + float(np.sum(y * H_y)) / curvature) / curvature
            inverse_hessian = inverse_hessian + ratio * np.outer(s, s)
            inverse_hessian -= (np.outer(H_y, s) + np.outer(s, H_y)) / curvature
        x, value, gradient = new_x, new_value, new_gradient
    return x


_ITERATIONS, _SLOPE_MIN, _STEPS = 200, 1e-10, tuple(0.5**k for k in range(20))
_OPTIMIZED_SAMPLES = 16
"""Number of samples per period of the highest harmonic in the optimization."""
_OPTIMIZED_MAX = 3600
"""Greatest product of the count of harmonics and the greatest harmonic number for which phases are optimized."""
_RANDOM_STARTS, _SHARPNESS = 4, (4.0, 16.0, 64.0, 256.0)
