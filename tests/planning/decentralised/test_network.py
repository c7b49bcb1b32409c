"""Communication network: range, loss, outages, delay, relayed messages."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.numerics import flight_randomness
from anser.planning.decentralised.network import Broadcast, Network
from anser.sensing.vehicle_sensors import Dropouts

EVERY, PERIOD_S = 10, 0.1


def network(reach=1e6, loss=0.0, share=0.0, mean_s=5.0, delay=0):
    dropouts = Dropouts(*(jnp.asarray(float(v)) for v in (loss, share, mean_s)))
    return Network(
        jnp.asarray(float(reach)), dropouts, jnp.asarray(PERIOD_S), jnp.asarray(EVERY), jnp.asarray(delay), delay + 2
    )


SHORT = 100
"""Exchanges of one compiled program, of which most tests look at the first."""


@functools.partial(jax.jit, static_argnames="exchanges")
def exchanged(radio_network, positions_n, active, randomness, exchanges):
    count = len(positions_n)

    def exchange(state, k):
        time = k * PERIOD_S
        zero = jnp.zeros(count, dtype=jnp.int32)
        broadcast = Broadcast(
            100.0 * jnp.arange(count) + time, zero + k, jnp.zeros((count, count), dtype=jnp.int32), jnp.zeros(count)
        )
        state = radio_network.exchange(state, broadcast, positions_n, active, k * EVERY, time, randomness)
        return state, (state.hears, state.knowledge.clocks, state.knowledge.times)

    start = radio_network.init(100.0 * jnp.arange(count, dtype=float), randomness)
    return jax.lax.scan(exchange, start, jnp.arange(exchanges, dtype=jnp.int32))[1]


def run_exchanges(radio_network, positions_n, exchanges, seed=1, active=None):
    """Broadcast clocks, 100 times the index plus the time; returns the knowledge after each exchange."""
    positions_n = np.asarray(positions_n, dtype=float)
    active = np.ones(len(positions_n), dtype=bool) if active is None else np.asarray(active)
    randomness = flight_randomness(seed, 0)
    rows = exchanged(radio_network, positions_n, active, randomness, max(exchanges, SHORT))
    return jax.tree.map(lambda leaf: np.asarray(leaf)[:exchanges], rows)


LINE = [(0.0, 0.0, 0.0), (900.0, 0.0, 0.0), (1800.0, 0.0, 0.0), (2700.0, 0.0, 0.0)]


def test_received_clocks_are_correct_by_any_route():
    """A clock received with a time is the clock at that time."""
    _, clocks, times = run_exchanges(network(reach=1000.0, loss=0.3, share=0.2, delay=3), LINE, 80)
    np.testing.assert_allclose(clocks, 100.0 * np.arange(4) + times, atol=1e-9)
    sample_times = np.arange(80)[:, None, None] * PERIOD_S
    is_other = ~np.eye(4, dtype=bool)
    age = (sample_times - times)[:, is_other]
    assert (age >= -1e-12).all()
    assert (age[20:] >= 3 * PERIOD_S - 1e-9).all()


def test_only_aircraft_in_range_have_links_and_messages_are_relayed():
    hears, _, times = run_exchanges(network(reach=1000.0), LINE, 20)
    in_range = np.abs(np.subtract.outer(np.arange(4), np.arange(4))) == 1
    assert (hears[1:] == in_range).all()
    # one exchange for each link on the way
    ages = 19 * PERIOD_S - times[19]
    hops = np.abs(np.subtract.outer(np.arange(4), np.arange(4)))
    np.testing.assert_allclose(ages[hops > 0], ((hops - 1) * PERIOD_S)[hops > 0], atol=1e-9)


@pytest.mark.parametrize("delay", [0, 5])
def test_a_message_arrives_after_the_delay(delay):
    _, _, times = run_exchanges(network(delay=delay), LINE[:2], 30)
    np.testing.assert_allclose(29 * PERIOD_S - times[29][0, 1], delay * PERIOD_S, atol=1e-9)


def test_losses_and_outages_have_the_configured_frequency_in_both_directions():
    hears, _, _ = run_exchanges(network(loss=0.3, share=0.2, mean_s=1.0), LINE, 6000)
    assert (hears == hears.transpose(0, 2, 1)).all()
    pairs = hears[:, *np.triu_indices(4, 1)]
    # six links, correlated over the outages of a second: 3600 independent spells or so
    assert pairs.mean() == pytest.approx(0.7 * 0.8, abs=0.02)
    # a link that was up is up again more often than one that was not: outages last
    repeated = pairs[1:][pairs[:-1]].mean()
    assert repeated > pairs.mean() + 0.05


def test_links_are_independent_of_the_size_of_the_fleet():
    three, _, _ = run_exchanges(network(loss=0.4, share=0.1), LINE[:3], 100)
    four, _, _ = run_exchanges(network(loss=0.4, share=0.1), LINE, 100)
    assert (three == four[:, :3, :3]).all()


def test_an_inactive_aircraft_has_no_links():
    hears, _, times = run_exchanges(network(), LINE, 10, active=[True, False, True, True])
    assert not hears[:, 1].any()
    assert not hears[:, :, 1].any()
    assert (times[9][[0, 2, 3], 1] == 0.0).all()


def test_links_depend_on_the_seed():
    first_links, second_links = (run_exchanges(network(loss=0.5), LINE, 50, seed=seed)[0] for seed in (1, 2))
    assert (first_links != second_links).any()
