"""Equations with more unknowns than there are: damped Gauss-Newton steps of least size, in a batch."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from anser.shapes import Count, Scalar

Missed = tuple[Float[Array, " equations"], Float[Array, "equations unknowns"]]
"""By how much what is wanted is missed, and how that changes with the unknowns."""
_DAMPING = 1e-3


class LeastSteps(eqx.Module):
    """How far the search from one start has come: the best so far, and where to look next.

    Attributes
    ----------
    about
        What belongs to this start, beside its unknowns.
    best, trial
        Unknowns.
    missed, jacobian
        At the best.
    damping
        Of the next step.
    """

    about: PyTree
    best: Float[Array, " unknowns"]
    trial: Float[Array, " unknowns"]
    missed: Float[Array, " equations"]
    jacobian: Float[Array, "equations unknowns"]
    damping: Scalar


def begin_steps(about: PyTree, unknowns: Float[Array, " unknowns"], equations: int) -> LeastSteps:
    """Before the first step."""
    jacobian = jnp.zeros((equations, unknowns.shape[0]))
    return LeastSteps(about, unknowns, unknowns, jnp.full(equations, 1e6), jacobian, jnp.asarray(_DAMPING))


def least_step(missed_at: Callable[[Float[Array, " n"], PyTree], Missed], longest: float, at: LeastSteps) -> LeastSteps:
    """One step, no longer than `longest`: kept where less is missed after it, else tried again with more damping."""
    missed, jacobian = missed_at(at.trial, at.about)
    better = jnp.sum(missed**2) < jnp.sum(at.missed**2)
    best = jnp.where(better, at.trial, at.best)
    missed = jnp.where(better, missed, at.missed)
    jacobian = jnp.where(better, jacobian, at.jacobian)
    damping = jnp.clip(at.damping * jnp.where(better, 0.1, 20.0), 1e-14, 1e6)
    move = jacobian.T @ _solve(jacobian @ jacobian.T + damping * jnp.eye(missed.shape[0]), missed)
    move = move * jnp.minimum(1.0, longest / jnp.maximum(jnp.sqrt(jnp.sum(move**2)), 1e-12))
    return LeastSteps(at.about, best, best - move, missed, jacobian, damping)


def least_steps(
    missed_at: Callable[[Float[Array, " n"], PyTree], Missed], longest: float, number: int, searches: LeastSteps
) -> LeastSteps:
    """So many steps of each of a batch."""
    return jax.lax.fori_loop(
        0, number, lambda _, every: jax.vmap(lambda one: least_step(missed_at, longest, one))(every), searches
    )


def nearest_of(searches: LeastSteps, kept: int) -> LeastSteps:
    """Those of a batch that miss the least."""
    nearest = jax.lax.top_k(-jnp.sum(searches.missed**2, axis=1), kept)[1]
    return jax.tree.map(lambda leaf: leaf[nearest], searches)


def _solve(matrix: Float[Array, "n n"], vector: Float[Array, " n"]) -> Float[Array, " n"]:
    """Solution of a small positive definite system by elimination: a batch of them is one computation."""
    count = vector.shape[0]

    def eliminate(k: Count, rows: Array) -> Array:
        pivot = rows[k] / rows[k, k]
        return (rows - rows[:, k, None] * pivot[None, :]).at[k].set(pivot)

    return jax.lax.fori_loop(0, count, eliminate, jnp.concatenate([matrix, vector[:, None]], axis=1))[:, count]
