"""Fixed-step integration."""

from collections.abc import Callable
from typing import TypeVar

import jax

from anser.shapes import ScalarLike

Y = TypeVar("Y")


def rk4_step(derivative: Callable[[ScalarLike, Y], Y], t: ScalarLike, y: Y, h: ScalarLike) -> Y:
    """Advance y (any pytree) by one step h with the classical fourth-order Runge-Kutta method.

    `derivative(t, y)` returns a pytree of y's structure. Source: Hairer, Norsett, Wanner, *Solving ODEs I*, table 1.2.
    """

    def shifted(scale: ScalarLike, slope: Y) -> Y:
        return jax.tree.map(lambda a, b: a + scale * b, y, slope)

    k1 = derivative(t, y)
    k2 = derivative(t + h / 2, shifted(h / 2, k1))
    k3 = derivative(t + h / 2, shifted(h / 2, k2))
    k4 = derivative(t + h, shifted(h, k3))
    return jax.tree.map(lambda a, p, q, r, s: a + h / 6 * (p + 2 * (q + r) + s), y, k1, k2, k3, k4)
