"""Regression in the frequency domain, in real time: coefficients of linear equations from recursive Fourier transforms.

Source: E. A. Morelli, "Real-time parameter estimation in the frequency domain", J. Guidance 23(5), 2000. This module
differs in three points (docs/theory/identification.md):

- An input that is constant over a sampling period counts at the middle of the period.
- The transform of a time derivative includes terms for both ends of the record.
- The covariance follows from the measurement noise, which is correlated between neighbouring frequencies.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from anser.shapes import Integer, Scalar, ScalarLike, Vector

_END_SAMPLES = 10
"""Number of samples at each end of a record; the least-squares line through them gives the end value of a signal."""
_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])
"""Weights of the third difference; its variance is 20 s^2 for white noise of variance s^2, 0 for a straight line."""


def _line_weights() -> np.ndarray:
    """Return the weights (10,) by which 10 samples give the value of the least-squares line at the first sample."""
    distance = np.arange(_END_SAMPLES) - 0.5 * (_END_SAMPLES - 1)
    return 1.0 / _END_SAMPLES + distance[0] * distance / np.sum(distance**2)


class FourierSums(eqx.Module):
    """Running Fourier transforms of the signals and inputs of a record: weighted sums of samples times exp(-i w t)."""

    count: Integer  #: Number of sampling periods since the first sample; -1 before the first sample.
    phasor: Complex[Array, " frequency"]  #: exp(-i w t) at the last sample, for each angular frequency w.
    signals: Complex[Array, "signal frequency"]  #: Transforms of the signals.
    inputs: Complex[Array, "input frequency"]  #: Transforms of the inputs.
    first: Float[Array, "sample signal"]  #: First 10 samples of the signals; index 0 is the first sample.
    last: Float[Array, "sample signal"]  #: Last 10 samples of the signals; index 0 is the last sample.
    noise: Float[Array, " signal"]  #: Sum of the squared third differences of each signal.


class RegressionEstimate(eqx.Module):
    """Result of `FourierRegression.estimate`; values and covariance are NaN for a record of fewer than 20 samples."""

    values: Float[Array, "equation regressor"]  #: Estimated coefficients of each equation.
    covariance: Float[Array, "equation regressor regressor"]  #: Covariance of the coefficients, times max(misfit, 1).
    condition: Scalar  #: Condition number of the matrix of the regressors, each scaled to length 1.
    misfit: Float[Array, " equation"]  #: Energy of the residuals divided by the energy that noise explains.

    @property
    def standard_errors(self) -> Float[Array, "equation regressor"]:
        """Standard errors of the coefficients."""
        return jnp.sqrt(jnp.diagonal(self.covariance, axis1=-2, axis2=-1))


class FourierRegression(eqx.Module):
    """Real-time estimation of the coefficients of linear equations, response = sum of (coefficient * regressor).

    Biases and trim values have no effect, because the frequencies do not include 0.
    """

    frequencies: Vector  #: Angular frequencies of the transforms, rad/s; must be positive.
    forgetting_time: Scalar  #: Time constant of exponential forgetting, s; infinite: all samples have equal weight.
    responses: tuple[int, ...] = eqx.field(static=True)  #: For each equation, index of the signal that is the response.
    #: Indices of the signals that are regressors of every equation. The inputs follow as further regressors.
    regressors: tuple[int, ...] = eqx.field(static=True)
    #: True: the response is the time derivative of that signal, as in a state equation; False: the signal itself.
    differentiate: bool = eqx.field(static=True, default=True)
    #: True: the record starts in steady flight, and the signals are deviations from that flight.
    steady_start: bool = eqx.field(static=True, default=False)

    def init(self, signals: int, inputs: int) -> FourierSums:
        """Return the sums before the first sample; `signals` and `inputs` are numbers of signals and inputs."""
        size = self.frequencies.shape[0]
        dtype = jnp.result_type(self.frequencies.dtype, jnp.complex64)
        return FourierSums(
            count=jnp.asarray(-1, jnp.int32),
            phasor=jnp.ones(size, dtype),
            signals=jnp.zeros((signals, size), dtype),
            inputs=jnp.zeros((inputs, size), dtype),
            first=jnp.zeros((_END_SAMPLES, signals)),
            last=jnp.zeros((_END_SAMPLES, signals)),
            noise=jnp.zeros(signals),
        )

    def advance(self, sums: FourierSums, signals: Vector, inputs: Vector, step: ScalarLike) -> FourierSums:
        """Return the sums with a further sample.

        `inputs` must be the constant values over the sampling period `step` (s) before this sample. The inputs of the
        first sample have no effect.
        """
        count = sums.count + 1
        is_first = count == 0
        turn = jnp.exp(-1j * self.frequencies * step)
        phasor = jnp.where(is_first, sums.phasor, sums.phasor * turn)
        memory = jnp.exp(-step / self.forgetting_time)
        middle = phasor * jnp.exp(0.5j * self.frequencies * step)
        held = jnp.where(is_first, 0.0, step * jnp.sqrt(memory)) * inputs
        weight = jnp.where(is_first, 0.5, 1.0) * step
        last = jnp.concatenate([signals[None], sums.last[:-1]])
        is_missing = jnp.arange(_END_SAMPLES)[:, None] == jnp.minimum(count, _END_SAMPLES)
        difference = jnp.sum(_DIFFERENCE[:, None] * last[: len(_DIFFERENCE)], axis=0)
        return FourierSums(
            count=count,
            phasor=phasor,
            signals=memory * sums.signals + (weight * signals)[:, None] * phasor[None, :],
            inputs=memory * sums.inputs + held[:, None] * middle[None, :],
            first=jnp.where(is_missing, signals[None, :], sums.first),
            last=last,
            noise=sums.noise + jnp.where(count >= len(_DIFFERENCE) - 1, difference**2, 0.0),
        )

    def estimate(self, sums: FourierSums, step: ScalarLike) -> RegressionEstimate:
        """Return the estimated coefficients for the record so far; `step` is the sampling period, s."""
        ends = _EndWeights(self, sums, step)
        transforms = sums.signals + ends.sum_correction(sums)
        responses = jnp.stack([transforms[k] for k in self.responses])
        if self.differentiate:
            rate, end_term = self._rate_factor, ends.end_term(sums)
            responses = rate[None, :] * responses + jnp.stack([end_term[k] for k in self.responses])
        regressors = jnp.concatenate([jnp.stack([transforms[k] for k in self.regressors]), sums.inputs])
        scale = jnp.sqrt(jnp.sum(jnp.abs(regressors) ** 2, axis=1))
        scaled = regressors / jnp.where(scale > 0.0, scale, 1.0)[:, None]
        information = jnp.real(scaled.conj() @ scaled.T)
        eigenvalues, axes = jnp.linalg.eigh(information)
        floor = jnp.finfo(eigenvalues.dtype).eps * len(eigenvalues)
        inverse = (axes / jnp.maximum(eigenvalues, floor)[None, :]) @ axes.T
        coefficients = jnp.real(responses @ scaled.conj().T) @ inverse
        residuals = responses - coefficients @ scaled
        variances = sums.noise / (jnp.maximum(sums.count - 2, 1) * np.sum(_DIFFERENCE**2))
        factors = coefficients / jnp.where(scale > 0.0, scale, 1.0)[None, :]
        projector = _Projector(scaled, inverse)
        covariances, misfits = [], []
        for row, response in enumerate(self.responses):
            covariance, energy = jnp.zeros_like(inverse), jnp.zeros(())
            for signal in sorted({response, *self.regressors}):
                sum_factor = self._sum_factor(factors[row], signal, is_response=signal == response)
                end_factor = 1.0 if self.differentiate and signal == response else 0.0
                projected, rest = projector.noise_covariance(ends.noise(sum_factor, end_factor))
                covariance, energy = covariance + variances[signal] * projected, energy + variances[signal] * rest
            misfit = jnp.sum(jnp.abs(residuals[row]) ** 2) / jnp.maximum(energy, jnp.finfo(energy.dtype).tiny)
            covariances.append(jnp.maximum(misfit, 1.0) * covariance / (scale[:, None] * scale[None, :]))
            misfits.append(misfit)
        is_long = sums.count + 1 >= 2 * _END_SAMPLES
        nan = jnp.asarray(jnp.nan, factors.dtype)
        return RegressionEstimate(
            values=jnp.where(is_long, factors, nan),
            covariance=jnp.where(is_long, jnp.stack(covariances), nan),
            condition=jnp.sqrt(eigenvalues[-1] / jnp.maximum(eigenvalues[0], floor)),
            misfit=jnp.stack(misfits),
        )

    @property
    def _rate_factor(self) -> Complex[Array, " frequency"]:
        """Factor i w - 1 / `forgetting_time`, 1/s: transform(dx/dt) = factor * transform(x) + `end_term`."""
        return 1j * self.frequencies - 1.0 / self.forgetting_time

    def _sum_factor(self, coefficients: Vector, signal: int, *, is_response: bool) -> Complex[Array, " frequency"]:
        """Return the factor by which the transform of a signal's noise enters the residual of an equation.

        `coefficients` are the equation's coefficients; `is_response` is true if the signal is the equation's response.
        """
        factor = jnp.zeros_like(self._rate_factor)
        if is_response:
            factor = factor + (self._rate_factor if self.differentiate else 1.0)
        if signal in self.regressors:
            factor = factor - coefficients[self.regressors.index(signal)]
        return factor


class _Projector(eqx.Module):
    """Matrices that give the coefficients' error due to noise n of the response: inverse Re(conj(regressors) n)."""

    regressors: Complex[Array, "regressor frequency"]  # transforms of the regressors, each scaled to length 1
    inverse: Float[Array, "regressor regressor"]  # inverse of the normal matrix of the scaled regressors

    def noise_covariance(
        self, noise: tuple[Complex[Array, "f f"], Complex[Array, "f f"]]
    ) -> tuple[Float[Array, "regressor regressor"], Scalar]:
        """Return the covariance of the coefficients, and the expected energy of the residuals.

        `noise` is the pair of covariance E[n n*] and pseudo-covariance E[n n'] of the noise n at the frequencies.
        """
        hermitian, symmetric = noise
        R, M = self.regressors.conj(), self.inverse
        # Re(R n) = (R n + conj(R n)) / 2
        real_covariance = 0.5 * jnp.real(R @ hermitian @ R.conj().T + R @ symmetric @ R.T)
        covariance = M @ real_covariance @ M
        # |n - R' M Re(R n)|^2 = |n|^2 - Re(R n)' M Re(R n), for M is the inverse of Re(R R*)
        return covariance, jnp.real(jnp.trace(hermitian)) - jnp.sum(M * real_covariance)


