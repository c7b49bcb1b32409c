"""Damped Gauss-Newton steps: one loop for one start or a batch of them, the linear solve passed in.

The damping falls after a step that helps and rises after one that does not (D. W. Marquardt, *J. SIAM* 11(2), 1963).
Equations are a named tuple with a `cost`, which is to be least, and what the solve needs.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from anser.numerics.linear import solve_positive
from anser.shapes import Count, Scalar

Evaluate = Callable[[PyTree, Array], Any]
"""Equations for what belongs to a start and its unknowns."""
Move = Callable[[PyTree, Any, Scalar], Array]
"""What to take off the unknowns, for what belongs to a start, equations and damping."""


class Linearized(NamedTuple):
    """Residuals at a place, and their Jacobian."""

    residual: Float[Array, "*batch equations"]
    jacobian: Float[Array, "*batch equations unknowns"]

    @property
    def cost(self) -> Float[Array, "*batch"]:
        """Sum of squares."""
        return jnp.sum(self.residual**2, axis=-1)


class Damping(NamedTuple):
    """The first damping as a function of the first cost; factors after a step that helps or does not; bounds."""

    first: Callable[[Scalar], Scalar]
    less: float
    more: float
    least: float = 0.0
    most: float = float("inf")


class Search(NamedTuple):
    """How far the search from one start has come: the best so far, and where to look next.

    Attributes
    ----------
    about
        What belongs to this start, beside its unknowns.
    best, trial
        Unknowns.
    at
        Equations at the best.
    damping
        Of the last step; NaN before the first.
    """

    about: PyTree
    best: Array
    trial: Array
    at: Any
    damping: Scalar


def begin_search(about: PyTree, start: Array, unknown: Any) -> Search:
    """Before the first step, with equations of the shapes that are to come, which cost more than any."""
    return Search(about, start, start, unknown, jnp.asarray(jnp.nan))


def search_step(evaluate: Evaluate, move: Move, damping: Damping, search: Search) -> Search:
    """One step: kept where the cost is less after it, else tried again with more damping."""
    about, best, trial, at, former = search
    tried = evaluate(about, trial)
    better = tried.cost < at.cost  # not-a-number is no improvement
    best, at = jax.tree.map(lambda new, old: jnp.where(better, new, old), (trial, tried), (best, at))
    now = former * jnp.where(better, damping.less, damping.more)
    now = jnp.where(jnp.isnan(former), damping.first(tried.cost), now)
    now = jnp.clip(now, damping.least, damping.most)
    return Search(about, best, best - move(about, at, now), at, now)


def search_steps(
    evaluate: Evaluate,
    move: Move,
    damping: Damping,
    number: int,
    searches: Search,
    wanted: int | None = None,
    enough: float = 0.0,
) -> Search:
    """So many steps of each of a batch; fewer once as many as are wanted cost no more than is enough."""

    def every(now: Search) -> Search:
        return jax.vmap(lambda one: search_step(evaluate, move, damping, one))(now)

    if wanted is None:
        return jax.lax.fori_loop(0, number, lambda _, now: every(now), searches)

    def going(carry: tuple[Count, Search]) -> Bool[Array, ""]:
        done, now = carry
        return (done < number) & (jnp.sum(now.at.cost <= enough) < wanted)

    return jax.lax.while_loop(going, lambda carry: (carry[0] + 1, every(carry[1])), (jnp.asarray(0), searches))[1]


def closest_of(searches: Search, kept: int) -> Search:
    """Those of a batch with the least cost."""
    closest = jax.lax.top_k(-searches.at.cost, kept)[1]
    return jax.tree.map(lambda leaf: leaf[closest], searches)


def least_move(longest: float) -> Move:
    """Steps of least size for fewer equations than unknowns, none longer than this."""

    def move(_: PyTree, at: Linearized, damping: Scalar) -> Array:
        square = at.jacobian @ at.jacobian.T + damping * jnp.eye(at.residual.shape[0])
        step = at.jacobian.T @ solve_positive(square, at.residual)
        return step * jnp.minimum(1.0, longest / jnp.maximum(jnp.sqrt(jnp.sum(step**2)), 1e-12))

    return move
