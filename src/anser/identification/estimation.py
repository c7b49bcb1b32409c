"""Estimation of the parameters of a model by a chosen method, and the fit of the model over time."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.signal import lsim

from anser.identification.aircraft_models import recorded_model
from anser.identification.dynamic_models import make_manoeuvre
from anser.identification.estimates import Estimate
from anser.identification.filter_error import estimate_filter_error
from anser.identification.fits import Fit
from anser.identification.frequency_regression import regress_spectra
from anser.identification.models import MODELS, SURFACE_MIN, Equation, ModelData, Series, arrange_linear
from anser.identification.output_error import estimate_output_error
from anser.identification.records import FlightRecord
from anser.identification.regression import regress
from anser.identification.smoothing import smooth

METHODS = ("frequency", "equation-error", "output-error", "filter-error")
"""Methods of `anser.identify`; the last two integrate a linear model over the record."""
_PROCESS_NOISE = 1e-6
"""Start value of the spectral density of the process noise in each rate of a linear model, (unit of the rate)^2 s."""
_PASSES = 2
"""Number of passes that compute the instrumental variables; the second pass uses the variables of the first."""
_JUMP_SHARE = 0.5
"""Change of a deflection between neighbouring samples, relative to its range, above which a caution is given.

Actuators with a time constant of 0.05 s move by 0.33 of a step input within 0.02 s."""
_BAND_HZ = 1.5
"""Default highest frequency of the regression of Fourier transforms, Hz: rigid-body motion of an aircraft."""


def estimate(data: ModelData, method: str, frequency_max_hz: float = _BAND_HZ) -> tuple[Estimate, ...]:
    """Return an estimate for each equation of a model; `output-error` and `filter-error` return one for all equations.

    Parameters are named as in `CL_alpha`, constants as in `CL0`.

    Parameters
    ----------
    data
        Record with the equations of a model, from `arrange`.
    method
        Method of estimation, the last two for linear models only:

        - `frequency`: regression of Fourier transforms; in turbulent air with instrumental variables
        - `equation-error`: regression in time, after the same smoothing filter for response and regressors
        - `output-error`: maximum likelihood of the integrated responses
        - `filter-error`: like `output-error`, with process noise in the rates of the states, for turbulent air
    frequency_max_hz
        Highest frequency of the regression of Fourier transforms, Hz; at most 0.4 of the sampling frequency is used.

    Raises
    ------
    ValueError
        If the method does not suit the model, a regressor is not excited, regressors are collinear, or the search does
        not converge.
    """
    if method in METHODS[2:]:
        return (_integrate(data, method, estimate(data, "frequency", frequency_max_hz)),)
    instruments = _forced_motion(data, frequency_max_hz) if data.is_turbulent and method == "frequency" else {}
    return tuple(_solve(data, equation, method, frequency_max_hz, instruments) for equation in data.equations)


def _forced_motion(data: ModelData, frequency_max_hz: float) -> dict[str, Series]:
    """Return instrumental variables by regressor, which are the responses of linear models to the deflections alone."""
    motion: dict[str, Series] = {}
    for model in MODELS[:2]:
        try:
            arranged = arrange_linear(model, data.record, data.airframe, {})
        except ValueError:  # without excitation of this part of the motion
            continue
        linear = _linear_series(arranged)
        for _ in range(_PASSES):
            parameters: dict[str, float] = {}
            for equation in arranged.equations:
                parameters |= _solve(arranged, equation, "frequency", frequency_max_hz, motion).parameters
            A, B = (linear.matrix(parameters, group) for group in (linear.names, linear.inputs))
            eigenvalues, vectors = np.linalg.eig(A)
            # unstable eigenvalues are reflected into the left half-plane; the response stays bounded
            stable = -np.abs(np.real(eigenvalues)) + 1j * np.imag(eigenvalues)
            A = np.real(vectors @ np.diag(stable) @ np.linalg.inv(vectors))
            time_s = data.record.time_s - data.record.time_s[0]
            states = lsim((A, B, np.eye(len(A)), 0.0 * B), linear.u - linear.u[0], time_s)[1]
            motion |= dict(zip(linear.names, states.T, strict=True))
    if "alpha" in motion:
        motion["alpha2"] = (motion["alpha"] - np.mean(motion["alpha"])) ** 2
    return motion


def _solve(
    data: ModelData, equation: Equation, method: str, frequency_max_hz: float, instruments: Mapping[str, Series]
) -> Estimate:
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
            held=[name for name in held_surfaces(data.record) if name in regressors],
            hold="preceding",
            noise=noise,
            instruments=instruments,
        )
    else:
        smoothed = smooth(np.stack([equation.values, *regressors.values()]), data.record.step_s, shared=True)
        values = smoothed.rate[0] if equation.is_rate else smoothed.values[0]
        solution = regress(dict(zip(regressors, smoothed.values[1:], strict=True)), values, time_s)
    return _with_constant(equation, solution)


def held_surfaces(record: FlightRecord) -> tuple[str, ...]:
    """Return the names of the surfaces whose deflection was constant over the step before each sample.

    If the record is a flight of this package without actuator lag, recorded at every step, the result has all surfaces.
    If not, the result is empty.
    """
    if not _is_without_lag(record) or not np.isclose(record.attributes["step_s"], record.step_s, rtol=1e-6):
        return ()
    return record.surfaces


def jump_cautions(record: FlightRecord, method: str) -> list[str]:
    """Return a list with one caution if surfaces jump between samples; an empty list if not.

    The method `frequency` needs no caution if `held_surfaces` shows that the deflections are constant over each step.
    """
    held = held_surfaces(record)
    if held and method == "frequency":
        return []
    jumping = [name for name in record.surfaces if name in record and _jumps(record[name])]
    if jumping:
        subject = f"{', '.join(jumping)}: a change between neighbouring samples is more than half the range"
    elif _is_without_lag(record):
        subject = "the surfaces moved without lag, in jumps at every step of the flight"
    else:
        return []
    remedy = "deflections measured behind the actuators, and more samples per second"
    if _is_without_lag(record):
        remedy = 'a flight with lag, or the method "frequency" and record_period_s = step_s'
    return [
        f"Caution: {subject}. The deflection between samples is taken as a straight line; damping and control "
        f"derivatives can be off by much more than their intervals. Remedy: {remedy}."
    ]


def _is_without_lag(record: FlightRecord) -> bool:
    return record.attributes.get("actuator_lag") == "no"


def _jumps(deflection: Series) -> bool:
    """Return whether a moved surface changes by over `_JUMP_SHARE` of its range between two neighbouring samples."""
    if np.std(deflection) < SURFACE_MIN:
        return False
    return float(np.max(np.abs(np.diff(deflection)))) > _JUMP_SHARE * float(np.ptp(deflection))


def _with_constant(equation: Equation, solution: Estimate) -> Estimate:
    """Return the estimate with the model's parameter names and, if the response is a coefficient, its constant (`CL0`).

    The regressor `alpha2` is (alpha - mean)^2; the result has the parameters for alpha and alpha^2.
    """
    names = tuple(f"{equation.prefix}_{name}" for name in equation.regressors)
    keys, count = list(equation.regressors), len(names)
    slopes, inflation = solution.values[:count], solution.variance_inflation[:count]
    covariance = solution.covariance[:count, :count]
    response = f"{equation.response} rate" if equation.is_rate else equation.response
    if not equation.is_rate:
        X = np.stack(list(equation.regressors.values()), axis=1)
        means, scatter = np.mean(X, axis=0), np.var(equation.values - X @ slopes, ddof=count + 1) / len(X)
        names, inflation = (
            (*names, f"{equation.prefix}0"),
            np.append(inflation, means @ covariance @ means / scatter + 1.0),
        )
        from_slopes = np.vstack([np.eye(count), -means])
        if "alpha2" in keys:
            alpha, squared = keys.index("alpha"), keys.index("alpha2")
            from_slopes[alpha, squared] = -2.0 * means[alpha]
            from_slopes[-1, squared] += means[alpha] ** 2
        slopes, covariance = from_slopes @ slopes, from_slopes @ covariance @ from_slopes.T
        slopes[-1] += np.mean(equation.values)
        covariance[-1, -1] += scatter
    return dataclasses.replace(
        solution,
        responses=(response,),
        names=names,
        values=slopes,
        covariance=covariance,
        white_covariance=None,
        variance_inflation=inflation,
    )


class _LinearSeries(NamedTuple):
    """Time series of a linear model at the samples of a record.

    `axes` has the first letter of each equation's parameters (Z for `Z_alpha`), `names` and `inputs` name the columns
    of `states` and `u`. `known` is the known part of the states' rates, from gravity and gusts, minus its mean.
    """

    axes: tuple[str, ...]
    names: tuple[str, ...]
    inputs: tuple[str, ...]
    states: Float[np.ndarray, "sample state"]
    u: Float[np.ndarray, "sample input"]
    known: Float[np.ndarray, "sample state"]

    def matrix(self, parameters: Mapping[str, float], arguments: Sequence[str]) -> Float[np.ndarray, "state argument"]:
        """Return the columns `arguments` of the state or input matrix; an absent parameter is zero."""
        return np.array([[parameters.get(f"{axis}_{name}", 0.0) for name in arguments] for axis in self.axes])


def _linear_series(data: ModelData) -> _LinearSeries:
    axes, names = (tuple(getattr(equation, key) for equation in data.equations) for key in ("prefix", "response"))
    regressors = data.equations[0].regressors
    inputs = tuple(name for name in regressors if name not in names)
    states, u = (np.stack([regressors[name] for name in group], axis=1) for group in (names, inputs))
    subtracted = states - np.stack([equation.values for equation in data.equations], axis=1)
    return _LinearSeries(axes, names, inputs, states, u, np.gradient(subtracted, data.record.step_s, axis=0))


_recorded_model = functools.cache(recorded_model)


def _integrate(data: ModelData, method: str, start: tuple[Estimate, ...]) -> Estimate:
    """Return the estimate of a linear model by output error or filter error, from start values by regression."""
    first = data.equations[0]
    if not first.is_rate:
        raise ValueError(f"method: arrived {method} with the model derivatives; expected frequency or equation-error")
    linear = _linear_series(data)
    model = _recorded_model(linear.axes, linear.names, linear.inputs)
    inputs = np.hstack([linear.u, linear.known])
    manoeuvre = make_manoeuvre(model, data.record.time_s, inputs, linear.states, linear.states[0], held=False)
    values = {name: value for estimate in start for name, value in estimate.parameters.items()}
    means, constants = np.mean(np.hstack([linear.states, linear.u]), axis=0), np.mean(linear.known, axis=0)
    for axis, slopes, constant in zip(linear.axes, start, constants, strict=True):
        # in the mean over the record the rates vanish
        values[f"{axis}0"] = -float(constant) - float(slopes.values @ means)
    options = {"initial_states": linear.names, "noise": [max(first.noise[name], 1e-6) for name in linear.names]}
    if method == "output-error":
        return estimate_output_error(model, manoeuvre, values, **options)
    process = dict.fromkeys(linear.names, _PROCESS_NOISE)
    return estimate_filter_error(model, manoeuvre, values, process, **options)


def fit_model(data: ModelData, parameters: Mapping[str, float]) -> Fit:
    """Return the measured responses of a record, and the responses of a model with `parameters` (by name).

    The initial states and constants of a linear model are fitted to the measured responses. For coefficients,
    `parameters` must contain the derivatives of all arguments, estimated or not; an absent derivative is zero.
    """
    responses, time_s = tuple(equation.response for equation in data.equations), data.record.time_s
    if not data.equations[0].is_rate:
        measured = np.stack([equation.values + equation.assumed_part for equation in data.equations], axis=1)
        fitted = np.stack([_coefficient(equation, parameters) for equation in data.equations], axis=1)
        return Fit(responses=responses, measured=measured, fitted=fitted, sample_points=time_s)
    linear = _linear_series(data)
    A, B = (linear.matrix(parameters, group) for group in (linear.names, linear.inputs))
    order, elapsed_s = len(A), time_s - time_s[0]
    C, zero = np.eye(order), np.zeros((order, order))

    def respond(gain: np.ndarray, values: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
        return lsim((A, gain, C, 0.0 * gain), values, elapsed_s, start)[1]

    forced = respond(np.hstack([B, C]), np.hstack([linear.u, linear.known]))
    rest, ones = np.zeros_like(linear.known), np.ones((time_s.size, 1))
    free = [*(respond(zero, rest, e) for e in C), *(respond(e[:, None], ones) for e in C)]
    basis = np.stack([np.ravel(response) for response in free], axis=1)
    weights = np.linalg.lstsq(basis, np.ravel(linear.states - forced), rcond=None)[0]
    fitted = forced + (basis @ weights).reshape(forced.shape)
    return Fit(responses=responses, measured=linear.states, fitted=fitted, sample_points=time_s)


def _coefficient(equation: Equation, parameters: Mapping[str, float]) -> Series:
    """Return a coefficient at each sample: the sum of derivatives times arguments, with alpha^2 for `alpha2`."""
    values = np.full_like(equation.values, parameters.get(f"{equation.prefix}0", 0.0))
    arguments = {**equation.other_arguments, **equation.regressors}
    for name, x in arguments.items():
        squared = arguments["alpha"] ** 2 if name == "alpha2" else x
        values += parameters.get(f"{equation.prefix}_{name}", 0.0) * squared
    return values
