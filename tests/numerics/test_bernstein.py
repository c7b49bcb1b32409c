"""Bernstein forms against numpy's polynomials."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.special import comb

from anser.numerics import bernstein

U = np.linspace(0.0, 1.0, 401)
BATCH = 6


def power(coefficients):
    """The polynomial of Bernstein coefficients, in powers of u."""
    n = len(coefficients) - 1
    u, complement = Polynomial([0.0, 1.0]), Polynomial([1.0, -1.0])
    return sum((c * comb(n, k) * u**k * complement ** (n - k) for k, c in enumerate(coefficients)), Polynomial([0.0]))


def random_coefficients(degree, seed=0):
    return np.random.default_rng(100 * degree + seed).normal(size=(BATCH, degree + 1))


@pytest.mark.parametrize(("m", "n"), [(0, 3), (1, 1), (4, 3), (5, 5)])
def test_the_product_equals_the_product_of_polynomials(m, n):
    a, b = random_coefficients(m), random_coefficients(n, 1)
    products = np.asarray(bernstein.product(jnp.asarray(a), jnp.asarray(b)))
    assert products.shape == (BATCH, m + n + 1)
    for c, p, q in zip(products, a, b, strict=True):
        # Degrees to 10: powers of u lose a few digits, no more.
        np.testing.assert_allclose(power(c)(U), power(p)(U) * power(q)(U), atol=1e-11)


@pytest.mark.parametrize(("degree", "higher"), [(0, 4), (2, 2), (4, 7)])
def test_elevation_changes_only_the_degree(degree, higher):
    a = random_coefficients(degree)
    elevated = np.asarray(bernstein.elevate(jnp.asarray(a), higher))
    assert elevated.shape == (BATCH, higher + 1)
    for c, p in zip(elevated, a, strict=True):
        np.testing.assert_allclose(power(c)(U), power(p)(U), atol=1e-11)  # rounding


def test_a_degree_cannot_fall():
    with pytest.raises(ValueError, match="degree 3 cannot be written with degree 2"):
        bernstein.elevate(jnp.zeros(4), 2)


@pytest.mark.parametrize("degree", [0, 3, 6])
def test_bounds_hold_and_are_attained_for_monotone_polynomials(degree):
    a = random_coefficients(degree)
    low, high = (np.asarray(x) for x in bernstein.bounds(jnp.asarray(a)))
    for p, lower, upper in zip(a, low, high, strict=True):
        values = power(p)(U)
        assert np.min(values) >= lower - 1e-12  # rounding
        assert np.max(values) <= upper + 1e-12
    # Rising coefficients make a rising polynomial: its bounds are its values at the ends.
    rising = np.sort(a[0])
    lower, upper = bernstein.bounds(jnp.asarray(rising))
    np.testing.assert_allclose([lower, upper], power(rising)(np.array([0.0, 1.0])), atol=1e-12)


def test_bounds_converge_with_the_square_of_the_interval():
    # x^3/3 - x around its least value at 1; the Bernstein coefficients of 1, u, u^2, u^3 are the columns.
    columns = np.array([[1, 0, 0, 0], [1, 1 / 3, 0, 0], [1, 2 / 3, 1 / 3, 0], [1, 1, 1, 1]])

    def excess(span):
        cubic = Polynomial([0.0, -1.0, 0.0, 1 / 3])(Polynomial([1.0 - 0.4 * span, span]))
        low = bernstein.bounds(jnp.asarray(columns @ cubic.coef))[0]
        return -2 / 3 - float(low)

    # Halving the interval quarters the excess; 3.5 to 4.5 leaves room for the next order.
    assert excess(0.1) > 0.0
    assert 3.5 < excess(0.2) / excess(0.1) < 4.5


def test_the_product_supports_jit_vmap_and_gradient():
    a, b, change = (jnp.asarray(random_coefficients(*arguments)) for arguments in ((5, 0), (3, 1), (5, 2)))
    expected = bernstein.product(a, b)
    np.testing.assert_allclose(jax.jit(bernstein.product)(a, b), expected, atol=1e-12)  # rounding
    np.testing.assert_allclose(jax.vmap(bernstein.product)(a, b), expected, atol=1e-12)
    # Linear in each factor: the derivative along a change is the product with it.
    slope = jax.jvp(lambda factor: bernstein.product(factor, b), (a,), (change,))[1]
    np.testing.assert_allclose(slope, bernstein.product(change, b), atol=1e-12)
