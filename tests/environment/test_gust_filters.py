"""Shaping filters of turbulence: exact discretization, and the spectra of the standards."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import linalg, stats

from anser.environment.gust_filters import (
    DRYDEN_LONGITUDINAL,
    DRYDEN_TRANSVERSE,
    VON_KARMAN_LONGITUDINAL,
    VON_KARMAN_TRANSVERSE,
    modal_filter,
    sampled_spectrum,
)

FILTERS = {
    "dryden along": DRYDEN_LONGITUDINAL,
    "dryden across": DRYDEN_TRANSVERSE,
    "von karman along": VON_KARMAN_LONGITUDINAL,
    "von karman across": VON_KARMAN_TRANSVERSE,
}


def analytic(name, w):
    """One-sided spectra of unit intensity, in frequencies of V/L: MIL-F-8785C, 3.7.1.1 and 3.7.1.2."""
    return {
        "dryden along": 2.0 / np.pi / (1.0 + w**2),
        "dryden across": 1.0 / np.pi * (1.0 + 3.0 * w**2) / (1.0 + w**2) ** 2,
        "von karman along": 2.0 / np.pi / (1.0 + (1.339 * w) ** 2) ** (5.0 / 6.0),
        "von karman across": (1.0 / np.pi)
        * (1.0 + 8.0 / 3.0 * (1.339 * w) ** 2)
        / (1.0 + (1.339 * w) ** 2) ** (11.0 / 6.0),
    }[name]


@pytest.mark.parametrize("w", [0.05, 0.4, 1.0, 7.0])
@pytest.mark.parametrize("family", ["dryden", "von karman"])
def test_both_documents_have_the_same_spectra(family, w):
    """MIL-HDBK-1797 writes L_v and L_w half as long, and twice them in the spectra."""
    half = 0.5  # L of MIL-HDBK-1797 in units of that of MIL-F-8785C
    x = 2.0 * half * w
    if family == "dryden":
        theirs = 2.0 * half / np.pi * (1.0 + 12.0 * (half * w) ** 2) / (1.0 + 4.0 * (half * w) ** 2) ** 2
    else:
        theirs = 2.0 * half / np.pi * (1.0 + 8.0 / 3.0 * (1.339 * x) ** 2) / (1.0 + (1.339 * x) ** 2) ** (11.0 / 6.0)
    np.testing.assert_allclose(theirs, analytic(f"{family} across", w), rtol=1e-12)


def matrices(shaping, span):
    transition, root, output_row, initial_root = (np.asarray(m) for m in _matrices(shaping, jnp.asarray(span)))
    return transition, root @ root.T, output_row, initial_root @ initial_root.T


@eqx.filter_jit
def _matrices(shaping, span):
    units = jnp.eye(shaping.size)
    initial_root = jax.vmap(shaping.stationary_state, out_axes=1)(units)
    return *shaping.transition(span), jax.vmap(shaping.output)(units), initial_root


@pytest.mark.parametrize("span", [1e-4, 3e-3, 0.049, 0.051, 1.0])
@pytest.mark.parametrize("name", FILTERS)
def test_the_initial_state_is_stationary(name, span):
    transition, added, _, stationary = matrices(FILTERS[name], span)
    np.testing.assert_allclose(transition @ stationary @ transition.T + added, stationary, atol=1e-14)


@pytest.mark.parametrize("span", [1e-3, 0.02, 0.7])
def test_the_step_of_the_dryden_filter_is_exact(span):
    """By the matrix exponential of C. F. Van Loan, IEEE Trans. Automatic Control 23, 1978."""
    A = np.array([[0.0, 1.0], [-1.0, -2.0]])
    noise = np.diag([0.0, 1.0])
    whole = linalg.expm(np.block([[-A, noise], [np.zeros((2, 2)), A.T]]) * span)
    transition, added, _, _ = matrices(DRYDEN_TRANSVERSE, span)
    np.testing.assert_allclose(transition, whole[2:, 2:].T, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(added, whole[2:, 2:].T @ whole[:2, 2:], rtol=2e-9, atol=1e-15)


@pytest.mark.parametrize("name", FILTERS)
def test_the_spectrum_is_that_of_the_document(name):
    """Dryden up to the aliasing of sampling; von Karman up to the rational approximation, from 0.03 to 10 V/L."""
    w = np.geomspace(0.03, 10.0, 60)
    ratio = sampled_spectrum(FILTERS[name], 3e-3, w) / analytic(name, w)
    if name.startswith("dryden"):
        np.testing.assert_allclose(ratio, 1.0, atol=1e-3)
    else:
        assert ratio.min() > 0.95
        assert ratio.max() < 1.03


@pytest.mark.parametrize("name", FILTERS)
def test_the_variance_is_the_integral_of_the_spectrum(name):
    _, _, output_row, stationary = matrices(FILTERS[name], 0.01)
    variance = output_row @ stationary @ output_row
    if name.startswith("dryden"):
        np.testing.assert_allclose(variance, 1.0, rtol=1e-12)
    else:
        assert 0.9 < variance < 1.0  # a rational function has no tail of w^(-5/3)
    w = np.geomspace(1e-4, np.pi / 0.05, 4000)
    np.testing.assert_allclose(np.trapezoid(sampled_spectrum(FILTERS[name], 0.05, w), w), variance, rtol=2e-3)


def simulate_sequences(shaping, span, count, samples, seed=3):
    """Sequences of a filter, (count, samples)."""
    normals = np.random.default_rng(seed).normal(size=(samples + 1, shaping.size, count))

    def step(state, noise):
        new_state = jax.vmap(shaping.advance, in_axes=(1, 1, None), out_axes=1)(state, noise, jnp.asarray(span))
        return new_state, jax.vmap(shaping.output, in_axes=1)(new_state)

    @jax.jit
    def sequences(normals):
        initial_states = jax.vmap(shaping.stationary_state, in_axes=1, out_axes=1)(normals[0])
        return jax.lax.scan(step, initial_states, normals[1:])[1]

    return np.asarray(sequences(jnp.asarray(normals))).T


# 30 minutes at 150 m/s in scales of 533 m (1,750 ft) are a way of 506 scales; a sample each 0.075 s
SPAN, SAMPLES = 0.075 * 150.0 / 533.4, 24_000


@pytest.mark.parametrize(
    ("count", "samples"),
    [pytest.param(200, SAMPLES, marks=pytest.mark.long), (40, 4000)],
    ids=["200 of 30 min", "40 of 5 min"],
)
@pytest.mark.parametrize("name", FILTERS)
def test_realisations_have_the_spectrum_of_the_filter(name, count, samples):
    """Averaged periodograms over two decades, within the pointwise 95 % band of chi-square, which has 2 count degrees.

    Windowed (Hann) against leakage; the expected periodogram is the sampled spectrum seen through the window.
    """
    shaping = FILTERS[name]
    sequences = simulate_sequences(shaping, SPAN, count, samples)
    variance = matrices(shaping, SPAN)
    expected = variance[2] @ variance[3] @ variance[2]
    # effective samples: the way in scales, about
    assert abs(np.mean(sequences**2) / expected - 1.0) < max(0.02, 6.0 / np.sqrt(count * samples * SPAN))
    window = np.hanning(samples + 1)[:-1]
    periodograms = np.abs(np.fft.rfft(sequences * window, axis=1)) ** 2 * SPAN / (np.pi * np.sum(window**2))
    w = 2.0 * np.pi * np.fft.rfftfreq(samples, SPAN)
    inside = (w >= 0.1) & (w <= 10.0)
    bins = np.flatnonzero(inside)[:: max(1, inside.sum() // 400)]
    fine = sampled_spectrum(shaping, SPAN, w[bins])
    mean = periodograms[:, bins].mean(axis=0)
    low, high = stats.chi2.ppf([0.025, 0.975], 2 * count) / (2 * count)
    share = np.mean((mean >= low * fine) & (mean <= high * fine))
    assert share >= (0.93 if count == 200 else 0.9)


def test_filters_support_gradients_and_batches_and_refuse_complex_poles():
    slope = jax.jit(jax.grad(lambda t: jnp.sum(VON_KARMAN_TRANSVERSE.advance(jnp.ones(3), jnp.ones(3), t))))
    assert np.isfinite(slope(0.01))
    spans = jnp.array([1e-4, 0.01, 1.0])
    batch = jax.jit(jax.vmap(lambda t: DRYDEN_TRANSVERSE.transition(t)[1]))(spans)
    for span, root in zip(spans, batch, strict=True):
        np.testing.assert_allclose(root, DRYDEN_TRANSVERSE.transition(span)[1], rtol=1e-12)
    with pytest.raises(ValueError, match="expected real ones"):
        modal_filter(1.0, (1.0,), (1.0, 0.1, 1.0))
    for repeated in ((1.0, 2.0, 1.0), (1.0, 3.0, 3.0, 1.0)):
        with pytest.raises(ValueError, match="a pole is repeated"):
            modal_filter(1.0, (1.0,), repeated)
