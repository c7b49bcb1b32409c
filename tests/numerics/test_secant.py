"""Roots by the Illinois method: as accurate as Newton's method, with the same implicit derivative."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.numerics.roots import bracketed_newton, bracketed_secant


def cubic(x, p):
    return x**3 - p


def falling(x, p):
    return jnp.exp(-x) - p / 10.0


def arctangent(x, p):
    return jnp.arctan(20.0 * (x - p))


def root_of(function, p, low, high, steps):
    fixed = jax.lax.stop_gradient(p)
    return bracketed_secant(function, p, low, high, function(low, fixed), function(high, fixed), steps)


find = jax.jit(root_of, static_argnums=(0, 4))
slope = jax.jit(jax.vmap(jax.grad(lambda f, p: root_of(f, p, 0.0, 4.0, 20).x, argnums=1), (None, 0)), static_argnums=0)
forward = jax.jit(jax.vmap(jax.jacfwd(lambda p: root_of(cubic, p, 0.0, 4.0, 20).x)))


@settings(deadline=None, max_examples=30)
@given(root=st.floats(-0.9, 0.9), low=st.floats(-3.0, -1.0), high=st.floats(1.0, 3.0))
def test_the_solver_finds_roots_missed_by_plain_newton(root, low, high):
    solution = find(arctangent, jnp.asarray(root), jnp.asarray(low), jnp.asarray(high), 40)
    np.testing.assert_allclose(solution.x, root, atol=1e-13)  # rounding
    assert abs(solution.residual) < 1e-11  # that, times the slope of 20


@functools.partial(jax.jit, static_argnums=0)
def newton_root(function, sign, p):
    def value_and_slope(x, q):
        return jax.jvp(lambda y: sign * function(y, q), (x,), (jnp.ones(()),))

    return bracketed_newton(value_and_slope, p, 0.0, 4.0, 1.0, 40).x


@pytest.mark.parametrize("function", [cubic, falling])
@pytest.mark.parametrize("p", [0.3, 1.0, 7.3])
def test_the_root_equals_that_of_newtons_method(function, p):
    # Newton's bracket wants a rising function.
    sign = 1.0 if function is cubic else -1.0
    solution = find(function, jnp.asarray(p), 0.0, 4.0, 20)
    np.testing.assert_allclose(solution.x, newton_root(function, sign, p), rtol=1e-13)  # rounding


def test_ten_steps_suffice_for_a_narrow_bracket():
    # As detours use it: order 1.44 per step.
    solution = find(cubic, jnp.asarray(2.0), 1.2, 1.35, 10)
    np.testing.assert_allclose(solution.x, 2.0 ** (1 / 3), rtol=1e-14)


def test_roots_at_the_ends_and_empty_brackets_are_found():
    for low, high in ((2.0, 5.0), (-1.0, 2.0), (2.0, 2.0)):
        solution = find(cubic, jnp.asarray(8.0), low, high, 20)
        assert solution.x == 2.0
        assert solution.residual == 0.0


def test_the_residual_reveals_a_missing_sign_change():
    solution = find(cubic, jnp.asarray(8.0), 3.0, 5.0, 20)
    # Nowhere in the bracket is it less than 3^3 - 8.
    assert 3.0 <= solution.x <= 5.0
    assert solution.residual >= 19.0


@pytest.mark.parametrize("function", [cubic, falling])
def test_the_implicit_gradient_is_exact(function):
    values = jnp.array([0.3, 1.0, 7.3])
    # The roots in closed form: p^(1/3) and -log(p/10).
    exact = np.asarray(values) ** (-2 / 3) / 3 if function is cubic else -1.0 / np.asarray(values)
    np.testing.assert_allclose(slope(function, values), exact, rtol=1e-12)  # rounding


def test_the_forward_derivative_is_exact():
    values = jnp.array([0.3, 1.0, 7.3])
    np.testing.assert_allclose(forward(values), np.asarray(values) ** (-2 / 3) / 3, rtol=1e-12)


def test_a_batch_equals_single_solutions():
    values = jnp.array([0.01, 1.0, 7.3])
    together = jax.vmap(lambda p: find(cubic, p, 0.0, 4.0, 20).x)(values)
    np.testing.assert_allclose(together, [find(cubic, p, 0.0, 4.0, 20).x for p in values], rtol=1e-15)


def test_the_gradient_is_finite_at_a_zero_slope():
    gradient = jax.jit(jax.grad(lambda p: root_of(lambda x, q: q * x**3, p, jnp.asarray(-1.0), jnp.asarray(1.0), 5).x))
    assert gradient(2.0) == 0.0
