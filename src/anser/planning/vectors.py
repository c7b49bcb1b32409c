"""Length and direction of a vector with finite gradients at zero."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Scalar, Vector3


def norm(vector: Float[Array, " k"]) -> Scalar:
    """Euclidean length; its gradient at the zero vector is zero."""
    square = jnp.sum(vector * vector)
    return jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)


def unit(vector: Vector3, fallback: Vector3) -> Vector3:
    """Direction of a vector, or the fallback where its length is zero (with zero gradient there)."""
    length = norm(vector)
    return jnp.where(length > 0.0, vector / jnp.where(length > 0.0, length, 1.0), fallback)
