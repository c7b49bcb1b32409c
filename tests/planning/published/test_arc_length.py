"""Arc length: the ten published values, and high-precision references."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from anser.planning.published.trajectory import arc_length, arc_length_estimate, bend_trajectory
from anser.verification.polynomial_paths import ARC_LENGTHS
from support.checks import assert_passes
from support.planning_cases import published_path, trajectories
from support.reference import reference

measure = jax.jit(arc_length)
bent_lengths = [
    jax.jit(lambda path, kappa, rule=rule: rule(bend_trajectory(path, kappa)))
    for rule in (arc_length, arc_length_estimate)
]

# Final path angle (deg), b_4, c_4, six-point estimate as printed (m).
PUBLISHED = [(angle, b_4, c_4, float(figure)) for angle, b_4, c_4, figure, _ in reference("arc_lengths")["rows"]]


def reference_length(path, start_phase=0.0):
    """Adaptive quadrature with NumPy, from the coefficients."""
    derivative = np.polynomial.polynomial.polyder(np.asarray(path.coefficients_n), axis=1)
    return quad(
        lambda s: np.linalg.norm(derivative @ s ** np.arange(4)), start_phase, 1.0, epsabs=1e-9, epsrel=1e-13, limit=200
    )[0]


def test_published_lengths_equal_six_point_estimates():
    *comparisons, bound = assert_passes(ARC_LENGTHS, 21)
    np.testing.assert_allclose([c.tolerance for c in comparisons], 0.05)  # printed with one decimal
    # printed: below 1.3 percent
    assert (bound.expected, bound.tolerance) == (0.0, 1.3)
    assert bound.obtained == pytest.approx(1.2915, abs=5e-5)  # from the printed figures: 1.292


@pytest.mark.parametrize("row", reference("arc_lengths")["rows"])
def test_the_published_length_has_one_sample_more_than_the_exact_length(row):
    """3,601 speeds times 0.01 s: 1.50 m more, to half the last digit."""
    angle, b_4, c_4, _, printed = row
    assert float(printed) - reference_length(published_path(angle, b_4, c_4)) == pytest.approx(1.5, abs=0.05)


@pytest.mark.parametrize(("path_angle", "b_4", "c_4", "figure"), PUBLISHED)
def test_gauss_legendre_equals_adaptive_quadrature(path_angle, b_4, c_4, figure):
    path = published_path(path_angle, b_4, c_4)
    reference = reference_length(path)
    # Sixteen nodes resolve these smooth paths to well under a millimetre.
    np.testing.assert_allclose(measure(path), reference, atol=1e-4)
    # The six-point rule is an estimate: it misses by up to 1.5 percent on the most bent of these.
    np.testing.assert_allclose(figure, reference, rtol=1.5e-2)


@pytest.mark.parametrize("start_phase", [0.25, 0.8, 1.0])
def test_the_remaining_length_is_exact(start_phase):
    path = published_path(-30.0, 0.01)
    np.testing.assert_allclose(measure(path, start_phase), reference_length(path, start_phase), atol=1e-4)


@settings(deadline=None, max_examples=30)
@given(path=trajectories(), kappas=st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)), part=st.floats(0.0, 1.0))
def test_the_length_is_convex_in_the_bend(path, kappas, part):
    # The integral of the norm of something affine; exact for both rules, whose weights are positive.
    mean = (1.0 - part) * kappas[0] + part * kappas[1]
    for bent_length in bent_lengths:
        first_length, second_length, middle_length = (bent_length(path, kappa) for kappa in (*kappas, mean))
        assert middle_length <= (1.0 - part) * first_length + part * second_length + 1e-8


def test_the_gradient_equals_theory_and_is_finite_at_rest():
    # dL/db_4 of theory section 6, by the same six-point rule in t.
    b_4, t = 0.005, np.linspace(0.0, 36.0, 6)
    path = published_path(-30.0, b_4)
    rate = np.asarray(jax.jit(jax.vmap(path.velocity_n))(jnp.asarray(t)))
    matrix = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, 36.0, 36.0**2, 36.0**3], [0, 1, 72.0, 3 * 36.0**2]], dtype=float)
    lower = np.linalg.solve(matrix, -np.array([0.0, 0.0, 36.0**4, 4 * 36.0**3]))
    slope = lower[1] + 2 * t * lower[2] + 3 * t**2 * lower[3] + 4 * t**3
    weights = np.array([19 / 288, 25 / 96, 25 / 144, 25 / 144, 25 / 96, 19 / 288])
    published = 36.0 * np.sum(weights * rate[:, 1] * slope / np.linalg.norm(rate, axis=1))
    computed = jax.jit(jax.grad(lambda b: arc_length_estimate(published_path(-30.0, b))))(b_4)
    # The solve in unscaled time loses about nine digits of sixteen at most.
    np.testing.assert_allclose(computed, published, rtol=1e-7)

    still = jax.tree.map(jnp.zeros_like, path)
    gradient = jax.jit(jax.grad(lambda c: arc_length(eqx.tree_at(lambda p: p.coefficients_n, path, c))))
    assert jnp.all(jnp.isfinite(gradient(still.coefficients_n)))


def test_a_batch_equals_single_lengths():
    b_4s = jnp.array([0.0, 0.0025, 0.01])
    batch = jax.jit(jax.vmap(lambda b: arc_length(published_path(-30.0, b))))(b_4s)
    np.testing.assert_allclose(batch, [measure(published_path(-30.0, b)) for b in b_4s], rtol=1e-14)
