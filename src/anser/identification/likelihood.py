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
    """Negative log likelihood at a point, with its derivatives."""

    cost: float  # infinite where the model diverges
    gradient: Values
    information: Float[np.ndarray, "parameter parameter"]  # Fisher's, an approximation of the second derivatives
    prediction: Any  # of the model at this point


def maximize_likelihood(
    evaluate: Callable[[Values], LikelihoodPoint], values: Values, lower: Values
) -> tuple[Values, LikelihoodPoint] | None:
    """Return the values of greatest likelihood, at least `lower`, with the point there; None without convergence.

    A parameter at its lower bound stays there as long as the likelihood falls in its direction.
    """
    point, damping = evaluate(values), 1e-3
    for _ in range(STEPS_MAX):
        free = (values > lower) | (point.gradient < 0.0)
        information, gradient = point.information[np.ix_(free, free)], point.gradient[free]
        scale = np.diag(np.maximum(np.diag(information), 1e-12 * np.max(np.diag(information))))
        while damping < _DAMPING_MAX:
            step = np.zeros_like(values)
            step[free] = -np.linalg.solve(information + damping * scale, gradient)
            step = np.maximum(values + step, lower) - values
            trial = evaluate(values + step)
            if trial.cost <= point.cost:
                break
            damping *= 10.0
        else:
            step = np.zeros_like(values)
            step[free] = -np.linalg.solve(information + 1e-12 * scale, gradient)
            step = np.maximum(values + step, lower) - values
            return (values, point) if _length(step, point) < _CONVERGED else None
        length = _length(step, point)
        values, point, damping = values + step, trial, max(damping / 10.0, 1e-12)
        if length < _CONVERGED:
            return values, point
    return None


def _length(step: Values, point: LikelihoodPoint) -> float:
    return float(np.sqrt(step @ point.information @ step))
