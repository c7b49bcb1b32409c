"""Square roots, lengths and directions of vectors, with finite gradients at zero."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Scalar, Vector3


def safe_sqrt(square: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Return the square root of a positive number; otherwise 0 with zero gradient."""
    positive = square > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def norm(vector: Float[Array, " k"]) -> Scalar:
    """Return the Euclidean length of a vector, with zero gradient at the zero vector."""
    return safe_sqrt(jnp.sum(vector * vector))


def unit_vector(vector: Vector3, fallback: Vector3) -> Vector3:
    """Return the unit vector along a vector; `fallback`, with zero gradient, for the zero vector."""
    length = norm(vector)
    return jnp.where(length > 0.0, vector / jnp.where(length > 0.0, length, 1.0), fallback)
