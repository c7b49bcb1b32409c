"""Known wrong results of JAX versions: 0.10.2 is excluded in pyproject.toml for this reason."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest


@pytest.mark.parametrize(("dtype", "count"), [(jnp.float64, 20_000), (jnp.float32, 40_000)])
def test_a_constant_matrix_times_a_batched_row_and_a_sum(dtype, count):
    """Issue 39103 of jax-ml/jax: 0.10.2 on a CPU gives 3,616 wrong rows of 20,000 in float64, silently."""
    expected_root = jnp.arange(count, dtype=dtype)
    vectors = jnp.stack([expected_root, jnp.zeros_like(expected_root), jnp.zeros_like(expected_root)], axis=1)
    squares = jax.jit(jax.vmap(lambda vector: jnp.sum((jnp.eye(3, dtype=dtype) @ vector) ** 2)))(vectors)
    # Exact but for the rounding of one square.
    np.testing.assert_allclose(
        squares, np.asarray(expected_root, dtype=float) ** 2, rtol=2 * float(jnp.finfo(dtype).eps)
    )


def test_a_gather_from_a_constant():
    """Issue 33479 of jax-ml/jax: before jaxlib 0.8.2, constant folding gave wrong numbers for a gather."""
    table = jnp.arange(18, dtype=jnp.int32).reshape(3, 6)
    columns = jnp.arange(6)
    gathered = jax.jit(lambda: jax.vmap(lambda entries: entries[columns])(table) + 1)()
    np.testing.assert_array_equal(gathered, np.arange(18).reshape(3, 6) + 1)
