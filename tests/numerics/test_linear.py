"""Small algebra against numpy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from anser.numerics.linear import inverse3, solve3, times3

entries = st.floats(-10.0, 10.0).map(lambda x: x if abs(x) > 1e-3 else 0.0)
matrices, vectors = arrays(float, (3, 3), elements=entries), arrays(float, 3, elements=entries)
inverse, solve, times = jax.jit(inverse3), jax.jit(solve3), jax.jit(times3)
slopes = jax.jit(jax.jacrev(solve3, argnums=(0, 1)))

SINGULAR = {
    "zero": np.zeros((3, 3)),
    "rank one": np.outer([1.0, 2.0, -3.0], [0.5, -1.0, 2.0]),
    "rank two": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [5.0, 7.0, 9.0]]),
    "a column of zeros": np.array([[1.0, 0.0, 3.0], [4.0, 0.0, 6.0], [7.0, 0.0, 1.0]]),
    "nearly singular": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [5.0, 7.0, 9.0 + 1e-14]]),
    "huge": 1e60 * np.outer([1.0, 2.0, -3.0], [0.5, -1.0, 2.0]),
    "tiny": 1e-60 * np.outer([1.0, 2.0, -3.0], [0.5, -1.0, 2.0]),
}


@settings(deadline=None, max_examples=60)
@given(matrix=matrices, vector=vectors)
def test_the_product_agrees_with_numpy(matrix, vector):
    # Three products of up to 100 each.
    np.testing.assert_allclose(times(matrix, vector), matrix @ vector, atol=1e-13)


@settings(deadline=None, max_examples=60)
@given(matrix=matrices, vector=vectors)
def test_inverse_and_solution_agree_with_numpy(matrix, vector):
    condition = np.linalg.cond(matrix)
    assume(condition < 1e6)
    expected = np.linalg.inv(matrix)
    size = np.max(np.abs(expected))
    # Cramer's rule is not backward stable: it may lose the condition number squared, 1e-16 at 1, 1e-4 at 1e6.
    tolerance = 1e-15 * max(condition, 10.0) ** 2
    np.testing.assert_allclose(inverse(matrix), expected, atol=tolerance * size)
    np.testing.assert_allclose(solve(matrix, vector), expected @ vector, atol=10.0 * tolerance * size * 3.0)


def test_the_inverse_is_independent_of_the_scale_of_columns():
    # The floor is relative to the columns: units of the rows and columns are the caller's affair.
    matrix = np.array([[2.0, -1.0, 0.3], [0.5, 3.0, -0.7], [1.0, 0.2, 1.5]])
    for scales in ([1.0, 1e-8, 1e8], [1e-20, 1e-20, 1e-20], [1e15, 1.0, 1e-15]):
        scaled = matrix * np.array(scales)[None, :]
        # Rows of the inverse scale the other way round; rounding.
        np.testing.assert_allclose(
            np.asarray(inverse(scaled)) * np.array(scales)[:, None], np.linalg.inv(matrix), rtol=1e-13
        )


@pytest.mark.parametrize("name", SINGULAR)
def test_results_for_singular_matrices_stay_finite(name):
    matrix, vector = jnp.asarray(SINGULAR[name]), jnp.array([1.0, -2.0, 3.0])
    for value in (inverse(matrix), solve(matrix, vector), *slopes(matrix, vector)):
        assert jnp.all(jnp.isfinite(value))


@settings(deadline=None, max_examples=30)
@given(matrix=matrices, vector=vectors)
def test_results_for_any_matrix_stay_finite(matrix, vector):
    for value in (inverse(matrix), solve(matrix, vector), *slopes(matrix, vector)):
        assert jnp.all(jnp.isfinite(value))


@settings(deadline=None, max_examples=30)
@given(matrix=matrices, vector=vectors)
def test_the_gradient_equals_the_implicit_derivative(matrix, vector):
    assume(np.linalg.cond(matrix) < 1e3)
    # From A x = b: dx = A^-1 (db - dA x).
    inverse_matrix = np.linalg.inv(matrix)
    x = inverse_matrix @ vector
    by_matrix, by_vector = slopes(matrix, vector)
    scale = np.max(np.abs(inverse_matrix)) * (1.0 + np.max(np.abs(x)))
    # Condition squared times rounding, as for the inverse, and once more for its derivative.
    np.testing.assert_allclose(by_vector, inverse_matrix, atol=1e-9 * scale)
    np.testing.assert_allclose(by_matrix, -inverse_matrix[:, :, None] * x[None, None, :], atol=1e-6 * scale)


def test_a_batch_equals_single_evaluations():
    rng = np.random.default_rng(3)
    batch, sides = jnp.asarray(rng.normal(size=(20, 3, 3))), jnp.asarray(rng.normal(size=(20, 3)))
    together = jax.jit(jax.vmap(solve3))(batch, sides)
    np.testing.assert_allclose(together, np.linalg.solve(batch, sides[..., None])[..., 0], rtol=1e-9)
    np.testing.assert_allclose(together, [solve(m, v) for m, v in zip(batch, sides, strict=True)], rtol=1e-12)
