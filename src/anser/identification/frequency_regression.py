"""Equation error in the frequency domain: least squares on finite Fourier transforms of a record."""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Complex, Float
from scipy.optimize import nnls

from anser.identification.estimates import Estimate, collinearity
from anser.identification.regression import prepare_regression, require_signal, white_variance

Transform = Complex[np.ndarray, "frequency sample"]
RealMatrix = Float[np.ndarray, "part sample"]
"""Matrix with the real parts at all frequencies as first rows, then the imaginary parts."""
END_SAMPLES = 10
"""Number of samples of the straight line that gives the value of a signal at start or end of the record."""


class FourierTransforms(NamedTuple):
    """Matrices that turn the samples of a record into finite Fourier transforms, one row for each frequency.

    `signal` is for a sampled signal, `held` for an input that is constant over each step, `derivative` for the time
    derivative of a sampled signal.
    """

    signal: Transform
    held: Transform
    derivative: Transform


def fourier_transforms(
    time_s: Float[np.ndarray, " sample"],
    frequencies_hz: Float[np.ndarray, " frequency"],
    *,
    hold: str = "following",
    steady_start: bool = False,
    corrected: bool = True,
) -> FourierTransforms:
    """Return the matrices of finite Fourier transforms for a uniformly sampled record of duration T.

    If a signal x has the transform x~, the derivative of x has the transform i w x~ + x(T) exp(-i w T) - x(0). The
    values x(0) and x(T) come from straight lines through the samples at the ends of the record (theory,
    identification).

    Parameters
    ----------
    time_s
        Times, s, with equal steps.
    frequencies_hz
        Frequencies, Hz.
    hold
        `following`: a held input acts over the step after its sample. `preceding`: a held input acts over the step
        before.
    steady_start
        True: signals must be perturbations from steady flight, zero at the start. False: the mean is subtracted from
        every signal and from the derivative.
    corrected
        True: values at the ends and the half step of held inputs are included. False: plain sums as published in 2000
        (E. A. Morelli, J. Guidance 23(5)), without these terms; `steady_start` has no effect.
    """
    count, step = time_s.size, float(time_s[1] - time_s[0])
    omega = 2.0 * np.pi * np.asarray(frequencies_hz, dtype=float)[:, None]
    t = (time_s - time_s[0])[None, :]
    waves = np.exp(-1j * omega * t) * step
    if not corrected:
        return FourierTransforms(waves, waves, 1j * omega * waves)
    first, last = _end_values(count)
    end = np.exp(-1j * omega * t[0, -1])
    signal = waves - 0.5 * step * (first + end * last)
    derivative = 1j * omega * signal + end * last - first
    sign = {"following": -1.0, "preceding": 1.0}[hold]
    held = waves * np.exp(0.5j * sign * omega * step)
    held[:, -1 if hold == "following" else 0] = 0.0  # its step is outside the record
    if steady_start:
        signal, derivative = signal + 0.5 * step * first, derivative + (1.0 + 0.5j * omega * step) * first
        return FourierTransforms(signal, held, derivative)
    mean = (step - 0.5 * step * (first + last)) / t[0, -1]
    held_mean = np.where(held[0] == 0.0, 0.0, 1.0 / (count - 1))[None, :]
    signal_of_1, held_of_1 = (np.sum(matrix, axis=1, keepdims=True) for matrix in (signal, held))
    return FourierTransforms(
        signal - signal_of_1 * mean, held - held_of_1 * held_mean, derivative - signal_of_1 * (last - first) / t[0, -1]
    )


def _end_values(count: int) -> tuple[Float[np.ndarray, "1 sample"], Float[np.ndarray, "1 sample"]]:
    """Return the weights of the samples in the start value and in the end value of a series, shape (1, sample) each.

    The values are those of straight lines through the first and the last `END_SAMPLES` samples.
    """
    number = min(END_SAMPLES, count)
    k = np.arange(number) - 0.5 * (number - 1)
    line = 1.0 / number - 0.5 * (number - 1) * k / np.sum(k**2)
    first, last = np.zeros((1, count)), np.zeros((1, count))
    first[0, :number], last[0, -number:] = line, line[::-1]
    return first, last


