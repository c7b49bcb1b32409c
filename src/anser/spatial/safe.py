"""Lengths and angles whose gradients stay finite where the plain formula has none: at zero.

At zero the value is zero and the gradient is zero. "Zero" reaches up to a squared length of 1e-290, because below
that the squares inside the derivatives underflow.
"""

import jax.numpy as jnp

from anser.shapes import Flag, Scalar, ScalarLike, Vector3

_TINY_SQUARED = 1e-290


def safe_norm(v: Vector3) -> Scalar:
    """Length of a vector (3,), any unit; 0 with zero gradient at the zero vector."""
    return _safe_sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def safe_hypot(x: ScalarLike, y: ScalarLike) -> Scalar:
    """Length of (x, y), any unit; 0 with zero gradient at the origin."""
    x, y = jnp.asarray(x), jnp.asarray(y)
    return _safe_sqrt(x * x + y * y)


def safe_atan2(y: ScalarLike, x: ScalarLike) -> Scalar:
    """Angle of the point (x, y), rad in [-pi, pi]; 0 with zero gradient at the origin."""
    x, y = jnp.asarray(x), jnp.asarray(y)
    undefined = _is_zero(x * x + y * y)
    return jnp.arctan2(jnp.where(undefined, 0.0, y), jnp.where(undefined, 1.0, x))


def _safe_sqrt(squared: Scalar) -> Scalar:
    zero = _is_zero(squared)
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, squared)))


def _is_zero(squared: Scalar) -> Flag:
    return squared < max(_TINY_SQUARED, float(jnp.finfo(squared.dtype).tiny))
