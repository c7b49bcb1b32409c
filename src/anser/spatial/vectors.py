"""Roots, lengths and directions with finite gradients at zero."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Scalar, Vector3


def safe_sqrt(square: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Square root; 0 with zero gradient of what is not positive."""
    positive = square > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def norm(vector: Float[Array, " k"]) -> Scalar:
    """Euclidean length; its gradient at the zero vector is zero."""
    return safe_sqrt(jnp.sum(vector * vector))


def unit_vector(vector: Vector3, fallback: Vector3) -> Vector3:
    """Direction of a vector, or the fallback where its length is zero (with zero gradient there)."""
    length = norm(vector)
    return jnp.where(length > 0.0, vector / jnp.where(length > 0.0, length, 1.0), fallback)