def regress_spectra(
    regressors: Mapping[str, ArrayLike],
    response: ArrayLike,
    time_s: ArrayLike,
    frequencies_hz: ArrayLike | None = None,
    *,
    response_name: str = "response",
    differentiate: bool = False,
    held: Collection[str] = (),
    hold: str = "following",
    steady_start: bool = False,
    noise: Mapping[str, float] | None = None,
    instruments: Mapping[str, Float[np.ndarray, " sample"]] | None = None,
    corrected: bool = True,
) -> Estimate:
    """Estimate the parameters of a linear equation in the frequency domain, by least squares on Fourier transforms.

    theta = Re(W* X)^-1 Re(W* z), with the transforms X of the regressors and z of the response; * is the conjugate
    transpose. W is X with instrumental variables in place of their regressors. No constant term is estimated. Source:
    E. A. Morelli, *Real-time parameter estimation in the frequency domain*, J. Guidance 23(5), 2000; covariance:
    theory, identification.

    Parameters
    ----------
    regressors, response, time_s, response_name, noise
        See `anser.identification.regression.prepare_regression`; `time_s` is required.
    frequencies_hz
        Frequencies, Hz, above 0; None: the harmonics of the record from 0.1 to 1.5 Hz.
    differentiate
        Whether the equation is for the time derivative of the response.
    held
        Names of the regressors that are inputs constant over a step.
    hold, steady_start
        See `fourier_transforms`.
    instruments
        Instrumental variables by the name of the replaced regressor, in any unit: series that correlate with the
        regressor but not with noise and gusts (T. Soderstrom, P. Stoica, *Instrumental Variable Methods for System
        Identification*, 1983).
    corrected
        True: corrected transforms (see `fourier_transforms`), and a covariance for correlated frequencies. False:
        transforms and covariance as published in 2000, s^2 Re(X* X)^-1 for independent frequencies.

    Raises
    ------
    ValueError
        If a series or name is not valid, a regressor is mostly noise, regressors are collinear, there are no more
        frequencies than parameters, or a frequency is not between 0 and half the sampling rate.
    """
    problem = prepare_regression(regressors, response, time_s, response_name=response_name, constant=False, noise=noise)
    if hold not in ("following", "preceding"):
        raise ValueError(f"hold: arrived {hold!r}; expected 'following' or 'preceding'")
    if problem.time_s is None or not set(held) <= set(problem.names):
        raise ValueError(f"held: arrived {sorted(held)}; expected names of regressors: {', '.join(problem.names)}")
    frequencies = _check_frequencies(frequencies_hz, problem.time_s, len(problem.names))
    transforms = fourier_transforms(
        problem.time_s, frequencies, hold=hold, steady_start=steady_start, corrected=corrected
    )
    columns = zip(problem.names, problem.X.T, strict=True)
    X = np.stack([(transforms.held if name in held else transforms.signal) @ x for name, x in columns], axis=1)
    z = (transforms.derivative if differentiate else transforms.signal) @ problem.z
    real_X, real_z = _real_parts(X), _real_parts(z[:, None])[:, 0]
    # excitation is that of the band; noise at higher frequencies does not matter
    gain = np.sum(np.abs(transforms.signal) ** 2)
    noise_power = problem.noise**2 * gain
    white_power = np.maximum(noise_power, white_variance(problem.X) * gain)
    require_signal(problem.names, np.sum(real_X**2, axis=0), white_power)
    checked = collinearity(real_X.T @ real_X - np.diag(noise_power), problem.names)
    W = real_X.copy()
    for k, name in enumerate(problem.names):
        if instruments and name in instruments:
            W[:, k], noise_power[k] = _real_parts(transforms.signal @ instruments[name][:, None])[:, 0], 0.0
    weights = np.linalg.solve(W.T @ real_X - np.diag(noise_power), W.T)
    values = weights @ real_z
    residuals = real_z - real_X @ values
    white_covariance = residuals @ residuals / (frequencies.size - values.size) * weights @ weights.T
    if corrected:
        components = [_real_parts(F) for F in (transforms.signal, transforms.derivative)]
        covariance, freedom = _correlated_covariance(real_X, weights, residuals, components)
    else:
        covariance, freedom = white_covariance, float(frequencies.size - values.size)
    return Estimate(
        method="equation error in the frequency domain",
        names=problem.names,
        values=values,
        covariance=covariance,
        degrees_of_freedom=freedom,
        responses=(f"{response_name} rate" if differentiate else response_name,),
        measured=z[:, None],
        fitted=(X @ values)[:, None],
        sample_points=frequencies,
        condition_number=checked.condition_number,
        variance_inflation=checked.variance_inflation,
        is_spectrum=True,
        white_covariance=white_covariance,
    )


