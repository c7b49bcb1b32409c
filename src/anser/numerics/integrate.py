"""Fixed-step integration."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp

from anser.numerics.arrays import typed_as
from anser.shapes import ScalarLike

Y = TypeVar("Y")


def rk4_step(derivative: Callable[[ScalarLike, Y], Y], t: ScalarLike, y: Y, h: ScalarLike) -> Y:
    """Advance y (any pytree) by one step h with the classical fourth-order Runge-Kutta method.

    `derivative(t, y)` returns a pytree of y's structure. Source: Hairer, Norsett, Wanner, *Solving ODEs I*, table 1.2.
    """

    def shifted(scale: ScalarLike, slope: Y) -> Y:
        return jax.tree.map(lambda a, b: a + scale * b, y, slope)

    def stage(slope: Y, part: ScalarLike) -> tuple[Y, Y]:
        slope = typed_as(derivative(t + part * h, shifted(part * h, slope)), y)
        return slope, slope

    # One copy of the derivative in the compiled code.
    zero = jax.tree.map(jnp.zeros_like, y)
    k = jax.lax.scan(stage, zero, jnp.asarray([0.0, 0.5, 0.5, 1.0], jnp.result_type(h, *jax.tree.leaves(y))))[1]
    return jax.tree.map(lambda a, k: a + h / 6 * (k[0] + 2 * (k[1] + k[2]) + k[3]), y, k)
