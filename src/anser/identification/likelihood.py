"""Maximum likelihood search: Fisher's scoring steps with Levenberg-Marquardt damping."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

Values = Float[np.ndarray, " parameter"]
STEPS_MAX = 100
"""Greatest number of steps of a search."""
_CONVERGED = 1e-3
"""Length of a step, in standard errors of the parameters, below which the search has converged."""
_DAMPING_MAX = 1e8
"""Damping at which the search stops trying shorter steps: no step lowers the cost."""


class LikelihoodPoint(NamedTuple):
    """Negative log-likelihood (`cost`, infinite if the model diverges) at one set of parameter values.

    `gradient` and `information` (Fisher's matrix) are the first and the approximate second derivatives. The search
    does not use `prediction`, which may be any data.
    """

    cost: float
    gradient: Values
    information: Float[np.ndarray, "parameter parameter"]
    prediction: Any


def maximize_likelihood(
    evaluate: Callable[[Values], LikelihoodPoint], values: Values, lower: Values
) -> tuple[Values, LikelihoodPoint]:
    """Return the parameter values of greatest likelihood that are at least `lower`, and the result of `evaluate` there.

    The search starts at `values`. Raises ValueError if the model diverges with the start values, or the search does not
    converge.
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
    """Return a damped step of the parameters, and the length of the step in standard errors of the parameters."""
    free, step = (values > lower) | (point.gradient < 0.0), np.zeros_like(values)
    information = point.information[np.ix_(free, free)]
    diagonal = np.diag(information)
    scale = np.diag(np.maximum(diagonal, 1e-12 * np.max(diagonal)))
    step[free] = -np.linalg.solve(information + damping * scale, point.gradient[free])
    step = np.maximum(values + step, lower) - values
    return step, float(np.sqrt(step @ point.information @ step))
