"""Roots of a scalar function within a bracket.

By Newton's method or the Illinois method, with a fixed number of steps and the implicit derivative of the root.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from anser.shapes import Scalar, ScalarLike

Parameters = TypeVar("Parameters")


class Root(NamedTuple):
    """A root and what is left of the function there."""

    x: Scalar
    residual: Scalar


def bracketed_newton(
    function: Callable[[Scalar, Parameters], tuple[Scalar, Scalar]],
    parameters: Parameters,
    low: ScalarLike,
    high: ScalarLike,
    guess: ScalarLike,
    steps: int,
) -> Root:
    """Root of a scalar function that is not positive at `low` and not negative at `high`.

    A Newton step is taken where it stays inside the bracket and is at most half as long as the step before the last;
    otherwise the bracket is halved. The number of steps is fixed (no early exit), so that a batch takes equal time
    for each member. The best point seen is returned: rounding noise near the root cannot spoil it.

    The steps are not differentiated. The root carries its derivative by the implicit function theorem,
    dx = -(df/dp) dp / (df/dx); where df/dx is zero there, the derivative is reported as zero. First derivatives only.

    Parameters
    ----------
    function
        Takes x and the parameters, returns the value and its slope with respect to x. It must reach everything that
        is to be differentiated through `parameters`, not through a closure.
    parameters
        Any pytree.
    low, high
        The bracket, low <= high. Without a change of sign between them the result is the point of least residual
        among those tried: look at `residual`.
    guess
        Where to start; clipped to the bracket.
    steps
        Number of function evaluations in the loop.
    """
    fixed, low, high, guess = lax.stop_gradient((parameters, jnp.asarray(low), jnp.asarray(high), jnp.asarray(guess)))
    low, high = low.astype(float), high.astype(float)
    start = jnp.clip(guess.astype(float), low, high)

    def step(_: object, carry: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        x, low, high, last, before_last, best, residual = carry
        value, slope = function(x, fixed)
        better = jnp.abs(value) < jnp.abs(residual)
        best, residual = jnp.where(better, x, best), jnp.where(better, value, residual)
        low, high = jnp.where(value < 0.0, x, low), jnp.where(value < 0.0, high, x)
        newton = x - value / jnp.where(slope == 0.0, 1.0, slope)
        inside = (newton >= low) & (newton <= high) & (slope != 0.0)
        take = inside & (jnp.abs(newton - x) <= 0.5 * before_last)
        following = jnp.where(take, newton, 0.5 * (low + high))
        return following, low, high, jnp.abs(following - x), last, best, residual

    # Twice the width lets the first two Newton steps go anywhere inside the bracket.
    width = 2.0 * (high - low)
    unknown = jnp.full_like(start, jnp.inf)
    found, residual = lax.fori_loop(0, steps, step, (start, low, high, width, width, start, unknown))[5:]
    return Root(_implicit(function, parameters, found), residual)


@eqx.filter_custom_jvp
def _implicit(function: Callable, parameters: object, root: Scalar) -> Scalar:
    return root


@_implicit.def_jvp
def _implicit_jvp(primals: tuple, tangents: tuple) -> tuple[Scalar, Scalar]:
    function, parameters, root = primals
    (_, slope), (change, _) = eqx.filter_jvp(lambda p: function(root, p), (parameters,), (tangents[1],))
    return root, jnp.where(slope == 0.0, 0.0, -change / jnp.where(slope == 0.0, 1.0, slope))


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
