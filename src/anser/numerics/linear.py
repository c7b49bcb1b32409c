"""Linear algebra for small dense matrices, without calls of a library, and for block tridiagonal systems."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Integer, Matrix33, Vector3

_LEAST_SQUARE = 1e-100


def cross(a: Float[Array, "*batch 3"], b: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
    """Return the vector product of two vectors, or of the rows of two arrays, in one frame."""
    a0, a1, a2 = jnp.unstack(a, axis=-1)
    b0, b1, b2 = jnp.unstack(b, axis=-1)
    return jnp.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)


def times3(matrix: Matrix33, vector: Vector3) -> Vector3:
    """Return the product of a 3x3 matrix and a vector."""
    # a sum along the rows would be slower: XLA would compute its operands anew for each of the nine terms
    first, second, third = jnp.unstack(vector)
    return matrix[:, 0] * first + matrix[:, 1] * second + matrix[:, 2] * third


def product3(a: Float[Array, "n 3"], b: Matrix33) -> Float[Array, "n 3"]:
    """Return the product of a matrix with three columns and a 3x3 matrix, shape (n, 3)."""
    return jnp.sum(a[:, :, None] * b[None, :, :], axis=1)


def inverse3(matrix: Matrix33, floor: float = 1e-12) -> Matrix33:
    """Return the inverse of a 3x3 matrix.

    If |determinant| is below `floor` times the product of the column lengths, the result is finite but no useful
    inverse.
    """
    # The smallest length under the root keeps derivatives in range where a column is zero.
    smallest_square = max(_LEAST_SQUARE, 1e8 * float(jnp.finfo(matrix.dtype).tiny))
    lengths = jnp.sqrt(jnp.sum(matrix * matrix, axis=0) + smallest_square)
    unit = matrix / lengths[None, :]
    a, b, c = jnp.unstack(unit, axis=1)
    unscaled_inverse = cross(jnp.stack([b, c, a]), jnp.stack([c, a, b]))
    determinant = jnp.sum(a * unscaled_inverse[0])
    bound = jnp.where(determinant < 0, -floor, floor)
    safe_determinant = jnp.where(jnp.abs(determinant) < floor, bound, determinant)
    return unscaled_inverse / (safe_determinant * lengths[:, None])


def solve3(matrix: Matrix33, vector: Vector3) -> Vector3:
    """Return the solution x (3,) of matrix @ x = vector; for singular matrices see `inverse3`."""
    return times3(inverse3(matrix), vector)


def solve_positive(matrix: Float[Array, "n n"], vector: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the solution x (n,) of matrix @ x = vector for a small positive definite matrix."""
    count = vector.shape[0]

    def eliminate(k: Integer, augmented: Array) -> Array:
        pivot = augmented[k] / augmented[k, k]
        return (augmented - augmented[:, k, None] * pivot[None, :]).at[k].set(pivot)

    return jax.lax.fori_loop(0, count, eliminate, jnp.concatenate([matrix, vector[:, None]], axis=1))[:, count]


Groups = Float[Array, "groups n"]


class BlockTridiagonal(NamedTuple):
    """A symmetric block tridiagonal matrix with n by n blocks, for groups of n unknowns.

    `diagonal` holds the diagonal block of each group. `subdiagonal` holds the block of each group (row) with the
    preceding group (column); the first of these blocks is unused.
    """

    diagonal: Float[Array, "groups n n"]
    subdiagonal: Float[Array, "groups n n"]


def solve_tridiagonal(form: BlockTridiagonal, right: Groups) -> Groups:
    """Return the solution of a positive definite block tridiagonal system with the right-hand side `right`."""
    lower = jax.scipy.linalg.solve_triangular

    def eliminate(carry: tuple[Array, Array], group: tuple[Array, Array, Array]) -> tuple[Any, Any]:
        factor, intermediate = carry
        diagonal, subdiagonal, right_side = group
        across = lower(factor, subdiagonal.T, lower=True).T
        factor = jnp.linalg.cholesky(diagonal - across @ across.T)
        intermediate = lower(factor, right_side - across @ intermediate, lower=True)
        return (factor, intermediate), (factor, across, intermediate)

    size = right.shape[1]
    subdiagonals = form.subdiagonal.at[0].set(0.0)
    start = (jnp.eye(size), jnp.zeros(size))
    _, (factors, acrosses, intermediates) = jax.lax.scan(eliminate, start, (form.diagonal, subdiagonals, right))

    def substitute(following: tuple[Array, Array], group: tuple[Array, Array, Array]) -> tuple[Any, Array]:
        following_across, following_solution = following
        factor, across, intermediate = group
        solution = lower(factor, intermediate - following_across.T @ following_solution, lower=True, trans="T")
        return (across, solution), solution

    end = (jnp.zeros((size, size)), jnp.zeros(size))
    return jax.lax.scan(substitute, end, (factors, acrosses, intermediates), reverse=True)[1]
