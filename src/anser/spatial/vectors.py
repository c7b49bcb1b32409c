"""Square roots, lengths and directions of vectors, with finite gradients at zero."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Vector3


def safe_sqrt(square: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Return the square root of a positive number; otherwise 0 with zero gradient."""
    # `jax.lax.select` adds a third of the equations of `jnp.where`.
    positive = square > 0.0
    root = jnp.sqrt(jax.lax.select(positive, square, jnp.ones_like(square)))
    return jax.lax.select(positive, root, jnp.zeros_like(square))


def norm(vector: Float[Array, "..."], axis: int = -1) -> Float[Array, "..."]:
    """Return the Euclidean length of a vector, or of vectors along an axis, with zero gradient at the zero vector."""
    return safe_sqrt(jnp.sum(vector * vector, axis=axis))


def unit_vector(vector: Vector3, fallback: Vector3) -> Vector3:
    """Return the unit vector along a vector; `fallback`, with zero gradient, for the zero vector."""
    length = norm(vector)
    return jnp.where(length > 0.0, vector / jnp.where(length > 0.0, length, 1.0), fallback)