class _EndWeights:
    """Weights of the first and the last 10 samples of a record in the transforms and in `end_term`."""

    def __init__(self, regression: FourierRegression, sums: FourierSums, step: ScalarLike) -> None:
        self.regression, self.step, self.count = regression, step, sums.count
        self.memory = jnp.exp(-step / regression.forgetting_time)
        self.start_weight = self.memory ** sums.count.astype(regression.frequencies.dtype)
        self.end_phasor, self.line = sums.phasor, jnp.asarray(_line_weights())
        self.start_line = jnp.zeros_like(self.line) if regression.steady_start else self.line

    def sum_correction(self, sums: FourierSums) -> Complex[Array, "signal frequency"]:
        """Return the term that halves the weight of the last sample in every transform (trapezoidal rule)."""
        return -0.5 * self.step * (self.line @ sums.last)[:, None] * self.end_phasor[None, :]

    def end_term(self, sums: FourierSums) -> Complex[Array, "signal frequency"]:
        """Return the end terms x(T) exp(-i w T) - m x(0) of every signal x at every frequency w.

        m is the weight of the first sample after exponential forgetting. x(0) is 0 if `steady_start` is true.
        """
        start = self.start_weight * (self.start_line @ sums.first)[:, None]
        return (self.line @ sums.last)[:, None] * self.end_phasor[None, :] - start

    def noise(
        self, sum_factor: Complex[Array, " frequency"], end_factor: float
    ) -> tuple[Complex[Array, "f f"], Complex[Array, "f f"]]:
        """Return covariance and pseudo-covariance (see `_Projector`) of an equation's noise n at the frequencies.

        n = `sum_factor` * X + `end_factor` * E: X is the transform and E the end term of a white signal of variance 1.
        """
        w, dt, size = self.regression.frequencies, self.step, _END_SAMPLES
        index = jnp.arange(size)
        # the first and the last ten samples, shape (sample, frequency)
        start_phases = jnp.exp(-1j * w[None, :] * dt * index[:, None])
        start_weights = self.start_weight * self.memory ** (-index.astype(w.dtype))
        trapezoid = jnp.where(index == 0, 0.5, 1.0)
        first = sum_factor[None, :] * dt * (trapezoid * start_weights)[:, None] * start_phases
        first = first - end_factor * self.start_weight * self.start_line[:, None]
        end_phases = self.end_phasor[None, :] * jnp.exp(1j * w[None, :] * dt * index[:, None])
        end_weights = self.memory ** index.astype(w.dtype)
        end_line = self.line[:, None] * self.end_phasor[None, :]
        last = sum_factor[None, :] * dt * (end_weights[:, None] * end_phases - 0.5 * end_line) + end_factor * end_line
        ends = jnp.concatenate([first, last])
        inner = self.count - 2 * size + 1  # number of samples between the first and the last ten
        products = sum_factor[:, None] * sum_factor.conj()[None, :] * self._inner_sum(w[:, None] - w[None, :], inner)
        pseudo = sum_factor[:, None] * sum_factor[None, :] * self._inner_sum(w[:, None] + w[None, :], inner)
        return products + ends.T @ ends.conj(), pseudo + ends.T @ ends

    def _inner_sum(self, w: Float[Array, "f f"], number: Integer) -> Complex[Array, "f f"]:
        """Return the sum of weight^2 exp(-i w t) over the `number` samples between the first and the last ten."""
        dt, size = self.step, _END_SAMPLES
        # weight^2 = dt^2 memory^(2 (count - n)) for n = size ... count - size
        ratio = jnp.exp(-1j * w * dt) / self.memory**2
        is_unity = jnp.abs(1.0 - ratio) < 1e-9
        steps = jnp.maximum(number, 0).astype(w.dtype)
        total = jnp.where(is_unity, steps, (1.0 - ratio**steps) / jnp.where(is_unity, 1.0, 1.0 - ratio))
        leading = self.start_weight**2 * jnp.exp(-1j * w * dt * size) / self.memory ** (2 * size)
        return dt**2 * leading * total
