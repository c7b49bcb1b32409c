"""Clocks of a fleet: convergence at the guaranteed rate, and bounded skew."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.planning.decentralised.time_coordination import (
    SETTLED_LAG_S,
    CoordinationGains,
    bounded_rate,
    clock_acceleration,
    coordination_error,
    guaranteed_rate,
    quality_of_service,
)

PERIOD_S, STEP_S = 0.1, 0.01


def gains(coupling=0.2, damping=1.0, waiting=0.1, rate_range=0.03, skew_max=0.5):
    return CoordinationGains(*(jnp.asarray(float(v)) for v in (coupling, damping, waiting, rate_range, skew_max)))


def random_links(generator, samples, count, up):
    """Random symmetric links with a probability, constant for runs of about a second."""
    runs = -(-samples // 10)
    links = generator.random((runs, count, count)) < up
    links = np.triu(links, 1)
    links = np.repeat(links | links.transpose(0, 2, 1), 10, axis=0)
    return links[:samples]


def test_the_service_is_one_for_a_complete_network_and_zero_for_a_disconnected_network():
    everyone = np.broadcast_to(~np.eye(4, dtype=bool), (100, 4, 4))
    np.testing.assert_allclose(quality_of_service(everyone, PERIOD_S, 5.0), 1.0, atol=1e-12)
    halves = np.zeros((100, 4, 4), dtype=bool)
    halves[:, [0, 1, 2, 3], [1, 0, 3, 2]] = True
    np.testing.assert_allclose(quality_of_service(halves, PERIOD_S, 5.0), 0.0, atol=1e-12)


def test_a_chain_has_the_algebraic_connectivity_of_the_textbook():
    """Fiedler: 2 (1 - cos(pi / n)) for a path of n nodes."""
    count = 5
    chain = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) == 1
    service = quality_of_service(np.broadcast_to(chain, (60, count, count)), PERIOD_S, 3.0)
    np.testing.assert_allclose(service, 2.0 * (1.0 - np.cos(np.pi / count)) / count, atol=1e-12)


def test_alternating_links_have_an_integral_service():
    """Never connected at any instant, but connected over each window."""
    links = np.zeros((100, 3, 3), dtype=bool)
    links[0::2, [0, 1], [1, 0]] = True
    links[1::2, [1, 2], [2, 1]] = True
    assert (quality_of_service(links, PERIOD_S, 0.1) < 1e-12).all()
    assert (quality_of_service(links, PERIOD_S, 2.0) > 0.1).all()


@pytest.mark.parametrize("seed", range(6))
def test_clocks_converge_at_least_at_the_guaranteed_rate(seed):
    """First order, as in the theorem: gamma_dot = -(c / n) L gamma, over random networks."""
    generator, coupling, window_s = np.random.default_rng(seed), 0.2, 5.0
    count, samples = int(generator.integers(2, 7)), 1500
    links = random_links(generator, samples, count, 0.4).astype(float)
    mu = quality_of_service(links > 0, PERIOD_S, window_s).min()
    assert mu > 0.0
    rate = guaranteed_rate(mu, coupling, window_s)
    clocks = generator.normal(size=count)
    clocks -= clocks.mean()
    initial_error = np.linalg.norm(clocks)
    for k in range(samples):
        laplacian = np.diag(links[k].sum(axis=1)) - links[k]
        values, vectors = np.linalg.eigh(laplacian)
        clocks = vectors @ (np.exp(-coupling / count * values * PERIOD_S) * (vectors.T @ clocks))
        # from the end of the first whole window on, with the theorem's factor
        late = (k + 1) * PERIOD_S
        assert np.linalg.norm(clocks) <= initial_error * np.exp(-rate * (late - window_s)) * (1.0 + 1e-9)


def test_a_complete_network_converges_at_the_coupling_rate():
    """With damping much faster than coupling, clock differences fall as exp(-c t)."""
    skew_gains, clocks, rates = gains(coupling=0.2, damping=20.0, waiting=0.0), jnp.array([0.3, -0.1, 0.2]), jnp.ones(3)
    hears = ~jnp.eye(3, dtype=bool)

    def one(clock, rate, heard):
        return jax.vmap(lambda c, r, h: clock_acceleration(c, r, clock, h, 0.0, 3, skew_gains))(clock, rate, heard)

    def step(carry, _):
        clock, rate = carry
        rate = rate + STEP_S * one(clock, rate, hears)
        return (clock + STEP_S * rate, rate), clock

    _, history = jax.lax.scan(step, (clocks, rates), None, length=1000)
    error = coordination_error(np.asarray(history))
    decay_rate = -np.polyfit(np.arange(1000) * STEP_S, np.log(error), 1)[0]
    assert decay_rate == pytest.approx(0.2, rel=0.03)


def test_the_clock_of_a_lagging_aircraft_waits_except_for_small_lags():
    def one(lag):
        none = jnp.zeros(1)
        return float(clock_acceleration(0.0, 1.0, none, none > 1, lag, 1, gains()))

    assert one(0.9 * SETTLED_LAG_S) == 0.0
    assert one(1.0 + SETTLED_LAG_S) == pytest.approx(-0.1)
    assert one(-1.0 - SETTLED_LAG_S) == pytest.approx(0.1)


bounded = jax.jit(jax.vmap(bounded_rate, in_axes=(0, 0, 0, 0, 0, None)))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 5), st.floats(0.0, 1.0), st.integers(0, 8))
def test_the_skew_between_clocks_stays_within_its_limit(seed, count, up, delay):
    """For any rates, losses and delays."""
    generator, skew_gains = np.random.default_rng(seed), gains(rate_range=0.05, skew_max=0.2)
    clocks, rates = np.zeros(count), np.ones(count)
    heard, last_heard = np.zeros((count, count)), np.zeros((count, count))
    sent = [(0.0, clocks.copy())]
    is_other = ~np.eye(count, dtype=bool)
    for k in range(300):
        time_s = k * PERIOD_S
        if k >= delay:
            time, sent_clocks = sent[k - delay]
            hears = generator.random((count, count)) < up
            heard, last_heard = np.where(hears, sent_clocks[None, :], heard), np.where(hears, time, last_heard)
        unlimited_rate = 1.0 + generator.uniform(-0.2, 0.2, count)
        age = time_s - last_heard
        rates = np.asarray(bounded(unlimited_rate, clocks, heard + age, 0.05 * age, is_other, skew_gains))
        clocks = clocks + PERIOD_S * rates
        sent.append((time_s + PERIOD_S, clocks.copy()))
        # by no more than what is moved in one step beyond
        assert np.ptp(clocks) <= 0.2 + 2 * 0.05 * PERIOD_S + 1e-12


def test_derivatives_are_finite():
    def law(clock):
        return clock_acceleration(clock, 1.0, jnp.zeros(2), jnp.ones(2, dtype=bool), clock, 3, gains())

    assert np.isfinite(float(jax.jit(jax.grad(law))(0.0)))
    assert float(jax.jit(jax.grad(law))(0.5)) == pytest.approx(-2 * 0.2 / 3 - 0.1)
