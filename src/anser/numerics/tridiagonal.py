"""Quadratic forms of unknowns that come in groups of which only neighbours have to do with each other.

They are block tridiagonal: to solve one costs no more than there are groups.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Groups = Float[Array, "groups n"]


class BlockTridiagonal(NamedTuple):
    """A symmetric block tridiagonal matrix.

    Attributes
    ----------
    diagonal
        Block of each group.
    subdiagonal
        Block of each group with the one before, (group, of this one, of the one before); the first is not used.
    """

    diagonal: Float[Array, "groups n n"]
    subdiagonal: Float[Array, "groups n n"]


def solve(form: BlockTridiagonal, right: Groups) -> Groups:
    """What a positive definite form maps to the right side: block elimination, then back."""
    lower = jax.scipy.linalg.solve_triangular

    def eliminate(carry: tuple[Array, Array], group: tuple[Array, Array, Array]) -> tuple[Any, Any]:
        factor, found = carry
        diagonal, subdiagonal, wanted = group
        across = lower(factor, subdiagonal.T, lower=True).T
        factor = jnp.linalg.cholesky(diagonal - across @ across.T)
        found = lower(factor, wanted - across @ found, lower=True)
        return (factor, found), (factor, across, found)

    size = right.shape[1]
    none = form.subdiagonal.at[0].set(0.0)
    begin = (jnp.eye(size), jnp.zeros(size))
    _, (factors, acrosses, founds) = jax.lax.scan(eliminate, begin, (form.diagonal, none, right))

    def back(later: tuple[Array, Array], group: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], Array]:
        across_later, solved_later = later
        factor, across, found = group
        solved = lower(factor, found - across_later.T @ solved_later, lower=True, trans="T")
        return (across, solved), solved

    _, solved = jax.lax.scan(
        back, (jnp.zeros((size, size)), jnp.zeros(size)), (factors, acrosses, founds), reverse=True
    )
    return solved
