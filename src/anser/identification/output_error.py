"""Output-error method: maximum likelihood for a model without process noise, plain or stabilised by measured outputs.

Source: V. Klein, E. A. Morelli, *Aircraft System Identification*, AIAA 2006, chapter 6.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from anser.identification.dynamic_models import (
    DynamicModel,
    Gain,
    Manoeuvre,
    ParameterSet,
    Prediction,
    Values,
    prepare_parameters,
)
from anser.identification.estimates import Estimate, collinearity, coloured_covariance
from anser.identification.likelihood import LikelihoodPoint, maximize_likelihood
from anser.identification.smoothing import noise_level

_GROWTH_NOTABLE = 10.0
"""Growth of an error over a manoeuvre above which a remark says that the model is unstable."""


def estimate_output_error(
    model: DynamicModel,
    manoeuvre: Manoeuvre,
    start: Mapping[str, float],
    *,
    fixed: Mapping[str, float] | None = None,
    initial_states: Sequence[str] = (),
    noise: Sequence[float] | None = None,
    stabilized: bool = False,
    input_noise: Sequence[float] | None = None,
) -> Estimate:
    """Estimate parameters by output error: Gauss-Newton steps with exact sensitivities and Levenberg's damping.

    Parameters
    ----------
    model, manoeuvre
        The model, and the record of inputs and outputs (`make_manoeuvre`).
    start
        Start values of the estimated parameters by name, such as those of a regression.
    fixed
        Values of the remaining parameters of the model.
    initial_states
        Names of states whose initial value is estimated too, as the parameter `STATE(0)`.
    noise
        Standard deviations of the measurement noise, in the order and units of the model's outputs; None: estimated
        with the parameters.
    stabilized
        True: measured outputs correct the state at every sample, with the least constant gain that makes the prediction
        stable; for unstable aircraft (R. V. Jategaonkar, *Flight Vehicle System Identification*, chapter 9).
    input_noise
        Standard deviations of white noise in the recorded inputs, in the order and units of the model's inputs. The
        noise widens the intervals (to first order). None: exact inputs.

    Returns
    -------
    The estimate: `covariance` is the Cramer-Rao bound corrected for coloured residuals, `white_covariance` the bound
    for white residuals. A note warns of an unstable model if `stabilized` is false.

    Raises
    ------
    ValueError
        If an argument is not valid, the predicted outputs diverge, the search does not converge, no gain makes the
        model stable, or the outputs do not determine the parameters; the message names the parameters.
    """
    parameters, values = prepare_parameters(model, manoeuvre, start, fixed, initial_states)
    levels = start_levels(model, manoeuvre, noise)
    input_levels = None if input_noise is None else np.asarray(input_noise, dtype=float)
    if input_levels is not None and not (
        input_levels.shape == (len(model.inputs),) and np.all((input_levels >= 0.0) & np.isfinite(input_levels))
    ):
        raise ValueError(
            f"input_noise: arrived {input_levels.tolist()}; expected finite numbers, 0 or more, for "
            f"{', '.join(model.inputs)}"
        )
    growth = "" if stabilized else describe_growth(parameters, values, manoeuvre)
    gain: Gain | None = None
    try:
        for _ in range(1 + stabilized):  # the gain follows from the start values, then from their estimates
            if stabilized:
                gain = _stabilizing_gain(parameters, values, manoeuvre, levels)
            values, prediction = _search(parameters, values, manoeuvre, gain, None if noise is None else levels)
            levels = _levels(prediction, manoeuvre) if noise is None else levels
        prediction = parameters.predict(values, manoeuvre, gain)
        growth = growth or ("" if stabilized else describe_growth(parameters, values, manoeuvre))
        method = "output error, stabilised" if stabilized else "output error"
        S, residuals = prediction.sensitivities / levels[:, None], (manoeuvre.outputs - prediction.outputs) / levels
        flat = S.reshape(-1, values.size)
        checked = collinearity(flat.T @ flat, parameters.names, "parameters")
        inverse = np.linalg.inv(flat.T @ flat)
        errors = coloured_covariance(S, residuals, inverse)
        if input_levels is not None:
            influence = parameters.input_influence(values, manoeuvre, S / levels[:, None], gain)
            B = inverse @ (influence * input_levels).reshape(values.size, -1)
            errors = errors._replace(covariance=errors.covariance + B @ B.T)
        return Estimate(
            method=method,
            names=parameters.names,
            values=values,
            **errors._asdict(),
            **checked._asdict(),
            responses=model.outputs,
            measured=manoeuvre.outputs,
            fitted=prediction.outputs,
            sample_points=manoeuvre.time_s,
            notes=(growth,) if growth else (),
        )
    except ValueError as error:
        raise ValueError(f"{error}. {growth}" if growth else str(error)) from error


def validate(
    estimate: Estimate,
    model: DynamicModel,
    manoeuvre: Manoeuvre,
    *,
    fixed: Mapping[str, float] | None = None,
    initial_states: Sequence[str] = (),
) -> Estimate:
    """Predict a second manoeuvre with estimated parameters, and return the estimate with the fit to this manoeuvre.

    The initial states in `initial_states` are estimated from the second manoeuvre; the remaining states start from
    `manoeuvre.initial_state`. `fixed` contains the values of the model's remaining parameters. Raises ValueError if the
    predicted outputs diverge.
    """
    of_manoeuvre = {text.format(name) for name in model.states for text in ("{}(0)", "noise({})")}
    values = {name: value for name, value in estimate.parameters.items() if name not in of_manoeuvre}
    known = {**values, **(fixed or {})}
    if initial_states:
        start = {f"{name}(0)": manoeuvre.initial_state[model.states.index(name)] for name in initial_states}
        known |= estimate_output_error(model, manoeuvre, start, fixed=known).parameters
    parameters, numbers = prepare_parameters(model, manoeuvre, known, None, ())
    fitted = parameters.predict(numbers, manoeuvre).outputs
    if not np.all(np.isfinite(fitted)):
        raise ValueError(f"validate: the predicted outputs diverge. {describe_growth(parameters, numbers, manoeuvre)}")
    return dataclasses.replace(
        estimate,
        method=f"{estimate.method}, validated on another manoeuvre",
        measured=manoeuvre.outputs,
        fitted=fitted,
        sample_points=manoeuvre.time_s,
        notes=(),
    )


def start_levels(
    model: DynamicModel, manoeuvre: Manoeuvre, noise: Sequence[float] | None
) -> Float[np.ndarray, " output"]:
    """Return `noise` as an array or, if None, standard deviations of the measurement noise estimated from the record.

    Raises ValueError if `noise` does not contain a positive number for each output.
    """
    if noise is None:
        return np.maximum(noise_level(manoeuvre.outputs.T), noise_floor(manoeuvre))
    levels = np.asarray(noise, dtype=float)
    if levels.shape != (len(model.outputs),) or not np.all((levels > 0.0) & np.isfinite(levels)):
        raise ValueError(f"noise: arrived {levels.tolist()}; expected positive numbers for {', '.join(model.outputs)}")
    return levels


def noise_floor(manoeuvre: Manoeuvre) -> Float[np.ndarray, " output"]:
    """Return a least standard deviation of the measurement noise: 1e-7 of the standard deviation of each output."""
    return 1e-7 * np.maximum(np.std(manoeuvre.outputs, axis=0), 1e-12)


def _levels(prediction: Prediction, manoeuvre: Manoeuvre) -> Float[np.ndarray, " output"]:
    return np.maximum(np.sqrt(np.mean((manoeuvre.outputs - prediction.outputs) ** 2, axis=0)), noise_floor(manoeuvre))


def _search(
    parameters: ParameterSet,
    start: Values,
    manoeuvre: Manoeuvre,
    gain: Gain | None,
    noise: Float[np.ndarray, " output"] | None,
) -> tuple[Values, Prediction]:
    """Return the parameter values of greatest likelihood, and the outputs predicted with them.

    `noise` holds the standard deviations of the measurement noise; if None, each step uses the residuals' deviations.
    """

    def evaluate(values: Values) -> LikelihoodPoint:
        prediction = parameters.predict(values, manoeuvre, gain)
        levels = _levels(prediction, manoeuvre)
        cost = np.sum(np.log(levels)) if noise is None else 0.5 * np.sum((levels / noise) ** 2)
        levels = levels if noise is None else noise
        S = (prediction.sensitivities / levels[:, None]).reshape(-1, values.size)
        residuals = ((manoeuvre.outputs - prediction.outputs) / levels).ravel()
        finite = np.all(np.isfinite(S)) and np.isfinite(cost)
        return LikelihoodPoint(
            len(manoeuvre.outputs) * float(cost) if finite else np.inf, -S.T @ residuals, S.T @ S, prediction
        )

    with np.errstate(over="ignore", invalid="ignore"):
        values, point = maximize_likelihood(evaluate, start, np.full(start.size, -np.inf))
    return values, point.prediction


def describe_growth(parameters: ParameterSet, values: Values, manoeuvre: Manoeuvre) -> str:
    """Return a warning if errors of an unstable model grow more than tenfold over the manoeuvre; if not, ""."""
    A = parameters.linearize(values, manoeuvre).A
    rate = float(np.max(np.linalg.eigvals(A).real)) if np.all(np.isfinite(A)) else np.nan
    duration = float(manoeuvre.time_s[-1] - manoeuvre.time_s[0])
    if not rate * duration > np.log(_GROWTH_NOTABLE):
        return ""
    return (
        f"The model is unstable (eigenvalue {rate:+.3g} 1/s): integrated over {duration:.3g} s, it amplifies every "
        f"error of start, input and parameters {np.exp(min(rate * duration, 500.0)):.2g} times, so that plain output "
        "error is biased or diverges; use stabilised output error, filter error or equation error"
    )


def _stabilizing_gain(
    parameters: ParameterSet, values: Values, manoeuvre: Manoeuvre, levels: Float[np.ndarray, " output"]
) -> Gain:
    """Return the steady Kalman gain for nearly zero process noise, which mirrors unstable eigenvalues to stable ones.

    Raises ValueError if an unstable state is not observable from the outputs.
    """
    linear = parameters.linearize(values, manoeuvre)
    C, R = linear.C / levels[:, None], np.eye(len(levels))
    Q = 1e-9 * np.diag(1.0 / np.maximum(np.sum(C**2, axis=0), 1e-12))
    try:
        P = solve_discrete_are(linear.transition.T, C.T, Q, R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ValueError(
            "stabilized: no gain from the outputs makes the model stable; expected outputs in which every unstable "
            "state is seen"
        ) from error
    return P @ C.T @ np.linalg.inv(C @ P @ C.T + R) / levels
