"""Solution of block tridiagonal systems against dense matrices."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.numerics.linear import BlockTridiagonal, solve_tridiagonal

GROUPS, SIZE = 4, 3
solved = jax.jit(solve_tridiagonal)


def dense(form):
    """The whole matrix of a block tridiagonal form."""
    diagonal, subdiagonal = np.asarray(form.diagonal), np.asarray(form.subdiagonal)
    groups, size = diagonal.shape[:2]
    full = np.zeros((groups, size, groups, size))
    for k in range(groups):
        full[k, :, k] = diagonal[k]
        if k:
            full[k, :, k - 1], full[k - 1, :, k] = subdiagonal[k], subdiagonal[k].T
    return full.reshape(groups * size, groups * size)


def random_form(seed):
    rng = np.random.default_rng(seed)
    # Of rows that reach two neighbouring groups each; what the first holds of the group before it means nothing.
    couplings = rng.normal(0.0, 1.0, (GROUPS - 1, 9, 2 * SIZE))
    diagonal, subdiagonal = np.zeros((GROUPS, SIZE, SIZE)), rng.normal(0.0, 9.0, (GROUPS, SIZE, SIZE))
    for k, part in enumerate(couplings):
        square = part.T @ part
        diagonal[k] += square[:SIZE, :SIZE]
        diagonal[k + 1] += square[SIZE:, SIZE:]
        subdiagonal[k + 1] = square[SIZE:, :SIZE]
    return BlockTridiagonal(jnp.asarray(diagonal), jnp.asarray(subdiagonal))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_solutions_equal_those_of_the_dense_matrix(seed):
    form = random_form(seed)
    right = np.random.default_rng(seed + 1).normal(0.0, 1.0, (GROUPS, SIZE))
    expected = np.linalg.solve(dense(form), right.ravel()).reshape(GROUPS, SIZE)
    np.testing.assert_allclose(solved(form, jnp.asarray(right)), expected, rtol=1e-6, atol=1e-8)
