"""Search for the maximum of a likelihood by Fisher's scoring with Levenberg's damping."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

Values = Float[np.ndarray, " parameter"]
STEPS_MAX = 100
_CONVERGED = 1e-3
"""Length of the last step in standard errors at which the search ends."""
_DAMPING_MAX = 1e8
"""Damping of a step that is too short to matter: a minimum to rounding, or a cliff."""


class LikelihoodPoint(NamedTuple):
    """Negative log likelihood at one set of parameter values, with gradient and information matrix."""

    cost: float  # infinite where the model diverges
    gradient: Values
    information: Float[np.ndarray, "parameter parameter"]  # Fisher's, an approximation of the second derivatives
    prediction: Any  # of the model at this point


def maximize_likelihood(
    evaluate: Callable[[Values], LikelihoodPoint], values: Values, lower: Values
) -> tuple[Values, LikelihoodPoint]:
    """Return the parameter values of greatest likelihood, at least `lower`, with likelihood and derivatives there.

    A parameter at its lower bound stays there as long as the likelihood falls in its direction. Raises ValueError if
    the model diverges with the start values, or the search does not converge.
    """
    point, damping = evaluate(values), 1e-3
    if not np.isfinite(point.cost):
        raise ValueError("start: the model diverges; expected start values nearer to the solution")
    for _ in range(STEPS_MAX):
        while damping < _DAMPING_MAX:
            step, length = _scoring_step(values, point, lower, damping)
            trial = evaluate(values + step)
            if trial.cost <= point.cost:
                break
            damping *= 10.0
        else:
            if _scoring_step(values, point, lower, 1e-12)[1] < _CONVERGED:
                return values, point
            break
        values, point, damping = values + step, trial, max(damping / 10.0, 1e-12)
        if length < _CONVERGED:
            return values, point
    raise ValueError("start: the search did not converge; expected start values nearer to the solution")


def _scoring_step(values: Values, point: LikelihoodPoint, lower: Values, damping: float) -> tuple[Values, float]:
    """Return a damped step of the free parameters, and its length in standard errors."""
    free, step = (values > lower) | (point.gradient < 0.0), np.zeros_like(values)
    information = point.information[np.ix_(free, free)]
    diagonal = np.diag(information)
    scale = np.diag(np.maximum(diagonal, 1e-12 * np.max(diagonal)))
    step[free] = -np.linalg.solve(information + damping * scale, point.gradient[free])
    step = np.maximum(values + step, lower) - values
    return step, float(np.sqrt(step @ point.information @ step))
