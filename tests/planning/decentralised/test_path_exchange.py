"""Agreement on paths: no aircraft flies a path that another has not acknowledged, with any losses and delays."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.planning import TimedPath
from anser.planning.decentralised.network import KnowledgeMatrix
from anser.planning.decentralised.path_exchange import (
    Exchange,
    next_in_turn,
    open_offers,
    path_distance_max,
    process_messages,
)

PATIENCE = 12


def numbered_paths(numbers):
    """Stand-ins for paths: numbers."""
    return jnp.asarray(numbers, dtype=float)


def start(count):
    none = jnp.zeros((count, count), dtype=jnp.int32)
    paths = numbered_paths(np.arange(count) * 1000.0)
    return Exchange(paths, paths, none[0], jnp.ones(count, dtype=bool), jnp.full(count, -jnp.inf), none)


def keeps_clear(path, alternative):
    """Whether two paths keep clear of each other: an arbitrary symmetric rule, always true for the initial paths."""
    high, low = np.maximum(path[:, None], alternative[None, :]), np.minimum(path[:, None], alternative[None, :])
    is_initial = (high % 1000.0 == 0.0) & (low % 1000.0 == 0.0)
    return is_initial | ((low * 7919.0 + high * 104729.0) % 5.0 >= 1.0)


process = jax.jit(process_messages)
open_offer = jax.jit(open_offers)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 4), st.floats(0.2, 1.0), st.integers(0, 6))
def test_paths_that_may_be_flown_keep_clear_of_each_other(seed, count, up, delay):
    generator = np.random.default_rng(seed)
    state, itself = start(count), np.eye(count, dtype=bool)
    knowledge = KnowledgeMatrix(
        clocks=jnp.zeros((count, count)),
        times=jnp.zeros((count, count)),
        tokens=jnp.zeros((count, count), dtype=jnp.int32),
        acknowledged=jnp.zeros((count, count, count), dtype=jnp.int32),
        delays=jnp.zeros((count, count)),
    )
    broadcasts, accepted_count = [], 0
    participates = jnp.ones(count, dtype=bool)
    for k in range(120):
        # what each says of itself arrives later, or not at all
        broadcasts.append((np.asarray(state.tokens), np.asarray(state.acknowledged)))
        tokens, acknowledged = np.array(knowledge.tokens), np.array(knowledge.acknowledged)
        if k >= delay:
            old_tokens, old_words = broadcasts[k - delay]
            hears = generator.random((count, count)) < up
            tokens = np.where(hears, old_tokens[None, :], tokens)
            acknowledged = np.where(hears[:, :, None], old_words[None], acknowledged)
        tokens = np.where(itself, broadcasts[-1][0], tokens)
        acknowledged = np.where(itself[:, :, None], broadcasts[-1][1][None], acknowledged)
        knowledge = KnowledgeMatrix(
            knowledge.clocks, knowledge.times, jnp.asarray(tokens), jnp.asarray(acknowledged), knowledge.delays
        )
        clocks = jnp.full(count, float(k), dtype=float)
        alternative, agreed = np.asarray(state.alternative), np.asarray(state.agreed_paths)
        previous = np.asarray(state.agreed_paths)
        state, accepted = process(
            state,
            knowledge,
            jnp.asarray(keeps_clear(alternative, agreed)),
            jnp.asarray(keeps_clear(alternative, alternative)),
            clocks,
            participates,
            float(PATIENCE),
        )
        accepted_count += int(np.sum(np.asarray(accepted)))
        # who takes up a way takes the one that it offered
        np.testing.assert_array_equal(
            np.asarray(state.agreed_paths), np.where(np.asarray(accepted), alternative, previous)
        )
        # what is settled all know of
        assert ((np.asarray(knowledge.tokens) == np.asarray(state.tokens)) | ~np.asarray(state.settled)[None, :]).all()
        agreed, alternative = np.asarray(state.agreed_paths), np.asarray(state.alternative)
        avoids_alternative = ~np.asarray(state.settled)[None, :] & (
            np.asarray(state.offer_open)[None, :] == (np.asarray(knowledge.tokens) == np.asarray(state.tokens)[None, :])
        )
        new = 1000.0 * np.arange(count) + k + 1.0
        is_clear = np.all(
            (keeps_clear(new, agreed) | itself) & (keeps_clear(new, alternative) | ~avoids_alternative | itself), axis=1
        )
        offers = is_clear & np.asarray(state.settled) & ~np.asarray(state.offer_open) & (generator.random(count) < 0.3)
        state = open_offer(state, numbered_paths(new), jnp.asarray(offers), clocks)
        flown = np.asarray(state.agreed_paths)
        assert (keeps_clear(flown, flown) | itself).all()
    if up > 0.9 and delay == 0:
        assert accepted_count > 0


def test_an_offer_without_an_answer_is_withdrawn():
    state = open_offer(start(2), numbered_paths([1.0, 1001.0]), jnp.array([True, False]), jnp.zeros(2))
    nobody = jnp.zeros((2, 2), dtype=jnp.int32)
    tokens = jnp.where(jnp.eye(2, dtype=bool), state.tokens, nobody)
    knowledge = KnowledgeMatrix(nobody * 1.0, nobody * 1.0, tokens, jnp.zeros((2, 2, 2), dtype=jnp.int32), nobody * 1.0)
    clear_pairs = jnp.ones((2, 2), dtype=bool)
    for time, opened in ((PATIENCE - 1.0, True), (PATIENCE + 1.0, False)):
        next_state, accepted = process(
            state, knowledge, clear_pairs, clear_pairs, jnp.full(2, time), jnp.ones(2, dtype=bool), float(PATIENCE)
        )
        assert bool(next_state.offer_open[0]) == opened
        assert not bool(accepted[0])
        assert float(next_state.agreed_paths[0]) == 0.0
        # until the other has acknowledged even the withdrawal it reckons with both
        assert not bool(next_state.settled[0])


def test_the_largest_distance_is_a_close_bound():
    generator = np.random.default_rng(3)
    times = jnp.asarray(np.cumsum(generator.uniform(0.5, 3.0, 9)))

    def path(size):
        return TimedPath(times, jnp.asarray(generator.normal(size=(9, 3, 3)) * size), jnp.zeros((9, 3, 3)))

    positions = jax.jit(lambda path, times: jax.vmap(path.position_n)(times))
    distance_max = jax.jit(path_distance_max)
    for _ in range(5):
        path_a, path_b = path(100.0), path(100.0)
        fine = jnp.asarray(np.linspace(times[0], times[-1], 4001))
        offset = np.asarray(positions(path_a, fine)) - np.asarray(positions(path_b, fine))
        sampled_distance = np.max(np.linalg.norm(offset, axis=1))
        bound = float(distance_max(path_a, path_b))
        assert sampled_distance <= bound <= 2.5 * sampled_distance


@given(st.sampled_from([0.5, 1.0, 1.5, 2.0, 3.0, 5.0]), st.integers(1, 8))
def test_every_aircraft_has_its_fair_turns_with_any_replanning_period(period, count):
    searches = np.arange(10, 10 + 3 * count, 3)
    turns = [next_in_turn(searches, period * k) for k in range(40 * count)]
    numbers = [turns.count(k) for k in searches]
    assert sum(numbers) == len(turns)
    assert 30 <= min(numbers) <= max(numbers) <= 50
