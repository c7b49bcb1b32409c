"""Safeguarded Newton method: roots missed by plain Newton, and the implicit derivative."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.numerics.roots import bracketed_newton


def cubic(x, p):
    return x**3 - p, 3.0 * x**2


def arctangent(x, p):
    return jnp.arctan(20.0 * (x - p)), 20.0 / (1.0 + (20.0 * (x - p)) ** 2)


def signed_root(x, p):
    # Plain Newton jumps from p + d to p - d and back for ever.
    size = jnp.sqrt(jnp.abs(x - p))
    return jnp.sign(x - p) * size, 0.5 / jnp.maximum(size, 1e-300)


find = jax.jit(lambda f, root, guess: bracketed_newton(f, root, -1.0, 1.0, guess, 60), static_argnums=0)


@settings(deadline=None, max_examples=30)
@given(root=st.floats(-0.9, 0.9), guess=st.floats(-1.5, 1.5))
@pytest.mark.parametrize("function", [arctangent, signed_root])
def test_the_solver_finds_roots_missed_by_plain_newton(function, root, guess):
    solution = find(function, jnp.asarray(root), guess)
    # 60 halvings of a width of 2 leave nothing above rounding.
    np.testing.assert_allclose(solution.x, root, atol=1e-14)


def test_convergence_from_a_good_guess_is_quadratic():
    # Errors of 1e-1, 1e-2, 1e-4, 1e-8, 1e-16: five evaluations and one to see it.
    np.testing.assert_allclose(bracketed_newton(cubic, jnp.asarray(8.0), 0.0, 10.0, 2.2, 7).x, 2.0, rtol=1e-15)


def test_many_steps_do_not_spoil_the_root():
    # A slope that is noisy at the root must not throw the result back to a bisection point.
    for steps in range(8, 80, 7):
        np.testing.assert_allclose(
            bracketed_newton(cubic, jnp.asarray(7.3), 0.0, 10.0, 9.0, steps + 8).x, 7.3 ** (1 / 3)
        )


def test_a_root_at_an_end_of_the_bracket_is_found():
    for low, high in ((2.0, 5.0), (-1.0, 2.0), (2.0, 2.0)):
        # 1e-13: bisection toward an end halves 3 forty times.
        np.testing.assert_allclose(bracketed_newton(cubic, jnp.asarray(8.0), low, high, low, 45).x, 2.0, atol=1e-12)


def test_the_residual_reveals_a_missing_sign_change():
    solution = bracketed_newton(cubic, jnp.asarray(8.0), 3.0, 5.0, 4.0, 40)
    # The nearest it may come is the end of the bracket, 3^3 - 8 = 19.
    assert solution.residual >= 19.0
    assert jnp.isfinite(solution.x)


def test_the_implicit_gradient_supports_jit_and_vmap():
    def root(p):
        return bracketed_newton(cubic, p, 0.0, 10.0, 5.0, 30).x

    values = jnp.array([0.3, 8.0, 500.0])
    # d p^(1/3)/dp = p^(-2/3)/3, exact by the implicit function theorem: rounding only.
    np.testing.assert_allclose(
        jax.jit(jax.vmap(jax.grad(root)))(values), np.asarray(values) ** (-2 / 3) / 3, rtol=1e-12
    )
    np.testing.assert_allclose(
        jax.jit(jax.vmap(jax.jacfwd(root)))(values), np.asarray(values) ** (-2 / 3) / 3, rtol=1e-12
    )


def test_the_gradient_is_finite_at_a_zero_slope():
    gradient = jax.jit(
        jax.grad(lambda p: bracketed_newton(lambda x, q: (q * x**3, 3 * q * x**2), p, -1.0, 1.0, 0.0, 5).x)
    )
    assert gradient(2.0) == 0.0
