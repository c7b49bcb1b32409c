"""Levenberg-Marquardt and the implicit derivative of its root."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.numerics.least_squares import damped_solve, levenberg_marquardt, with_implicit_derivative


def _curved(x, p):
    """Two residuals with the root x = (p0, p1 / p0), reached along a bent valley (Rosenbrock's, scaled)."""
    return jnp.stack([x[0] - p[0], 3.0 * (x[0] * x[1] - p[1])])


solve_curved = jax.jit(lambda p, start: levenberg_marquardt(_curved, p, start))


@settings(deadline=None, max_examples=30)
@given(
    p=st.tuples(st.floats(0.5, 3.0), st.floats(-2.0, 2.0)),
    offset=st.tuples(st.floats(0.7, 1.5), st.floats(-0.5, 0.5)),
)
def test_the_search_finds_a_known_root(p, offset):
    root = [p[0], p[1] / p[0]]
    # Beside the root: the valley x0 x1 = p1 also leads away from it, to a minimum at infinity where x0 nears 0.
    solution = solve_curved(jnp.array(p), jnp.array([root[0] * offset[0], root[1] + offset[1]]))
    # Residuals below 1e-12; the smallest singular value of the Jacobian is above 0.2 there.
    np.testing.assert_allclose(solution.x, root, atol=1e-11)
    assert float(solution.residual) <= 1e-12


@settings(deadline=None, max_examples=30)
@given(
    p=st.tuples(st.floats(0.5, 3.0), st.floats(-2.0, 2.0)),
    start=st.tuples(st.floats(0.1, 5.0), st.floats(-3.0, 3.0)),
)
def test_the_reported_residual_is_correct_from_any_start(p, start):
    solution = solve_curved(jnp.array(p), jnp.array(start))
    residuals = np.asarray(_curved(solution.x, jnp.array(p)))
    np.testing.assert_allclose(solution.residual, np.max(np.abs(residuals)), rtol=1e-9, atol=1e-13)
    # The sum of squares never rises.
    at_start = np.asarray(_curved(jnp.array(start), jnp.array(p)))
    assert np.sum(residuals**2) <= np.sum(at_start**2) * (1 + 1e-12) + 1e-24


def test_an_exact_start_is_unchanged():
    solution = solve_curved(jnp.array([2.0, 3.0]), jnp.array([2.0, 1.5]))
    np.testing.assert_array_equal(solution.x, [2.0, 1.5])
    assert float(solution.residual) == 0.0


def test_the_search_passes_a_kink():
    # Slopes 1 and 4 meet at 1: a step taken with the slope of the wrong side is shortened, not lost.
    def kinked(x, p):
        return jnp.where(x > 1.0, 4.0 * (x - 1.0), x - 1.0) - p

    solve_kinked = jax.jit(lambda p, start: levenberg_marquardt(kinked, p, start))
    for p, root in ((2.0, 1.5), (-2.0, -1.0)):
        for start in (-5.0, 5.0):
            solution = solve_kinked(p, jnp.array([start]))
            np.testing.assert_allclose(solution.x, [root], atol=1e-12)


def test_without_a_root_the_residual_is_reported():
    # x^2 + 1 is at least 1; Gauss-Newton directions creep toward the minimum at 0, the start has 1.49.
    solution = jax.jit(lambda start: levenberg_marquardt(lambda x, p: x**2 + p, 1.0, start))(jnp.array([0.7]))
    assert 1.0 <= float(solution.residual) < 1.01
    np.testing.assert_allclose(solution.residual, solution.x[0] ** 2 + 1.0, rtol=1e-15)


def test_values_that_are_not_a_number_are_never_accepted():
    solve_logarithm = jax.jit(lambda start: levenberg_marquardt(lambda x, p: jnp.log(x) - p, 0.0, start))
    np.testing.assert_allclose(solve_logarithm(jnp.array([3.0])).x, [1.0], atol=1e-12)
    lost = solve_logarithm(jnp.array([-3.0]))
    assert float(lost.x[0]) == -3.0
    assert not float(lost.residual) <= 1e-12


def _root(p):
    solution = levenberg_marquardt(_curved, p, jnp.array([1.0, 1.0]))
    return with_implicit_derivative(_curved, p, solution.x)


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_the_derivative_equals_that_of_the_known_root(derivative):
    a, b = 1.7, 0.6
    # Normal equations: the condition squared, 1e2, times rounding.
    slopes = jax.jit(derivative(_root))(jnp.array([a, b]))
    np.testing.assert_allclose(slopes, [[1, 0], [-b / a**2, 1 / a]], atol=1e-12)


def test_the_derivative_at_a_singular_root_is_finite():
    def flat(p):
        return with_implicit_derivative(lambda x, p: x**2 - p, p, jnp.array([0.0]))[0]

    assert np.isfinite(jax.jit(jax.grad(flat))(0.0))


def test_a_batch_equals_single_searches():
    p = jnp.array([[1.0, 2.0], [2.5, -1.0], [0.6, 0.1]])
    batch = jax.jit(jax.vmap(lambda q: levenberg_marquardt(_curved, q, jnp.ones(2))))(p)
    np.testing.assert_allclose(batch.x, [solve_curved(q, jnp.ones(2)).x for q in p], atol=1e-12)


def test_damping_shortens_the_step():
    matrix, vector = np.array([[2.0, 1.0], [0.0, 3.0]]), np.array([1.0, -2.0])
    solve = jax.jit(damped_solve)
    undamped, *_, strongly_damped = steps = [np.asarray(solve(matrix, vector, d)) for d in (0.0, 1.0, 100.0, 1e9)]
    np.testing.assert_allclose(matrix @ undamped, vector, atol=1e-12)
    lengths = [np.linalg.norm(step) for step in steps]
    assert lengths == sorted(lengths, reverse=True)
    # Steepest descent in the limit.
    np.testing.assert_allclose(1e9 * strongly_damped, matrix.T @ vector, rtol=1e-7)
