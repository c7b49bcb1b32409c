"""Solution of the equations of a model by the estimators, and the fit of the model over time."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from anser.identification.estimates import Estimate, autocovariances
from anser.identification.frequency_regression import regress_spectra
from anser.identification.models import Equation, ModelData, predict
from anser.identification.regression import regress
from anser.identification.smoothing import smooth

METHODS = ("frequency", "equation-error")
_BAND_HZ = 1.5
"""Highest frequency of regressions, Hz, and lowest in periods per record: rigid-body motion of an aircraft."""


class Fit(NamedTuple):
    """Responses of a model against the measured responses over time."""

    time_s: Float[np.ndarray, " sample"]
    responses: tuple[str, ...]
    measured: Float[np.ndarray, "sample response"]
    modelled: Float[np.ndarray, "sample response"]

    @property
    def residuals(self) -> Float[np.ndarray, "sample response"]:
        """Measured less modelled responses, without their means."""
        residuals = self.measured - self.modelled
        return residuals - np.mean(residuals, axis=0)

    @property
    def r_squared(self) -> Float[np.ndarray, " response"]:
        """Coefficient of determination of each response."""
        errors, spread = self.measured - self.modelled, self.measured - np.mean(self.measured, axis=0)
        return 1.0 - np.sum(errors**2, axis=0) / np.sum(spread**2, axis=0)

    @property
    def theil_inequality(self) -> Float[np.ndarray, " response"]:
        """Theil's inequality coefficient of each response, about the measured mean: 0 perfect, 1 none."""
        means = np.mean(self.measured, axis=0)
        parts = (self.measured - self.modelled, self.measured - means, self.modelled - means)
        error, measured, modelled = (np.sqrt(np.sum(part**2, axis=0)) for part in parts)
        return error / (measured + modelled)

    @property
    def autocorrelation(self) -> Float[np.ndarray, "lag response"]:
        """Autocorrelation of the residuals up to a fifth of the record."""
        covariances = autocovariances(self.residuals, self.time_s.size // 5)
        return covariances / covariances[0]


def estimate(data: ModelData, method: str, frequency_max_hz: float = _BAND_HZ) -> tuple[Estimate, ...]:
    """Estimate the parameters of each equation; names of the parameters as in `CL_alpha`, constants as in `CL0`.

    Parameters
    ----------
    data
        Record, arranged for a model.
    method
        `frequency`: regression of Fourier transforms, without differentiation of noise; `equation-error`: regression
        in time, of response and regressors that pass the same smoothing filter.
    frequency_max_hz
        Highest frequency of the regression of Fourier transforms, Hz.
    """
    return tuple(_solve(data, equation, method, frequency_max_hz) for equation in data.equations)


def _solve(data: ModelData, equation: Equation, method: str, frequency_max_hz: float) -> Estimate:
    time_s, regressors, noise = data.record.time_s, equation.regressors, equation.noise
    if method == "frequency":
        duration = float(time_s[-1] - time_s[0])
        harmonics = np.arange(1, int(min(frequency_max_hz, 0.4 / data.record.step_s) * duration) + 1)
        solution = regress_spectra(
            regressors,
            equation.values,
            time_s,
            harmonics / duration,
            differentiate=equation.is_rate,
            noise=noise,
        )
    else:
        smoothed = smooth(np.stack([equation.values, *regressors.values()]), data.record.step_s, shared=True)
        values = smoothed.rate[0] if equation.is_rate else smoothed.values[0]
        solution = regress(dict(zip(regressors, smoothed.values[1:], strict=True)), values, time_s)
    return _with_constant(equation, solution)


def _with_constant(equation: Equation, solution: Estimate) -> Estimate:
    """Return the estimate with the names of the model; of a coefficient, with its value at zero arguments.

    The constant follows from the means of response and regressors. Powers of the angle of attack were taken from its
    mean, where they are nearly uncorrelated, and become powers from zero.
    """
    count = len(equation.regressors)
    names = tuple(f"{equation.prefix}_{name}" for name in equation.regressors)
    slopes, covariance = solution.values[:count], solution.covariance[:count, :count]
    inflation = solution.variance_inflation[:count]
    if equation.is_rate:
        return dataclasses.replace(
            solution,
            responses=(f"{equation.response} rate",),
            names=names,
            values=slopes,
            covariance=covariance,
            variance_inflation=inflation,
        )
    X = np.stack(list(equation.regressors.values()), axis=1)
    means = np.mean(X, axis=0)
    scatter = np.var(equation.values - X @ slopes, ddof=count + 1) / len(X)
    constant = float(np.mean(equation.values) - means @ slopes)
    values = np.append(slopes, constant)
    joint = np.block([[covariance, -(covariance @ means)[:, None]], [-(means @ covariance)[None], np.zeros((1, 1))]])
    joint[-1, -1] = means @ covariance @ means + scatter
    inflation = np.append(inflation, joint[-1, -1] / scatter)
    if "alpha2" in equation.regressors:
        mean, keys = float(np.mean(equation.regressors["alpha"])), list(equation.regressors)
        shift = np.eye(count + 1)
        if "alpha" in keys:
            shift[keys.index("alpha"), keys.index("alpha2")] = -2.0 * mean
        shift[-1, keys.index("alpha2")] = mean**2
        values, joint = shift @ values, shift @ joint @ shift.T
    return dataclasses.replace(
        solution,
        responses=(equation.response,),
        names=(*names, f"{equation.prefix}0"),
        values=values,
        covariance=joint,
        variance_inflation=inflation,
    )


def fit_model(data: ModelData, parameters: dict[str, float]) -> Fit:
    """Return the fit of a model with given parameters over a record."""
    return Fit(data.record.time_s, *predict(data, parameters))
