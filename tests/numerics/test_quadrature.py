"""Quadrature rules: exactness up to the degree, and agreement with scipy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from anser.numerics.integration import GAUSS_LEGENDRE_16, NEWTON_COTES_6, integrate


@pytest.mark.parametrize(("rule", "degree"), [(NEWTON_COTES_6, 5), (GAUSS_LEGENDRE_16, 31)])
def test_a_rule_is_exact_up_to_its_degree_only(rule, degree):
    # 1e-14: a few roundings of numbers up to 1.
    powers = np.arange(degree + 1.0)
    integrals = jax.jit(jax.vmap(lambda power: integrate(lambda x: x**power, 0.0, 1.0, rule)))(powers)
    np.testing.assert_allclose(integrals, 1.0 / (powers + 1.0), atol=1e-14)
    if degree == 5:
        assert abs(integrate(lambda x: x**6, 0.0, 1.0, rule) - 1.0 / 7.0) > 1e-5


@pytest.mark.parametrize("rule", [NEWTON_COTES_6, GAUSS_LEGENDRE_16])
def test_weights_are_positive(rule):
    # The convexity of a length in its bend rests on this.
    assert np.all(rule.weights > 0.0)


def test_the_newton_cotes_weights_are_the_published_ones():
    # Theory section 6.
    assert NEWTON_COTES_6.weights.tolist() == [19 / 288, 25 / 96, 25 / 144, 25 / 144, 25 / 96, 19 / 288]


def test_integrals_agree_with_scipy():
    low, high = -0.7, 1.9
    reference, _ = quad(lambda x: np.exp(x) * np.cos(3.0 * x), low, high, epsabs=1e-13, epsrel=1e-13)
    value = integrate(lambda x: jnp.exp(x) * jnp.cos(3.0 * x), low, high)
    # The rule's own error is far below rounding for this entire function.
    np.testing.assert_allclose(value, reference, rtol=1e-13)


def test_results_support_gradient_jit_and_vmap():
    def upper(high):
        return integrate(jnp.exp, 0.0, high)

    # d/dh of the integral is the integrand at h.
    np.testing.assert_allclose(jax.jit(jax.grad(upper))(1.3), np.exp(1.3), rtol=1e-12)
    highs = jnp.array([0.1, 0.5, 2.0])
    np.testing.assert_allclose(jax.vmap(upper)(highs), np.expm1(np.asarray(highs)), rtol=1e-12)
