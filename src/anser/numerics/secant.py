"""A root within a bracket from values alone, with its implicit derivative: half of what Newton's method compiles to."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import lax

from anser.numerics.newton import Root
from anser.shapes import Scalar, ScalarLike

Parameters = TypeVar("Parameters")


def bracketed_secant(
    function: Callable[[Scalar, Parameters], Scalar],
    parameters: Parameters,
    low: ScalarLike,
    high: ScalarLike,
    value_low: ScalarLike,
    value_high: ScalarLike,
    steps: int,
) -> Root:
    """Root of a scalar function whose values at the ends of a bracket differ in sign, by the Illinois method.

    The number of steps is fixed. The root carries its derivative by the implicit function theorem,
    dx = -(df/dp) dp / (df/dx), both taken at the root and only where asked for; where df/dx is zero there, the
    derivative is reported as zero. The steps themselves are not differentiated. First derivatives only.

    Parameters
    ----------
    function
        Takes x and the parameters; everything that is to be differentiated goes through `parameters`.
    parameters
        Any pytree.
    low, high
        The bracket.
    value_low, value_high
        Values there. Without a change of sign the result is some point of the bracket: look at `residual`.
    steps
        Number of function evaluations in the loop.
    """
    fixed = lax.stop_gradient(parameters)
    begin = tuple(lax.stop_gradient(jnp.asarray(x, dtype=float)) for x in (low, high, value_low, value_high))

    def following(a: Scalar, b: Scalar, fa: Scalar, fb: Scalar) -> Scalar:
        gap = fb - fa
        x = b - fb * (b - a) / jnp.where(gap == 0.0, 1.0, gap)
        inside = (gap != 0.0) & (x >= jnp.minimum(a, b)) & (x <= jnp.maximum(a, b))
        return jnp.where(inside, x, 0.5 * (a + b))

    def step(_: object, carry: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        a, b, fa, fb, best, least = carry
        x = following(a, b, fa, fb)
        fx = function(x, fixed)
        across = fx * fb < 0.0
        a, fa = jnp.where(across, b, a), jnp.where(across, fb, 0.5 * fa)
        better = jnp.abs(fx) < least
        return a, x, fa, fx, jnp.where(better, x, best), jnp.where(better, jnp.abs(fx), least)

    a, b, fa, fb = begin
    first = jnp.where(jnp.abs(fa) < jnp.abs(fb), a, b)
    least = jnp.minimum(jnp.abs(fa), jnp.abs(fb))
    found = lax.fori_loop(0, steps, step, (a, b, fa, fb, first, least))[4]
    residual = function(found, fixed)

    @jax.custom_jvp
    def root(x: Scalar, given: Parameters) -> Scalar:
        del given
        return x

    @root.defjvp
    def _(at: tuple[Scalar, Parameters], rates: tuple[Scalar, Parameters]) -> tuple[Scalar, Scalar]:
        x, given = at
        across = jax.jvp(lambda p: function(x, p), (given,), (rates[1],))[1]
        slope = jax.jvp(lambda y: function(y, given), (x,), (jnp.ones_like(x),))[1]
        return x, jnp.where(slope == 0.0, 0.0, -across / jnp.where(slope == 0.0, 1.0, slope))

    return Root(root(found, parameters), residual)
