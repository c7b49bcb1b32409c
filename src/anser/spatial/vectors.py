"""Square roots, lengths and directions of vectors, with finite gradients at zero."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Vector3


def safe_sqrt(square: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Return the square root of each positive entry; 0 with zero gradient for zero and negative entries."""
    # `jax.lax.select` adds a third of the equations of `jnp.where`.
    positive = square > 0.0
    root = jnp.sqrt(jax.lax.select(positive, square, jnp.ones_like(square)))
    return jax.lax.select(positive, root, jnp.zeros_like(square))


def norm(vector: Float[Array, "..."], axis: int = -1) -> Float[Array, "..."]:
    """Return the Euclidean length of the vectors along an axis of an array, with zero gradient at the zero vector."""
    return safe_sqrt(jnp.sum(vector * vector, axis=axis))


def unit_vector(vector: Vector3, fallback: Vector3) -> Vector3:
    """Return the unit vector along `vector` (3,); for the zero vector, return `fallback` with zero gradient."""
    length = norm(vector)
    return jnp.where(length > 0.0, vector / jnp.where(length > 0.0, length, 1.0), fallback)
