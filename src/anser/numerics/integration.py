"""Fixed-step integration of differential equations (Runge-Kutta 4) and quadrature rules with positive weights."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.arrays import cast_like
from anser.shapes import Scalar, ScalarLike

Y = TypeVar("Y")


def rk4_step(derivative: Callable[[ScalarLike, Y], Y], t: ScalarLike, y: Y, h: ScalarLike) -> Y:
    """Return the state y (any pytree) after one step h of the classical fourth-order Runge-Kutta method.

    `t` is the time at the start of the step; `derivative(t, y)` returns dy/dt. Source: Hairer, Norsett, Wanner,
    *Solving ODEs I*, table 1.2.
    """

    def shifted(scale: ScalarLike, slope: Y) -> Y:
        return jax.tree.map(lambda a, b: a + scale * b, y, slope)

    def stage(slope: Y, part: ScalarLike) -> tuple[Y, Y]:
        slope = cast_like(derivative(t + part * h, shifted(part * h, slope)), y)
        return slope, slope

    # One copy of the derivative in the compiled code.
    zero = jax.tree.map(jnp.zeros_like, y)
    k = jax.lax.scan(stage, zero, jnp.asarray([0.0, 0.5, 0.5, 1.0], jnp.result_type(h, *jax.tree.leaves(y))))[1]
    return jax.tree.map(lambda a, k: a + h / 6 * (k[0] + 2 * (k[1] + k[2]) + k[3]), y, k)


class QuadratureRule(NamedTuple):
    """Nodes and weights of a quadrature rule on [0, 1]; the weights are positive and sum to 1.

    Positive weights make the approximate length of a path convex, like the exact length.
    """

    nodes: Float[np.ndarray, " nodes"]
    weights: Float[np.ndarray, " nodes"]


def gauss_legendre(count: int) -> QuadratureRule:
    """Return the Gauss-Legendre rule of `count` nodes on [0, 1], exact for polynomials up to degree 2 `count` - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return QuadratureRule(0.5 * (nodes + 1.0), 0.5 * weights)


# Six-point closed Newton-Cotes rule, exact for polynomials up to degree 5 (theory section 6).
NEWTON_COTES_6 = QuadratureRule(
    np.linspace(0.0, 1.0, 6), np.array([19 / 288, 25 / 96, 25 / 144, 25 / 144, 25 / 96, 19 / 288])
)
GAUSS_LEGENDRE_16 = gauss_legendre(16)


def integrate(
    function: Callable[[Float[Array, " nodes"]], Float[Array, " nodes"]],
    low: ScalarLike,
    high: ScalarLike,
    rule: QuadratureRule = GAUSS_LEGENDRE_16,
) -> Scalar:
    """Return the integral of a vectorized function from `low` to `high` by a quadrature rule."""
    low, span = jnp.asarray(low), jnp.asarray(high) - jnp.asarray(low)
    return span * jnp.sum(jnp.asarray(rule.weights) * function(low + span * jnp.asarray(rule.nodes)))
