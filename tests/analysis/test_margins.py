"""Margins of loops with known margins in closed form, and python-control's margins of the same loops."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import control
from anser.analysis.loop_margins import (
    FREQUENCY_MIN,
    LoopAnalysis,
    _structured_gain,
    frequencies,
    largest_pole,
    margins_of,
)
from anser.analysis.margins import _margin_variables
from anser.cli.margins import _gain

STEP = 0.01
OMEGA = frequencies(STEP)
ROUNDING = 1e-11


ORDER_MAX = 5


def margins_by_frequency(loop_at):
    L = jax.vmap(loop_at)(OMEGA)
    return margins_of(OMEGA, L, (1 - L) / (1 + L), loop_at)


@functools.partial(jax.jit, static_argnames="is_sampled")
def rational_margins(numerator, denominator, is_sampled):
    def loop_at(w):
        point = jnp.exp(1j * w * STEP) if is_sampled else 1j * w
        return jnp.polyval(numerator, point) / jnp.polyval(denominator, point)

    return margins_by_frequency(loop_at)


@jax.jit
def sampled_system_margins(A, B, C):
    unit = jnp.eye(A.shape[0])

    def loop_at(w):
        return (C @ jnp.linalg.solve(jnp.exp(1j * w * STEP) * unit - A, B.astype(complex)))[0, 0]

    return margins_by_frequency(loop_at)


def margins(loop, is_sampled=False):
    """Margins of a rational function of s or, sampled, of z; every loop is data of one program."""
    system = loop(control.tf("s"))
    polynomials = (np.pad(values[0][0], (ORDER_MAX + 1 - len(values[0][0]), 0)) for values in (system.num, system.den))
    return rational_margins(*polynomials, is_sampled=is_sampled)


def test_frequencies_reach_nyquist():
    assert float(OMEGA[0]) == pytest.approx(FREQUENCY_MIN)
    assert float(OMEGA[-1]) == pytest.approx(np.pi / STEP)


def test_a_textbook_loop_has_its_known_margins():
    """K / (s (s+1) (s+2)): the gain may rise to 6 / K, at sqrt 2 rad/s; |L| = 1 is a cubic in the frequency squared."""
    K = 2.0
    result = margins(lambda s: K / (s * (s + 1) * (s + 2)))
    assert float(result.gain_up) == pytest.approx(6 / K, rel=ROUNDING)
    assert float(result.gain_up_at) == pytest.approx(np.sqrt(2), rel=ROUNDING)
    squares = np.roots([1, 5, 4, -(K**2)])
    omega = np.sqrt(squares[np.isreal(squares) & (squares.real > 0)].real[0])
    phase = np.pi / 2 - np.arctan(omega) - np.arctan(omega / 2)
    assert float(result.crossover) == pytest.approx(omega, rel=ROUNDING)
    assert float(result.phase) == pytest.approx(phase, rel=ROUNDING)
    assert float(result.delay) == pytest.approx(phase / omega, rel=ROUNDING)
    assert float(result.gain_down) == 0.0
    alpha = control.disk_margins(control.tf([K], [1, 3, 2, 0]), np.geomspace(0.1, 10, 4000), skew=0.0)[0]
    # a parabola through the peak's three frequencies, 0.05 apart: measured 3e-5
    assert float(result.disk) == pytest.approx(alpha, rel=1e-4)


@pytest.mark.parametrize("K", [0.4, 1.0, 1.9])
def test_a_sampled_integrator_has_its_known_margins(K):
    """K / (z - 1): the gain margin 2 / K is at the Nyquist frequency, where the response ends on the negative axis."""
    result = margins(lambda z: K / (z - 1), is_sampled=True)
    omega = 2 * np.arcsin(K / 2) / STEP
    assert float(result.gain_up) == pytest.approx(2 / K, rel=1e-9)
    assert float(result.gain_up_at) == pytest.approx(np.pi / STEP)
    assert float(result.phase) == pytest.approx(np.pi / 2 - omega * STEP / 2, rel=1e-3)
    assert float(result.crossover) == pytest.approx(omega, rel=1e-4)
    assert float(result.delay) == pytest.approx((np.pi / 2 - omega * STEP / 2) / omega, rel=1e-3)
    assert float(result.disk) == pytest.approx(2 * (2 - K) / (2 + K), rel=1e-9)


def test_a_conditionally_stable_loop_has_a_lower_gain_margin():
    """K / (s - 1) is stable in closed loop for K > 1: the gain may fall to 1 / K, at zero frequency."""
    result = margins(lambda s: 3.0 / (s - 1))
    assert float(result.gain_down) == pytest.approx(1 / 3, rel=1e-5)  # at 1e-3 rad/s, not at 0: 1e-6 off
    assert float(result.gain_up) == np.inf
    assert float(result.disk) == pytest.approx(2 * (3 - 1) / (3 + 1), rel=1e-5)
    assert float(result.phase) == pytest.approx(np.arctan(np.sqrt(8)), rel=ROUNDING)


def test_the_lowest_frequency_of_two_integrators_is_no_boundary():
    """K (s + a) / s^2: stable at any gain. The lowest frequency is within 1 deg of the negative real axis."""
    K, a = 1.0, 0.1
    result = margins(lambda s: K * (s + a) / s**2)
    assert float(result.gain_down) == 0.0
    assert np.isnan(float(result.gain_down_at))
    assert float(result.gain_up) == float(result.gain_up_searched) == np.inf
    # searched down to the gain that would cross 1 below the lowest frequency
    assert float(result.gain_down_searched) == pytest.approx(FREQUENCY_MIN**2 / (K * a), rel=1e-3)
    # a double differentiator: the search for a rising gain is bounded
    rising = margins(lambda s: -0.01 * s**2 / (s + 1) ** 2 / (s + 2) ** 2)
    assert float(rising.gain_up_searched) == pytest.approx(400.0 / FREQUENCY_MIN**2, rel=1e-2)
    assert float(rising.gain_down_searched) == 0.0


@pytest.mark.parametrize("K", [3.0, 0.4])
def test_a_static_response_has_no_search_bound(K):
    result = margins(lambda s: K / (s + 1))
    assert float(result.gain_up) == float(result.gain_up_searched) == np.inf
    assert float(result.gain_down) == float(result.gain_down_searched) == 0.0


def test_a_gain_margin_is_at_most_the_searched_change_of_gain():
    """L(0) = -0.76: a pole passes 0 at a gain of 1 / 0.76 (2.4 dB); the boundary of the frequencies is at 83.5 dB."""
    result = margins(lambda s: -0.76 / (1 + s / 0.01) / (1 + s) ** 4)
    assert 20 * np.log10(float(result.gain_up)) == pytest.approx(83.5, abs=0.1)
    analysis = LoopAnalysis(
        A=jnp.full((1, 1, 1), 0.5),
        limited=jnp.zeros((1, 5), dtype=bool),
        margins=jax.tree.map(lambda values: values[None, None], result),
        actuators_disk=jnp.ones(1),
    )
    variables = _margin_variables(analysis, STEP, np.array([True]))
    assert variables["gain_margin_db"][0].item() == pytest.approx(-20 * np.log10(0.76), abs=0.1)
    assert variables["short"][0].item()
    up, searched = (variables[name][0].item() for name in ("gain_up_db", "gain_up_searched_db"))
    assert _gain(up, searched, 1.0) == "none to 2.4"
    assert _gain(2.0, searched, 1.0) == 2.0


def test_each_margin_is_the_least_of_several_crossovers():
    """A resonance at 20 rad/s lifts the gain above 1 again: delay margin and phase margin are at the resonance."""

    def loop(s):
        return 1 / s * (1 + 100 * s / (s**2 + 4.0 * s + 400))

    result = margins(loop)
    omega = np.geomspace(0.1, 100, 20000)
    reference = control.FrequencyResponseData(loop(1j * omega), omega, smooth=True)
    _, phase, _, _, crossovers, _ = control.stability_margins(reference, returnall=True)
    assert len(crossovers) > 1
    lag = np.mod(np.radians(phase), 2 * np.pi)
    # damping ratio 0.1, a peak as wide as four frequencies
    phase_margins = np.minimum(lag, 2 * np.pi - lag)
    assert float(result.phase) == pytest.approx(phase_margins.min(), rel=5e-3)
    assert float(result.crossover) == pytest.approx(crossovers[phase_margins.argmin()], rel=5e-3)
    assert float(result.delay) == pytest.approx((lag / crossovers).min(), rel=5e-3)


def test_a_loop_without_crossover_has_infinite_margins():
    result = margins(lambda s: 0.5 / (s + 1))
    assert float(result.phase) == float(result.delay) == float(result.gain_up) == np.inf
    assert float(result.gain_down) == 0.0
    assert np.isnan(float(result.crossover))


def closed_loop_radius(system, factor):
    """Spectral radius of a sampled system with unit negative feedback through a factor, real or complex."""
    return np.abs(np.linalg.eigvals(system.A - factor * system.B @ system.C)).max()


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([1.0, 0.3], [1, 2, 0, 0]),  # two integrators with a lead: no boundary below
        ([2.0], [1, 3, 2, 0]),
        ([3.0], [1, -1]),  # its static gain must not fall below 1
        ([8.0, 3.0], [1, 0.5, -1, 0]),  # unstable with an integrator: the gain must not fall
        ([0.5], [1, 1]),
        ([4.0, 1.0], [1, 6, -0.1, 0]),
    ],
)
def test_at_every_margin_the_spectral_radius_is_1(numerator, denominator):
    """Inside 1 up to each stated gain, outside beyond; without a margin, inside up to the search bound."""
    system = control.c2d(control.ss(control.tf(numerator, denominator)), STEP)
    more = 3 - system.nstates  # states apart from the loop, so that every case has the same shapes
    result = sampled_system_margins(
        np.pad(system.A, (0, more)), np.pad(system.B, ((0, more), (0, 0))), np.pad(system.C, ((0, 0), (0, more)))
    )
    assert closed_loop_radius(system, 1.0) < 1
    for gain, searched in (
        (float(result.gain_up), float(result.gain_up_searched)),
        (float(result.gain_down), float(result.gain_down_searched)),
    ):
        stated = np.isfinite(gain) and gain > 0
        last_factor = gain if stated else np.clip(searched, 1e-4, 1e4)
        for factor in np.geomspace(1.0, last_factor, 40)[1:-1]:
            assert closed_loop_radius(system, factor) < 1
        if stated:
            assert closed_loop_radius(system, gain) == pytest.approx(1.0, abs=1e-5)
            assert closed_loop_radius(system, gain * (1.01 if gain > 1 else 0.99)) > 1
    if np.isfinite(float(result.phase)):
        radii_by_phase = [closed_loop_radius(system, np.exp(1j * sign * float(result.phase))) for sign in (1, -1)]
        assert max(radii_by_phase) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.long
def test_a_batch_equals_single_loops():
    def of_gain(K):
        s = 1j * OMEGA
        L = K / (s * (s + 1) * (s + 2))
        return margins_of(OMEGA, L, (1 - L) / (1 + L), lambda w: K / (1j * w * (1j * w + 1) * (1j * w + 2)))

    gains, single = jnp.array([0.5, 1.0, 5.0]), jax.jit(of_gain)
    batch = jax.jit(jax.vmap(of_gain))(gains)
    for k in range(3):
        single_loop = single(gains[k])
        for batched, expected in zip(jax.tree.leaves(batch), jax.tree.leaves(single_loop), strict=True):
            np.testing.assert_allclose(batched[k], expected, rtol=1e-12)


def test_the_largest_pole_has_the_largest_modulus():
    rotation = 1.01 * np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    poles = largest_pole(np.stack([rotation, np.diag([-0.5, 0.2])]))
    np.testing.assert_allclose(poles, [1.01 * np.exp(0.3j), -0.5], rtol=1e-12)


def test_the_structured_gain_lies_between_its_bounds():
    """Between the spectral radius and the largest singular value; equal to the radius of a scaled normal matrix."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        M = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
        gain = float(_structured_gain(jnp.asarray(M)))
        radius, norm = np.abs(np.linalg.eigvals(M)).max(), np.linalg.norm(M, ord=2)
        assert radius * (1 - 1e-12) <= gain <= norm * (1 + 1e-12)
    # D M D^-1 of a symmetric M: the balancing finds D again
    symmetric = rng.normal(size=(3, 3))
    symmetric += symmetric.T
    d = np.array([1.0, 30.0, 0.02])
    gain = float(_structured_gain(jnp.asarray(d[:, None] * symmetric / d[None, :], dtype=complex)))
    assert gain == pytest.approx(np.abs(np.linalg.eigvalsh(symmetric)).max(), rel=0.02)  # six sweeps
