"""Least squares from many starts at once, by the damped steps of Levenberg and Marquardt.

For unknowns that come in groups of which only neighbours have to do with each other: the normal equations are block
tridiagonal, and a step costs no more than there are groups.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from anser.shapes import Count, Scalar

_FIRST_DAMPING, _LESS, _MORE = 1e-2, 0.2, 5.0  # the first as a part of the first cost
Groups = Float[Array, "groups n"]


class Form(NamedTuple):
    """A quadratic form, block tridiagonal.

    Attributes
    ----------
    own
        Of each group with itself.
    before
        Of each group with the one before, (group, of this one, of the one before); that of the first means nothing.
    """

    own: Float[Array, "groups n n"]
    before: Float[Array, "groups n n"]


class Normal(NamedTuple):
    """Normal equations of least squares.

    Attributes
    ----------
    cost
        Half the sum of squares.
    gradient
        Of the cost.
    form
        Product of the transposed Jacobian with itself.
    """

    cost: Scalar
    gradient: Groups
    form: Form


class Fit(NamedTuple):
    """How far the search from one start has come: the best so far, and where to look next.

    Attributes
    ----------
    about
        What belongs to this start, beside its unknowns.
    measure
        Of the size of a step.
    best, trial
        Unknowns.
    normal
        At the best.
    damping
        Of the last step; nan before the first.
    """

    about: PyTree
    measure: Form
    best: Groups
    trial: Groups
    normal: Normal
    damping: Scalar


def solve(form: Form, right: Groups) -> Groups:
    """What a positive definite form maps to the right side: block elimination, then back."""
    lower = jax.scipy.linalg.solve_triangular

    def eliminate(carry: tuple[Array, Array], group: tuple[Array, Array, Array]) -> tuple[Any, Any]:
        factor, found = carry
        own, before, wanted = group
        across = lower(factor, before.T, lower=True).T
        factor = jnp.linalg.cholesky(own - across @ across.T)
        found = lower(factor, wanted - across @ found, lower=True)
        return (factor, found), (factor, across, found)

    size = right.shape[1]
    none = form.before.at[0].set(0.0)
    begin = (jnp.eye(size), jnp.zeros(size))
    _, (factors, acrosses, founds) = jax.lax.scan(eliminate, begin, (form.own, none, right))

    def back(later: tuple[Array, Array], group: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], Array]:
        across_later, solved_later = later
        factor, across, found = group
        solved = lower(factor, found - across_later.T @ solved_later, lower=True, trans="T")
        return (across, solved), solved

    _, solved = jax.lax.scan(
        back, (jnp.zeros((size, size)), jnp.zeros(size)), (factors, acrosses, founds), reverse=True
    )
    return solved


def begin_fit(about: PyTree, measure: Form) -> Fit:
    """Before the first step, from unknowns that are all 0."""
    none = jnp.zeros(measure.own.shape[:2])
    before = Normal(jnp.asarray(jnp.inf), none, jax.tree.map(jnp.zeros_like, measure))
    return Fit(about, measure, none, none, before, jnp.asarray(jnp.nan))


def _step(normal_at: Callable[[PyTree, Groups], Normal], at: Fit) -> Fit:
    tried = normal_at(at.about, at.trial)
    better = tried.cost < at.normal.cost
    best = jnp.where(better, at.trial, at.best)
    normal = jax.tree.map(lambda new, old: jnp.where(better, new, old), tried, at.normal)
    first = jnp.isnan(at.damping)
    damping = jnp.where(first, _FIRST_DAMPING * tried.cost, at.damping * jnp.where(better, _LESS, _MORE))
    damping = jnp.clip(damping, 1e-9, 1e9)
    damped = jax.tree.map(lambda of, size: of + damping * size, normal.form, at.measure)
    return Fit(at.about, at.measure, best, best - solve(damped, normal.gradient), normal, damping)


def fit(normal_at: Callable[[PyTree, Groups], Normal], number: int, fits: Fit, wanted: int, enough: float) -> Fit:
    """So many steps of each of a batch, fewer once as many of them as wanted cost no more than is enough."""

    def going(carry: tuple[Count, Fit]) -> Bool[Array, ""]:
        done, now = carry
        return (done < number) & (jnp.sum(now.normal.cost <= enough) < wanted)

    def on(carry: tuple[Count, Fit]) -> tuple[Count, Fit]:
        done, now = carry
        return done + 1, jax.vmap(lambda one: _step(normal_at, one))(now)

    return jax.lax.while_loop(going, on, (jnp.asarray(0), fits))[1]


def closest_of(fits: Fit, kept: int) -> Fit:
    """Those of a batch with the least cost."""
    closest = jax.lax.top_k(-fits.normal.cost, kept)[1]
    return jax.tree.map(lambda leaf: leaf[closest], fits)
