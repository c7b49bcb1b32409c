"""The agreement on ways: nobody ever flies one that another has not agreed to, whatever is lost or late."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.planning import TimedPath
from anser.planning.decentralised.network import KnowledgeMatrix
from anser.planning.decentralised.path_exchange import Exchange, open_offers, path_distance_max, process_messages

PATIENCE = 12


def numbered(numbers):
    """Ways that are nothing but their numbers."""
    return jnp.asarray(numbers, dtype=float)


def start(count):
    none = jnp.zeros((count, count), dtype=jnp.int32)
    ways = numbered(np.arange(count) * 1000.0)
    return Exchange(ways, ways, none[0], jnp.ones(count, dtype=bool), jnp.full(count, -jnp.inf), none)


def clear(one, alternative):
    """Whether two ways keep clear of each other: a symmetric rule without rhyme; the first ways all do."""
    high, low = np.maximum(one[:, None], alternative[None, :]), np.minimum(one[:, None], alternative[None, :])
    first = (high % 1000.0 == 0.0) & (low % 1000.0 == 0.0)
    return first | ((low * 7919.0 + high * 104729.0) % 5.0 >= 1.0)


answer = jax.jit(process_messages)
offer = jax.jit(open_offers)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 4), st.floats(0.2, 1.0), st.integers(0, 6))
def test_all_that_may_be_flown_keeps_clear_of_all_else_that_may_be_flown(seed, count, up, delay):
    generator = np.random.default_rng(seed)
    state, itself = start(count), np.eye(count, dtype=bool)
    known = KnowledgeMatrix(
        clocks=jnp.zeros((count, count)),
        times=jnp.zeros((count, count)),
        tokens=jnp.zeros((count, count), dtype=jnp.int32),
        acknowledged=jnp.zeros((count, count, count), dtype=jnp.int32),
        delays=jnp.zeros((count, count)),
    )
    said, taken_up = [], 0
    participates = jnp.ones(count, dtype=bool)
    for k in range(120):
        # what each says of itself arrives later, or not at all
        said.append((np.asarray(state.tokens), np.asarray(state.acknowledged)))
        tokens, acknowledged = np.array(known.tokens), np.array(known.acknowledged)
        if k >= delay:
            old_tokens, old_words = said[k - delay]
            hears = generator.random((count, count)) < up
            tokens = np.where(hears, old_tokens[None, :], tokens)
            acknowledged = np.where(hears[:, :, None], old_words[None], acknowledged)
        tokens = np.where(itself, said[-1][0], tokens)
        acknowledged = np.where(itself[:, :, None], said[-1][1][None], acknowledged)
        known = KnowledgeMatrix(known.clocks, known.times, jnp.asarray(tokens), jnp.asarray(acknowledged), known.delays)
        clocks = jnp.full(count, float(k))
        other, agreed = np.asarray(state.alternative), np.asarray(state.agreed_paths)
        before = np.asarray(state.agreed_paths)
        state, taken = answer(
            state,
            known,
            jnp.asarray(clear(other, agreed)),
            jnp.asarray(clear(other, other)),
            clocks,
            participates,
            float(PATIENCE),
        )
        taken_up += int(np.sum(np.asarray(taken)))
        # who takes up a way takes the one that it offered
        np.testing.assert_array_equal(np.asarray(state.agreed_paths), np.where(np.asarray(taken), other, before))
        # what is settled all know of
        assert ((np.asarray(known.tokens) == np.asarray(state.tokens)) | ~np.asarray(state.settled)[None, :]).all()
        agreed, other = np.asarray(state.agreed_paths), np.asarray(state.alternative)
        reckoned = ~np.asarray(state.settled)[None, :] & (
            np.asarray(state.offer_open)[None, :] == (np.asarray(known.tokens) == np.asarray(state.tokens)[None, :])
        )
        new = 1000.0 * np.arange(count) + k + 1.0
        safe = np.all((clear(new, agreed) | itself) & (clear(new, other) | ~reckoned | itself), axis=1)
        offers = safe & np.asarray(state.settled) & ~np.asarray(state.offer_open) & (generator.random(count) < 0.3)
        state = offer(state, numbered(new), jnp.asarray(offers), clocks)
        flown = np.asarray(state.agreed_paths)
        assert (clear(flown, flown) | itself).all()
    if up > 0.9 and delay == 0:
        assert taken_up > 0


def test_an_offer_without_an_answer_is_withdrawn():
    state = offer(start(2), numbered([1.0, 1001.0]), jnp.array([True, False]), jnp.zeros(2))
    nobody = jnp.zeros((2, 2), dtype=jnp.int32)
    own = jnp.where(jnp.eye(2, dtype=bool), state.tokens, nobody)
    known = KnowledgeMatrix(nobody * 1.0, nobody * 1.0, own, jnp.zeros((2, 2, 2), dtype=jnp.int32), nobody * 1.0)
    both = jnp.ones((2, 2), dtype=bool)
    for time, opened in ((PATIENCE - 1.0, True), (PATIENCE + 1.0, False)):
        after, taken = answer(state, known, both, both, jnp.full(2, time), jnp.ones(2, dtype=bool), float(PATIENCE))
        assert bool(after.offer_open[0]) == opened
        assert not bool(taken[0])
        assert float(after.agreed_paths[0]) == 0.0
        # until the other has acknowledged even the withdrawal it reckons with both
        assert not bool(after.settled[0])


def test_farthest_apart_is_a_bound_and_is_near():
    generator = np.random.default_rng(3)
    times = jnp.asarray(np.cumsum(generator.uniform(0.5, 3.0, 9)))

    def path(size):
        return TimedPath(times, jnp.asarray(generator.normal(size=(9, 3, 3)) * size), jnp.zeros((9, 3, 3)))

    for _ in range(5):
        one, other = path(100.0), path(100.0)
        fine = jnp.linspace(times[0], times[-1], 4001)
        apart = jax.vmap(one.position_n)(fine) - jax.vmap(other.position_n)(fine)
        most = float(jnp.max(jnp.linalg.norm(apart, axis=1)))
        bound = float(path_distance_max(one, other))
        assert most <= bound <= 2.5 * most
