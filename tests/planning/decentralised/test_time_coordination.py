"""Clocks of a fleet: they agree as fast as is promised, and never differ by more than is allowed."""

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
    """Symmetric links, each up with a probability, for runs of about a second."""
    runs = -(-samples // 10)
    drawn = generator.random((runs, count, count)) < up
    drawn = np.triu(drawn, 1)
    drawn = np.repeat(drawn | drawn.transpose(0, 2, 1), 10, axis=0)
    return drawn[:samples]


def test_service_is_whole_where_all_hear_all_and_none_where_the_network_falls_apart():
    everyone = np.broadcast_to(~np.eye(4, dtype=bool), (100, 4, 4))
    np.testing.assert_allclose(quality_of_service(everyone, PERIOD_S, 5.0), 1.0, atol=1e-12)
    halves = np.zeros((100, 4, 4), dtype=bool)
    halves[:, [0, 1, 2, 3], [1, 0, 3, 2]] = True
    np.testing.assert_allclose(quality_of_service(halves, PERIOD_S, 5.0), 0.0, atol=1e-12)


def test_a_chain_has_the_algebraic_connectivity_of_the_textbook():
    """Fiedler: that of a path of n nodes is 2 (1 - cos(pi / n))."""
    count = 5
    chain = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) == 1
    found = quality_of_service(np.broadcast_to(chain, (60, count, count)), PERIOD_S, 3.0)
    np.testing.assert_allclose(found, 2.0 * (1.0 - np.cos(np.pi / count)) / count, atol=1e-12)


def test_links_that_take_turns_serve_in_an_integral_sense():
    """Never connected at any instant, but over each window."""
    links = np.zeros((100, 3, 3), dtype=bool)
    links[0::2, [0, 1], [1, 0]] = True
    links[1::2, [1, 2], [2, 1]] = True
    assert (quality_of_service(links, PERIOD_S, 0.1) < 1e-12).all()
    assert (quality_of_service(links, PERIOD_S, 2.0) > 0.1).all()


@pytest.mark.parametrize("seed", range(6))
def test_clocks_agree_at_least_as_fast_as_promised(seed):
    """First order, as the theorem has it: gamma_dot = -(c / n) L gamma, over random networks."""
    generator, coupling, window_s = np.random.default_rng(seed), 0.2, 5.0
    count, samples = int(generator.integers(2, 7)), 1500
    links = random_links(generator, samples, count, 0.4).astype(float)
    mu = quality_of_service(links > 0, PERIOD_S, window_s).min()
    assert mu > 0.0
    rate = guaranteed_rate(mu, coupling, window_s)
    clocks = generator.normal(size=count)
    clocks -= clocks.mean()
    first = np.linalg.norm(clocks)
    for k in range(samples):
        laplacian = np.diag(links[k].sum(axis=1)) - links[k]
        values, vectors = np.linalg.eigh(laplacian)
        clocks = vectors @ (np.exp(-coupling / count * values * PERIOD_S) * (vectors.T @ clocks))
        # from the end of the first whole window on, with the theorem's factor
        late = (k + 1) * PERIOD_S
        assert np.linalg.norm(clocks) <= first * np.exp(-rate * (late - window_s)) * (1.0 + 1e-9)


def test_a_complete_network_agrees_with_the_rate_of_its_name():
    """With damping much faster than coupling the clocks' differences fall as exp(-c t)."""
    own, clocks, rates = gains(coupling=0.2, damping=20.0, waiting=0.0), jnp.array([0.3, -0.1, 0.2]), jnp.ones(3)
    hears = ~jnp.eye(3, dtype=bool)

    def one(clock, rate, heard):
        return jax.vmap(lambda c, r, h: clock_acceleration(c, r, clock, h, 0.0, 3, own))(clock, rate, heard)

    def step(carry, _):
        clock, rate = carry
        rate = rate + STEP_S * one(clock, rate, hears)
        return (clock + STEP_S * rate, rate), clock

    _, history = jax.lax.scan(step, (clocks, rates), None, length=1000)
    error = coordination_error(np.asarray(history))
    found = -np.polyfit(np.arange(1000) * STEP_S, np.log(error), 1)[0]
    assert found == pytest.approx(0.2, rel=0.03)


def test_who_is_behind_its_path_waits_and_small_lags_are_left_to_the_autopilot():
    def one(lag):
        none = jnp.zeros(1)
        return float(clock_acceleration(0.0, 1.0, none, none > 1, lag, 1, gains()))

    assert one(0.9 * SETTLED_LAG_S) == 0.0
    assert one(1.0 + SETTLED_LAG_S) == pytest.approx(-0.1)
    assert one(-1.0 - SETTLED_LAG_S) == pytest.approx(0.1)


bounded = jax.jit(jax.vmap(bounded_rate, in_axes=(0, 0, 0, 0, 0, None)))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 5), st.floats(0.0, 1.0), st.integers(0, 8))
def test_no_two_clocks_ever_differ_by_more_than_the_greatest_skew(seed, count, up, delay):
    """Whatever the law asks for, whatever is lost, however late it comes."""
    generator, own = np.random.default_rng(seed), gains(rate_range=0.05, skew_max=0.2)
    clocks, rates = np.zeros(count), np.ones(count)
    heard, since = np.zeros((count, count)), np.zeros((count, count))
    sent = [(0.0, clocks.copy())]
    counted = ~np.eye(count, dtype=bool)
    for k in range(300):
        now = k * PERIOD_S
        if k >= delay:
            time, said = sent[k - delay]
            hears = generator.random((count, count)) < up
            heard, since = np.where(hears, said[None, :], heard), np.where(hears, time, since)
        wanted = 1.0 + generator.uniform(-0.2, 0.2, count)
        age = now - since
        rates = np.asarray(bounded(wanted, clocks, heard + age, 0.05 * age, counted, own))
        clocks = clocks + PERIOD_S * rates
        sent.append((now + PERIOD_S, clocks.copy()))
        # by no more than what is moved in one step beyond
        assert np.ptp(clocks) <= 0.2 + 2 * 0.05 * PERIOD_S + 1e-12


def test_derivatives_are_finite():
    def law(clock):
        return clock_acceleration(clock, 1.0, jnp.zeros(2), jnp.ones(2, dtype=bool), clock, 3, gains())

    assert np.isfinite(float(jax.jit(jax.grad(law))(0.0)))
    assert float(jax.jit(jax.grad(law))(0.5)) == pytest.approx(-2 * 0.2 / 3 - 0.1)
