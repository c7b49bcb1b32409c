"""Who hears whom, and when: range, loss, outages, delay, messages passed on."""

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


def talk(own, places, exchanges, seed=1, active=None):
    """Each says its clock, 100 times its number plus the time; what each knows after each exchange."""
    count = len(places)
    places = jnp.asarray(places, dtype=float)
    active = jnp.ones(count, dtype=bool) if active is None else jnp.asarray(active)
    randomness = flight_randomness(seed, 0)

    def one(state, k):
        time = k * PERIOD_S
        none = jnp.zeros(count, dtype=jnp.int32)
        word = Broadcast(
            100.0 * jnp.arange(count) + time, none + k, jnp.zeros((count, count), dtype=jnp.int32), jnp.zeros(count)
        )
        state = own.exchange(state, word, places, active, k * EVERY, time, randomness)
        return state, (state.hears, state.knowledge.clocks, state.knowledge.times)

    start = own.init(100.0 * jnp.arange(count, dtype=float), randomness)
    run = jax.jit(lambda: jax.lax.scan(one, start, jnp.arange(exchanges, dtype=jnp.int32))[1])
    return jax.tree.map(np.asarray, run())


LINE = [(0.0, 0.0, 0.0), (900.0, 0.0, 0.0), (1800.0, 0.0, 0.0), (2700.0, 0.0, 0.0)]


def test_what_is_known_is_right_however_it_came():
    """A clock known with a time is the clock of that time."""
    _, clocks, times = talk(network(reach=1000.0, loss=0.3, share=0.2, delay=3), LINE, 80)
    np.testing.assert_allclose(clocks, 100.0 * np.arange(4) + times, atol=1e-9)
    now = np.arange(80)[:, None, None] * PERIOD_S
    off = ~np.eye(4, dtype=bool)
    age = (now - times)[:, off]
    assert (age >= -1e-12).all()
    assert (age[20:] >= 3 * PERIOD_S - 1e-9).all()


def test_only_those_in_range_hear_each_other_and_news_is_passed_on():
    hears, _, times = talk(network(reach=1000.0), LINE, 20)
    near = np.abs(np.subtract.outer(np.arange(4), np.arange(4))) == 1
    assert (hears[1:] == near).all()
    # one exchange for each link on the way
    ages = 19 * PERIOD_S - times[19]
    hops = np.abs(np.subtract.outer(np.arange(4), np.arange(4)))
    np.testing.assert_allclose(ages[hops > 0], ((hops - 1) * PERIOD_S)[hops > 0], atol=1e-9)


@pytest.mark.parametrize("delay", [0, 5])
def test_a_message_takes_its_time(delay):
    _, _, times = talk(network(delay=delay), LINE[:2], 30)
    np.testing.assert_allclose(29 * PERIOD_S - times[29][0, 1], delay * PERIOD_S, atol=1e-9)


def test_losses_and_outages_are_as_frequent_as_asked_and_the_same_both_ways():
    hears, _, _ = talk(network(loss=0.3, share=0.2, mean_s=1.0), LINE, 6000)
    assert (hears == hears.transpose(0, 2, 1)).all()
    pairs = hears[:, *np.triu_indices(4, 1)]
    # six links, correlated over the outages of a second: 3600 independent spells or so
    assert pairs.mean() == pytest.approx(0.7 * 0.8, abs=0.02)
    # a link that was up is up again more often than one that was not: outages last
    again = pairs[1:][pairs[:-1]].mean()
    assert again > pairs.mean() + 0.05


def test_links_do_not_depend_on_how_many_others_there_are():
    three, _, _ = talk(network(loss=0.4, share=0.1), LINE[:3], 100)
    four, _, _ = talk(network(loss=0.4, share=0.1), LINE, 100)
    assert (three == four[:, :3, :3]).all()


def test_who_does_not_take_part_is_not_heard():
    hears, _, times = talk(network(), LINE, 10, active=[True, False, True, True])
    assert not hears[:, 1].any()
    assert not hears[:, :, 1].any()
    assert (times[9][[0, 2, 3], 1] == 0.0).all()


def test_another_seed_other_links():
    one, other = (talk(network(loss=0.5), LINE, 50, seed=seed)[0] for seed in (1, 2))
    assert (one != other).any()
