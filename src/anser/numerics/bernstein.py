"""Polynomials on an interval in Bernstein form, bounded by their coefficients.

A polynomial of degree n is sum_k c_k C(n, k) u^k (1 - u)^(n - k) on 0 <= u <= 1; its values lie between the least and
the greatest coefficient. Coefficients run along the last axis.
"""

import functools
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Coefficients = Float[Array, "*batch n"]


@functools.lru_cache
def _product_weights(m: int, n: int) -> np.ndarray:
    weights = np.zeros((m + n + 1, m + 1, n + 1))
    for i in range(m + 1):
        for j in range(n + 1):
            weights[i + j, i, j] = math.comb(m, i) * math.comb(n, j) / math.comb(m + n, i + j)
    return weights


def product(a: Coefficients, b: Float[Array, "*batch m"]) -> Float[Array, "*batch k"]:
    """Return the Bernstein coefficients of the product of two polynomials; its degree is the sum of their degrees."""
    weights = jnp.asarray(_product_weights(a.shape[-1] - 1, b.shape[-1] - 1))
    return jnp.einsum("kij,...i,...j->...k", weights, a, b)


def elevate(a: Coefficients, degree: int) -> Float[Array, "*batch m"]:
    """Return the Bernstein coefficients of the same polynomial written with a higher degree."""
    missing = degree - (a.shape[-1] - 1)
    if missing < 0:
        raise ValueError(f"a polynomial of degree {a.shape[-1] - 1} cannot be written with degree {degree}")
    return a @ jnp.asarray(np.sum(_product_weights(a.shape[-1] - 1, missing), axis=2).T)


def bounds(a: Coefficients) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Return a lower and an upper bound of the polynomial on the interval: the least and the greatest coefficient."""
    return jnp.min(a, axis=-1), jnp.max(a, axis=-1)
