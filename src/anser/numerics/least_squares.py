"""Damped Gauss-Newton and Levenberg-Marquardt.

One loop for one start or a batch of starts, and the implicit derivative of the solution.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from anser.numerics.linear import solve_positive
from anser.shapes import Count, Flag, Scalar

Evaluate = Callable[[PyTree, Array], Any]
"""Equations for what belongs to a start and its unknowns."""
StepRule = Callable[[PyTree, Any, Scalar], Array]
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

    initial: Callable[[Scalar], Scalar]
    decrease: float
    increase: float
    minimum: float = 0.0
    maximum: float = float("inf")


class SearchState(NamedTuple):
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

    context: PyTree
    best: Array
    trial: Array
    at: Any
    damping: Scalar


def start_search(context: PyTree, start: Array, unknown: Any) -> SearchState:
    """Before the first step, with equations of the shapes that are to come, which cost more than any."""
    return SearchState(context, start, start, unknown, jnp.asarray(jnp.nan))


def search_step(evaluate: Evaluate, move: StepRule, damping: Damping, search: SearchState) -> SearchState:
    """One step: kept where the cost is less after it, else tried again with more damping."""
    about, best, trial, at, former = search
    tried = evaluate(about, trial)
    better = tried.cost < at.cost  # not-a-number is no improvement
    best, at = jax.tree.map(lambda new, old: jnp.where(better, new, old), (trial, tried), (best, at))
    now = former * jnp.where(better, damping.decrease, damping.increase)
    now = jnp.where(jnp.isnan(former), damping.initial(tried.cost), now)
    now = jnp.clip(now, damping.minimum, damping.maximum)
    return SearchState(about, best, best - move(about, at, now), at, now)


def search_steps(
    evaluate: Evaluate,
    move: StepRule,
    damping: Damping,
    number: int,
    searches: SearchState,
    required_count: int | None = None,
    sufficient_cost: float = 0.0,
) -> SearchState:
    """So many steps of each of a batch; fewer once as many as are wanted cost no more than is enough."""

    def every(now: SearchState) -> SearchState:
        return jax.vmap(lambda one: search_step(evaluate, move, damping, one))(now)

    if required_count is None:
        return jax.lax.fori_loop(0, number, lambda _, now: every(now), searches)

    def going(carry: tuple[Count, SearchState]) -> Bool[Array, ""]:
        done, now = carry
        return (done < number) & (jnp.sum(now.at.cost <= sufficient_cost) < required_count)

    return jax.lax.while_loop(going, lambda carry: (carry[0] + 1, every(carry[1])), (jnp.asarray(0), searches))[1]


def best_searches(searches: SearchState, count: int) -> SearchState:
    """Those of a batch with the least cost."""
    closest = jax.lax.top_k(-searches.at.cost, count)[1]
    return jax.tree.map(lambda leaf: leaf[closest], searches)


def minimum_norm_step(max_length: float) -> StepRule:
    """Steps of least size for fewer equations than unknowns, none longer than this."""

    def move(_: PyTree, at: Linearized, damping: Scalar) -> Array:
        square = at.jacobian @ at.jacobian.T + damping * jnp.eye(at.residual.shape[0])
        step = at.jacobian.T @ solve_positive(square, at.residual)
        return step * jnp.minimum(1.0, max_length / jnp.maximum(jnp.sqrt(jnp.sum(step**2)), 1e-12))

    return move


Parameters = TypeVar("Parameters")

_DAMPING = Damping(lambda _: jnp.asarray(1e-3), 0.1, 10.0)
_LAST_DAMPING = 1e12
"""No step this short makes progress: the search has ended in a local minimum or at a kink."""


class Solution(NamedTuple):
    """A point and the largest absolute residual there."""

    x: Float[Array, " n"]
    residual: Scalar


def levenberg_marquardt(
    function: Callable[[Float[Array, " n"], Parameters], Float[Array, " n"]],
    parameters: Parameters,
    start: Float[Array, " n"],
    steps: int = 64,
    tolerance: float = 1e-12,
) -> Solution:
    """Point x where `function(x, parameters)`, as many residuals as unknowns, is zero, or smaller than at the start.

    The damping falls by ten after a step that helps and rises by ten after one that does not (D. W. Marquardt, *J.
    SIAM* 11(2), 1963). A step costs one evaluation of the function with its Jacobian, and that is the only copy of the
    function in the compiled code: a large model compiles several times faster than with a general solver. Not
    differentiated: see `with_implicit_derivative`.

    Parameters
    ----------
    function
        Residuals, scaled so that 1 is large in each.
    parameters
        Any pytree.
    start
        Where to start, scaled so that 1 is large in each.
    steps
        Greatest number of steps.
    tolerance
        The search ends when no residual is larger.
    """
    # Without tangents at its inputs the loop is not differentiated along: it would be thrown away, but compiled.
    parameters = jax.tree.map(lambda leaf: jax.lax.stop_gradient(leaf) if eqx.is_array(leaf) else leaf, parameters)
    start = jax.lax.stop_gradient(start)

    def evaluate(_: None, x: Float[Array, " n"]) -> Linearized:
        residual, push = jax.linearize(lambda at: function(at, parameters), x)
        return Linearized(residual, jax.vmap(push, out_axes=1)(jnp.eye(x.size)))

    def move(_: None, at: Linearized, damping: Scalar) -> Float[Array, " n"]:
        return damped_solve(at.jacobian, at.residual, damping)

    def proceed(carry: tuple[SearchState, Count]) -> Flag:
        search, count = carry
        # The first evaluation is the loop's own first pass, taken with an infinite residual before it.
        left = jnp.max(jnp.abs(search.at.residual)) > tolerance
        return (count <= steps) & left & ~(search.damping >= _LAST_DAMPING)

    unknown = Linearized(jnp.full_like(start, jnp.inf), jnp.eye(start.size))
    found, _ = jax.lax.while_loop(
        proceed,
        lambda carry: (search_step(evaluate, move, _DAMPING, carry[0]), carry[1] + 1),
        (start_search(None, start, unknown), jnp.asarray(0)),
    )
    return Solution(found.best, jnp.max(jnp.abs(found.at.residual)))


def with_implicit_derivative(
    function: Callable[[Float[Array, " n"], Parameters], Float[Array, " n"]],
    parameters: Parameters,
    root: Float[Array, " n"],
) -> Float[Array, " n"]:
    """Attach to a root of `function(x, parameters)` its derivative with respect to the parameters.

    dx = -(df/dx)^-1 (df/dp) dp, the implicit function theorem; nothing is evaluated unless it is asked for. First
    derivatives only. Where df/dx is singular the derivative is that of least squares, so it stays finite.
    """
    return _implicit(function, parameters, jax.lax.stop_gradient(root))


@eqx.filter_custom_jvp
def _implicit(function: Callable, parameters: object, root: Float[Array, " n"]) -> Float[Array, " n"]:
    return root


@_implicit.def_jvp
def _implicit_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    function, parameters, root = primals
    jacobian = jax.jacfwd(lambda x: function(x, parameters))(root)
    _, change = eqx.filter_jvp(lambda p: function(root, p), (parameters,), (tangents[1],))
    return root, -damped_solve(jacobian, change, jnp.asarray(0.0))


def damped_solve(matrix: Float[Array, "n n"], vector: Float[Array, " n"], damping: Scalar) -> Float[Array, " n"]:
    """Minimum of |matrix @ x - vector|^2 + damping |x|^2, by the normal equations.

    A floor of 1e-14 of the largest diagonal term keeps a singular matrix solvable.
    """
    normal = matrix.T @ matrix
    floor = 1e-14 * jnp.max(jnp.diagonal(normal)) + 1e-30
    square = normal + (damping + floor) * jnp.eye(vector.size)
    # Its own derivative: that of the system, not of the elimination.
    return jax.lax.custom_linear_solve(
        lambda x: square @ x, matrix.T @ vector, lambda _, right: solve_positive(square, right), symmetric=True
    )
