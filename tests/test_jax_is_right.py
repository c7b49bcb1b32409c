"""The installed jax computes what it should: version 0.10.2 did not, which is why pyproject.toml excludes it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest


@pytest.mark.parametrize(("dtype", "count"), [(jnp.float64, 20_000), (jnp.float32, 40_000)])
def test_a_constant_matrix_times_a_batched_row_and_a_sum(dtype, count):
    """Issue 39103 of jax-ml/jax: with 0.10.2 on a CPU, 3,616 of 20,000 rows are wrong in float64, without a word."""
    first = jnp.arange(count, dtype=dtype)
    rows = jnp.stack([first, jnp.zeros_like(first), jnp.zeros_like(first)], axis=1)
    found = jax.jit(jax.vmap(lambda row: jnp.sum((jnp.eye(3, dtype=dtype) @ row) ** 2)))(rows)
    # Exact but for the rounding of one square.
    np.testing.assert_allclose(found, np.asarray(first, dtype=float) ** 2, rtol=2 * float(jnp.finfo(dtype).eps))


def test_a_gather_from_a_constant():
    """Issue 33479 of jax-ml/jax: before jaxlib 0.8.2 a gather from a constant was folded to wrong numbers."""
    table = jnp.arange(18, dtype=jnp.int32).reshape(3, 6)
    columns = jnp.arange(6)
    found = jax.jit(lambda: jax.vmap(lambda row: row[columns])(table) + 1)()
    np.testing.assert_array_equal(found, np.arange(18).reshape(3, 6) + 1)
