"""Roots of a scalar function within a bracket, with a fixed number of steps and the implicit derivative."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from anser.shapes import Scalar, ScalarLike

Parameters = TypeVar("Parameters")


class Root(NamedTuple):
    """Root x of a function, and the function's value there (residual)."""

    x: Scalar
    residual: Scalar


def bracketed_newton(
    # maps x and the parameters to the value and the slope with respect to x. Differentiable inputs must be in
    # `parameters`, not in a closure
    function: Callable[[Scalar, Parameters], tuple[Scalar, Scalar]],
    parameters: Parameters,  # any pytree
    # bracket, low <= high. If the function does not change sign, the result is no root: check `residual`
    low: ScalarLike,
    high: ScalarLike,
    guess: ScalarLike,  # initial x, clipped to the bracket
    steps: int,  # number of function evaluations in the loop
) -> Root:
    """Return a root of a scalar function that is zero or negative at `low`, and zero or positive at `high`.

    The method is Newton's with bisection as the safeguard; the evaluated point of least residual is returned. The root
    carries the derivative dx = -(df/dp) dp / (df/dx), or zero if df/dx is zero; first derivatives only.
    """
    fixed, low, high, guess = lax.stop_gradient((parameters, jnp.asarray(low), jnp.asarray(high), jnp.asarray(guess)))
    low, high = low.astype(float), high.astype(float)
    start = jnp.clip(guess.astype(float), low, high)

    def step(_: object, carry: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        x, low, high, last_length, length_before, best, residual = carry
        value, slope = function(x, fixed)
        better = jnp.abs(value) < jnp.abs(residual)
        best, residual = jnp.where(better, x, best), jnp.where(better, value, residual)
        low, high = jnp.where(value < 0.0, x, low), jnp.where(value < 0.0, high, x)
        newton = x - value / jnp.where(slope == 0.0, 1.0, slope)
        inside = (newton >= low) & (newton <= high) & (slope != 0.0)
        take = inside & (jnp.abs(newton - x) <= 0.5 * length_before)
        following = jnp.where(take, newton, 0.5 * (low + high))
        return following, low, high, jnp.abs(following - x), last_length, best, residual

    # Twice the width lets the first two Newton steps go anywhere inside the bracket.
    width = 2.0 * (high - low)
    unknown = jnp.full_like(start, jnp.inf)
    root, residual = lax.fori_loop(0, steps, step, (start, low, high, width, width, start, unknown))[5:]
    return Root(implicit_root(function, parameters, root), residual)


@eqx.filter_custom_jvp
def implicit_root(function: Callable, parameters: object, root: Scalar) -> Scalar:
    """Return `root` with its derivative with respect to the parameters, by the implicit function theorem.

    `function(x, parameters)` returns a value and its slope with respect to x; at slope zero the derivative is zero.
    """
    return root


@implicit_root.def_jvp
def _implicit_jvp(primals: tuple, tangents: tuple) -> tuple[Scalar, Scalar]:
    function, parameters, root = primals
    (_, slope), (change, _) = eqx.filter_jvp(lambda p: function(root, p), (parameters,), (tangents[1],))
    return root, jnp.where(slope == 0.0, 0.0, -change / jnp.where(slope == 0.0, 1.0, slope))


def bracketed_secant(
    # function of x and the parameters; differentiable inputs must be in `parameters`
    function: Callable[[Scalar, Parameters], Scalar],
    parameters: Parameters,  # any pytree
    # bracket
    low: ScalarLike,
    high: ScalarLike,
    # values at the endpoints. If the function does not change sign, the result is no root: check `residual`
    value_low: ScalarLike,
    value_high: ScalarLike,
    steps: int,  # number of function evaluations in the loop
) -> Root:
    """Return a root of a scalar function with opposite signs at the bracket's endpoints, by the Illinois method.

    The evaluated point of least residual is returned. The root carries the derivative dx = -(df/dp) dp / (df/dx), or
    zero if df/dx is zero; first derivatives only.
    """
    fixed = lax.stop_gradient(parameters)
    begin = tuple(lax.stop_gradient(jnp.asarray(x, dtype=float)) for x in (low, high, value_low, value_high))

    def following(a: Scalar, b: Scalar, fa: Scalar, fb: Scalar) -> Scalar:
        gap = fb - fa
        x = b - fb * (b - a) / jnp.where(gap == 0.0, 1.0, gap)
        inside = (gap != 0.0) & (x >= jnp.minimum(a, b)) & (x <= jnp.maximum(a, b))
        return jnp.where(inside, x, 0.5 * (a + b))

    def step(_: object, carry: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        a, b, fa, fb, best, residual = carry
        x = following(a, b, fa, fb)
        fx = function(x, fixed)
        across = fx * fb < 0.0
        a, fa = jnp.where(across, b, a), jnp.where(across, fb, 0.5 * fa)
        better = jnp.abs(fx) < jnp.abs(residual)
        return a, x, fa, fx, jnp.where(better, x, best), jnp.where(better, fx, residual)

    a, b, fa, fb = begin
    first_is_better = jnp.abs(fa) < jnp.abs(fb)
    start, start_residual = jnp.where(first_is_better, a, b), jnp.where(first_is_better, fa, fb)
    best_x, residual = lax.fori_loop(0, steps, step, (a, b, fa, fb, start, start_residual))[4:]

    def with_slope(x: Scalar, values: Parameters) -> tuple[Scalar, Scalar]:
        return jax.jvp(lambda y: function(y, values), (x,), (jnp.ones_like(x),))

    return Root(implicit_root(with_slope, parameters, best_x), residual)
