"""Damped Gauss-Newton and Levenberg-Marquardt methods for nonlinear equations, and the derivative of the solution."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from anser.numerics.linear import solve_positive
from anser.shapes import Flag, Integer, Scalar

Evaluate = Callable[[PyTree, Array], Any]
"""Function of (context, unknowns) that returns linearized equations with a `cost`, such as `Linearized`.

The context is the data of a start besides the unknowns."""
StepRule = Callable[[PyTree, Any, Scalar], Array]
"""Function of (context, linearized equations, damping) that returns the step to subtract from the unknowns."""


class Linearized(NamedTuple):
    """Residuals of the equations and their Jacobian at a point."""

    residual: Float[Array, "*batch equations"]
    jacobian: Float[Array, "*batch equations unknowns"]

    @property
    def cost(self) -> Float[Array, "*batch"]:
        """Sum of squares of the residuals."""
        return jnp.sum(self.residual**2, axis=-1)


class Damping(NamedTuple):
    """Rule for the damping of the steps of a search.

    `initial` gives the first damping from the cost at the start. A step that lowers the cost multiplies the damping by
    `decrease`, any other step by `increase`; the result is clipped to `minimum` and `maximum`.
    """

    initial: Callable[[Scalar], Scalar]
    decrease: float
    increase: float
    minimum: float = 0.0
    maximum: float = float("inf")


class SearchState(NamedTuple):
    """State of the search from one start.

    Attributes
    ----------
    context
        Data of this start besides the unknowns.
    best, at
        Unknowns of the least cost so far, and the linearized equations there.
    trial
        Unknowns that the next step evaluates.
    damping
        Damping of the last step; NaN before the first.
    """

    context: PyTree
    best: Array
    trial: Array
    at: Any
    damping: Scalar


def start_search(context: PyTree, start: Array, unevaluated: Any) -> SearchState:
    """Return the search state before the first step.

    `unevaluated` stands in for the linearized equations: the same structure and shapes, with an infinite cost.
    """
    return SearchState(context, start, start, unevaluated, jnp.asarray(jnp.nan))


def search_step(evaluate: Evaluate, move: StepRule, damping: Damping, search: SearchState) -> SearchState:
    """Return the search after one step: evaluate the trial, adopt a trial of lower cost as the best, make a new trial.

    The new trial is the best minus `move(context, linearized equations of the best, damping)`.
    """
    context, best, trial, at, former = search
    tried = evaluate(context, trial)
    better = tried.cost < at.cost  # not-a-number is no improvement
    best, at = jax.tree.map(lambda new, old: jnp.where(better, new, old), (trial, tried), (best, at))
    new_damping = former * jnp.where(better, damping.decrease, damping.increase)
    new_damping = jnp.where(jnp.isnan(former), damping.initial(tried.cost), new_damping)
    new_damping = jnp.clip(new_damping, damping.minimum, damping.maximum)
    return SearchState(context, best, best - move(context, at, new_damping), at, new_damping)


def search_steps(
    evaluate: Evaluate,
    move: StepRule,
    damping: Damping,
    number: int,
    searches: SearchState,
    required_count: int | None = None,
    sufficient_cost: float = 0.0,
) -> SearchState:
    """Return a batch of searches after up to `number` steps; see `search_step`.

    If `required_count` is given, the loop ends when this number of searches has a cost of at most `sufficient_cost`.
    """

    def step_all(state: SearchState) -> SearchState:
        return jax.vmap(lambda search: search_step(evaluate, move, damping, search))(state)

    if required_count is None:
        return jax.lax.fori_loop(0, number, lambda _, state: step_all(state), searches)

    def is_unfinished(carry: tuple[Integer, SearchState]) -> Bool[Array, ""]:
        count, state = carry
        return (count < number) & (jnp.sum(state.at.cost <= sufficient_cost) < required_count)

    return jax.lax.while_loop(
        is_unfinished, lambda carry: (carry[0] + 1, step_all(carry[1])), (jnp.asarray(0), searches)
    )[1]


def best_searches(searches: SearchState, count: int) -> SearchState:
    """Return the `count` searches of a batch with the lowest costs, lowest first."""
    closest = jax.lax.top_k(-searches.at.cost, count)[1]
    return jax.tree.map(lambda leaf: leaf[closest], searches)


def minimum_norm_step(max_length: float) -> StepRule:
    """Return the rule for damped steps of least norm, at most `max_length`; for fewer residuals than unknowns."""

    def move(_: PyTree, at: Linearized, damping: Scalar) -> Array:
        square = at.jacobian @ at.jacobian.T + damping * jnp.eye(at.residual.shape[0])
        step = at.jacobian.T @ solve_positive(square, at.residual)
        return step * jnp.minimum(1.0, max_length / jnp.maximum(jnp.sqrt(jnp.sum(step**2)), 1e-12))

    return move


Parameters = TypeVar("Parameters")

_DAMPING = Damping(lambda _: jnp.asarray(1e-3), 0.1, 10.0)
_LAST_DAMPING = 1e12
"""Damping at which the search ends: steps are then too short, and x is at a local minimum or a kink of the cost."""


class Solution(NamedTuple):
    """Solution x of the equations, and the largest absolute residual there."""

    x: Float[Array, " n"]
    residual: Scalar


def levenberg_marquardt(
    function: Callable[[Float[Array, " n"], Parameters], Float[Array, " n"]],  # residuals, scaled so that 1 is large
    parameters: Parameters,  # any pytree
    start: Float[Array, " n"],  # initial unknowns, scaled so that 1 is large
    steps: int = 64,  # greatest number of steps
    tolerance: float = 1e-12,  # largest absolute residual at which the search stops
) -> Solution:
    """Find a root x of `function(x, parameters)`, for as many residuals as unknowns.

    If no root is reached, the x of lowest cost is returned: check `residual`. The result has no derivatives;
    `with_implicit_derivative` attaches them. Source: D. W. Marquardt, *J. SIAM* 11(2), 1963.
    """
    # Inputs without tangents keep the loop from being differentiated: its derivative would be compiled but unused.
    parameters = jax.tree.map(lambda leaf: jax.lax.stop_gradient(leaf) if eqx.is_array(leaf) else leaf, parameters)
    start = jax.lax.stop_gradient(start)

    # the only copy of the function in the compiled code: a large model compiles faster than in a general solver
    def evaluate(_: None, x: Float[Array, " n"]) -> Linearized:
        residual, push = jax.linearize(lambda at: function(at, parameters), x)
        return Linearized(residual, jax.vmap(push, out_axes=1)(jnp.eye(x.size)))

    def move(_: None, at: Linearized, damping: Scalar) -> Float[Array, " n"]:
        return damped_solve(at.jacobian, at.residual, damping)

    def proceed(carry: tuple[SearchState, Integer]) -> Flag:
        search, count = carry
        # The first pass of the loop evaluates the start; the residual before the pass is infinite.
        unsolved = jnp.max(jnp.abs(search.at.residual)) > tolerance
        return (count <= steps) & unsolved & ~(search.damping >= _LAST_DAMPING)

    unevaluated = Linearized(jnp.full_like(start, jnp.inf), jnp.eye(start.size))
    final, _ = jax.lax.while_loop(
        proceed,
        lambda carry: (search_step(evaluate, move, _DAMPING, carry[0]), carry[1] + 1),
        (start_search(None, start, unevaluated), jnp.asarray(0)),
    )
    return Solution(final.best, jnp.max(jnp.abs(final.at.residual)))


def with_implicit_derivative(
    function: Callable[[Float[Array, " n"], Parameters], Float[Array, " n"]],
    parameters: Parameters,
    root: Float[Array, " n"],
) -> Float[Array, " n"]:
    """Return `root`, a root x of f = `function(x, p)`, with its derivative with respect to p = `parameters`.

    dx = -(df/dx)^-1 (df/dp) dp, first derivatives only. If df/dx is singular, the derivative is the least-squares
    solution and stays finite.
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
    """Return the x that minimizes |matrix @ x - vector|^2 + damping |x|^2; a singular matrix gives a finite x."""
    normal = matrix.T @ matrix
    # the floor keeps a singular matrix solvable
    floor = 1e-14 * jnp.max(jnp.diagonal(normal)) + 1e-30
    square = normal + (damping + floor) * jnp.eye(vector.size)
    # The derivative is that of the linear system, not of the elimination steps.
    return jax.lax.custom_linear_solve(
        lambda x: square @ x, matrix.T @ vector, lambda _, right: solve_positive(square, right), symmetric=True
    )