def _check_frequencies(
    frequencies_hz: ArrayLike | None, time_s: Float[np.ndarray, " sample"], parameters: int
) -> Float[np.ndarray, " frequency"]:
    duration, step = time_s[-1] - time_s[0], time_s[1] - time_s[0]
    if frequencies_hz is None:
        harmonics = np.arange(1, int(np.floor(1.5 * duration + 1e-9)) + 1)
        frequencies = harmonics[harmonics >= 0.1 * duration - 1e-9] / duration
    else:
        frequencies = np.asarray(frequencies_hz, dtype=float)
    greatest = 0.5 / step
    if frequencies.ndim != 1 or not np.all((frequencies > 0.0) & (frequencies < greatest)):
        raise ValueError(f"frequencies_hz: arrived {frequencies}; expected numbers above 0 and below {greatest:g} Hz")
    if frequencies.size <= parameters:
        raise ValueError(
            f"frequencies_hz: arrived {frequencies.size} for {parameters} parameters in {duration:g} s; expected more "
            "frequencies than parameters: a longer record, or a list of frequencies"
        )
    return frequencies


def _real_parts(matrix: Complex[np.ndarray, "frequency n"]) -> RealMatrix:
    return np.concatenate([np.real(matrix), np.imag(matrix)])


def _correlated_covariance(
    X: RealMatrix,
    weights: Float[np.ndarray, "parameter part"],
    residuals: Float[np.ndarray, " part"],
    components: list[RealMatrix],
) -> tuple[Float[np.ndarray, "parameter parameter"], float]:
    """Return the covariance of the parameters `weights` @ z, and the degrees of freedom of the residuals.

    The error of the transformed response z is modelled as a sum of white noises in time, each transformed by a matrix
    of `components`. The noise variances are fitted to the squared residuals. Degrees of freedom: F. E. Satterthwaite,
    1946.
    """
    P = np.eye(len(X)) - X @ weights
    shapes = [F @ F.T for F in components]
    powers = [np.sum(np.diag(P @ shape @ P.T).reshape(2, -1), axis=0) for shape in shapes]
    expected, power = np.stack(powers, axis=1), np.sum(residuals.reshape(2, -1) ** 2, axis=0)
    variances = 1.0 / np.sum(expected, axis=0)
    for _ in range(5):
        weight = 1.0 / np.maximum(expected @ variances, 1e-12 * np.max(expected @ variances))
        weighted = weight[:, None] * expected
        scale = np.linalg.norm(weighted, axis=0)
        variances = nnls(weighted / scale, weight * power)[0] / scale
    shape = sum(variance * shape for variance, shape in zip(variances, shapes, strict=True))
    reduced = P @ shape @ P.T
    mean = np.trace(reduced)
    shape = shape * (residuals @ residuals / mean)
    return weights @ shape @ weights.T, float(mean**2 / np.sum(reduced * reduced.T))
