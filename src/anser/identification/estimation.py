"""Solution of the equations of a model by the estimators, and the fit of the model over time."""

import dataclasses
import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.identification.dynamic_models import DynamicModel, Parameters, make_manoeuvre
from anser.identification.estimates import Estimate, autocovariances
from anser.identification.filter_error import estimate_filter_error
from anser.identification.frequency_regression import regress_spectra
from anser.identification.models import Equation, ModelData, linear_series, predict
from anser.identification.output_error import estimate_output_error
from anser.identification.regression import regress
from anser.identification.smoothing import smooth

METHODS = ("frequency", "equation-error", "output-error", "filter-error")
"""Methods of `anser.identify`; the last two integrate a linear model."""
_PROCESS_NOISE = 1e-6
"""Start value of the spectral density of the noise in the rates of a linear model."""
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
        diagonal = np.diagonal(covariances, axis1=1, axis2=2)
        return diagonal / diagonal[0]


def estimate(data: ModelData, method: str, frequency_max_hz: float = _BAND_HZ) -> tuple[Estimate, ...]:
    """Estimate the parameters of each equation; names of the parameters as in `CL_alpha`, constants as in `CL0`.

    Parameters
    ----------
    data
        Record, arranged for a model.
    method
        `frequency`: regression of Fourier transforms, without differentiation of noise; `equation-error`: regression
        in time, of response and regressors that pass the same smoothing filter. For linear models also `output-error`,
        maximum likelihood of the integrated responses, and `filter-error`, the same with noise in the rates, for
        turbulent air; both start from `frequency`, and give one estimate for all equations.
    frequency_max_hz
        Highest frequency of the regression of Fourier transforms, Hz.

    Raises
    ------
    ValueError
        A method of linear models with the model `derivatives`, or an error of the estimator: no excitation, collinear
        regressors, no convergence.
    """
    if method in METHODS[2:]:
        return (_integrate(data, method, estimate(data, "frequency", frequency_max_hz)),)
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
            white_covariance=None,
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
        white_covariance=None,
        variance_inflation=inflation,
    )


@functools.cache
def _linear_dynamics(states: tuple[str, ...], prefixes: tuple[str, ...], inputs: tuple[str, ...]) -> DynamicModel:
    def equations(x: Array, u: Array, theta: Parameters) -> tuple[Array, Array]:
        values = [*x, *u[: len(inputs)]]
        rates = [
            sum(theta[f"{prefix}_{name}"] * value for name, value in zip((*states, *inputs), values, strict=True))
            + theta[f"{prefix}0"]
            for prefix in prefixes
        ]
        return jnp.stack(rates) + u[len(inputs) :], x

    return DynamicModel(equations, states, (*inputs, *(f"known_{name}" for name in states)), states)


def _integrate(data: ModelData, method: str, start: tuple[Estimate, ...]) -> Estimate:
    """Estimate the parameters of a linear model from its integrated responses."""
    first = data.equations[0]
    if not first.is_rate:
        raise ValueError(f"method: arrived {method} with the model derivatives; expected frequency or equation-error")
    linear = linear_series(data)
    prefixes = tuple(equation.prefix for equation in data.equations)
    model = _linear_dynamics(linear.names, prefixes, linear.inputs)
    inputs = np.hstack([linear.u, linear.known])
    manoeuvre = make_manoeuvre(model, data.record.time_s, inputs, linear.states, linear.states[0], held=False)
    values = {name: value for solution in start for name, value in solution.parameters.items()}
    constants = np.mean(linear.known, axis=0)
    values |= {f"{prefix}0": -float(value) for prefix, value in zip(prefixes, constants, strict=True)}
    for solution, prefix in zip(start, prefixes, strict=True):  # in the mean over the record the rates vanish
        means = np.mean(np.stack(list(first.regressors.values()), axis=1), axis=0)
        values[f"{prefix}0"] -= float(solution.values @ means)
    options = {"initial_states": linear.names, "noise": [max(first.noise[name], 1e-6) for name in linear.names]}
    if method == "output-error":
        return estimate_output_error(model, manoeuvre, values, **options)
    process = dict.fromkeys(linear.names, _PROCESS_NOISE)
    return estimate_filter_error(model, manoeuvre, values, process, **options)


def fit_model(data: ModelData, parameters: dict[str, float]) -> Fit:
    """Return the fit of a model with given parameters over a record."""
    return Fit(data.record.time_s, *predict(data, parameters))
