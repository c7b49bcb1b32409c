"""Block tridiagonal forms against the whole matrix."""

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
    own, before = np.asarray(form.diagonal), np.asarray(form.subdiagonal)
    groups, size = own.shape[:2]
    full = np.zeros((groups, size, groups, size))
    for k in range(groups):
        full[k, :, k] = own[k]
        if k:
            full[k, :, k - 1], full[k - 1, :, k] = before[k], before[k].T
    return full.reshape(groups * size, groups * size)


def random_form(seed):
    rng = np.random.default_rng(seed)
    # Of rows that reach two neighbouring groups each; what the first holds of the group before it means nothing.
    rows = rng.normal(0.0, 1.0, (GROUPS - 1, 9, 2 * SIZE))
    own, before = np.zeros((GROUPS, SIZE, SIZE)), rng.normal(0.0, 9.0, (GROUPS, SIZE, SIZE))
    for k, part in enumerate(rows):
        square = part.T @ part
        own[k] += square[:SIZE, :SIZE]
        own[k + 1] += square[SIZE:, SIZE:]
        before[k + 1] = square[SIZE:, :SIZE]
    return BlockTridiagonal(jnp.asarray(own), jnp.asarray(before))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_solves_what_the_whole_matrix_would(seed):
    form = random_form(seed)
    right = np.random.default_rng(seed + 1).normal(0.0, 1.0, (GROUPS, SIZE))
    expected = np.linalg.solve(dense(form), right.ravel()).reshape(GROUPS, SIZE)
    np.testing.assert_allclose(solved(form, jnp.asarray(right)), expected, rtol=1e-6, atol=1e-8)
