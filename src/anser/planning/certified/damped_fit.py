"""Least squares from many starts at once, by the damped steps of Levenberg and Marquardt."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from anser.planning.certified.least_steps import Missed
from anser.shapes import Scalar

_FIRST_DAMPING, _LESS, _MORE = 1e-2, 0.2, 5.0  # the first as a part of the first sum of squares


class Fit(NamedTuple):
    """How far the search from one start has come: the best so far, and where to look next.

    Attributes
    ----------
    about
        What belongs to this start, beside its unknowns.
    best, trial
        Unknowns.
    cost
        Sum of squares at the best.
    normal, right
        There, of the normal equations.
    damping
        Of the last step; nan before the first.
    """

    about: PyTree
    best: Float[Array, " unknowns"]
    trial: Float[Array, " unknowns"]
    cost: Scalar
    normal: Float[Array, "unknowns unknowns"]
    right: Float[Array, " unknowns"]
    damping: Scalar


def begin_fit(about: PyTree, unknowns: Float[Array, " unknowns"]) -> Fit:
    """Before the first step."""
    count = unknowns.shape[0]
    square = jnp.zeros((count, count))
    return Fit(about, unknowns, unknowns, jnp.asarray(jnp.inf), square, jnp.zeros(count), jnp.asarray(jnp.nan))


def _step(missed_at: Callable[[Float[Array, " n"], PyTree], Missed], at: Fit) -> Fit:
    missed, jacobian = missed_at(at.trial, at.about)
    cost = jnp.sum(missed**2)
    better = cost < at.cost
    best = jnp.where(better, at.trial, at.best)
    normal = jnp.where(better, jacobian.T @ jacobian, at.normal)
    right = jnp.where(better, jacobian.T @ missed, at.right)
    first = jnp.isnan(at.damping)
    damping = jnp.where(first, _FIRST_DAMPING * cost, at.damping * jnp.where(better, _LESS, _MORE))
    damping = jnp.clip(damping, 1e-9, 1e9)
    factor = jax.scipy.linalg.cho_factor(normal + damping * jnp.eye(best.shape[0]))
    step = jax.scipy.linalg.cho_solve(factor, right)
    return Fit(at.about, best, best - step, jnp.where(better, cost, at.cost), normal, right, damping)


def fit(missed_at: Callable[[Float[Array, " n"], PyTree], Missed], number: int, fits: Fit) -> Fit:
    """So many steps of each of a batch."""
    return jax.lax.fori_loop(0, number, lambda _, every: jax.vmap(lambda one: _step(missed_at, one))(every), fits)


def closest_of(fits: Fit, kept: int) -> Fit:
    """Those of a batch with the least sums of squares."""
    closest = jax.lax.top_k(-fits.cost, kept)[1]
    return jax.tree.map(lambda leaf: leaf[closest], fits)
