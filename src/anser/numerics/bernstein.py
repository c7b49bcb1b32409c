"""Polynomials on an interval in Bernstein form, bounded by their coefficients.

A polynomial of degree n is sum_k c_k C(n, k) u^k (1 - u)^(n - k) on 0 <= u <= 1, with binomial coefficients C(n, k).
The values lie between the least and the greatest c_k. The coefficients c_k run along the last axis of an array.
"""

import functools
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Coefficients = Float[Array, "*batch n"]


@functools.lru_cache
def _convolution(m: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return weights and indices of the product c[k] = sum_i weights[k, i] a[i] b[indices[k, i]] of degrees m and n."""
    weights, indices = np.zeros((m + n + 1, m + 1)), np.zeros((m + n + 1, m + 1), dtype=int)
    for i in range(m + 1):
        for j in range(n + 1):
            weights[i + j, i] = math.comb(m, i) * math.comb(n, j) / math.comb(m + n, i + j)
            indices[i + j, i] = j
    return weights, indices


def product(a: Coefficients, b: Float[Array, "*batch m"]) -> Float[Array, "*batch k"]:
    """Return the Bernstein coefficients of the product of two polynomials; the degree is the sum of both degrees."""
    if a.shape[-1] < b.shape[-1]:
        a, b = b, a
    weights, indices = _convolution(a.shape[-1] - 1, b.shape[-1] - 1)
    # A dot product with every pair of coefficients takes three times as long on a CPU.
    weights = weights.reshape(*[1] * (a.ndim - 1), *weights.shape)
    return jnp.sum(jnp.asarray(weights) * a[..., None, :] * b[..., indices], axis=-1)


def elevate(a: Coefficients, degree: int) -> Float[Array, "*batch m"]:
    """Return the Bernstein coefficients of a polynomial for the degree `degree`; raises ValueError if it is too low."""
    missing = degree - (a.shape[-1] - 1)
    if missing < 0:
        raise ValueError(f"a polynomial of degree {a.shape[-1] - 1} cannot be written with degree {degree}")
    return a @ jnp.asarray(_convolution(a.shape[-1] - 1, missing)[0].T)


def bounds(a: Coefficients) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
    """Return a lower and an upper bound of a polynomial on the interval: the least and the greatest coefficient."""
    return jnp.min(a, axis=-1), jnp.max(a, axis=-1)
