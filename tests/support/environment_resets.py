"""The property that no state survives a reset: states after an end are those of a fresh reset, to the bit."""

import dataclasses

import jax
import numpy as np

BATCH = 4


def shortened(params, decisions):
    """Return the parameters with the given length of each case, in decisions, the same for all aircraft of a fleet."""
    cases = params.cases
    shape = np.shape(cases.batched.decisions)
    lengths = np.broadcast_to(np.reshape(decisions, (-1, *[1] * (len(shape) - 1))), shape).astype(np.int32)
    batched = dataclasses.replace(cases.batched, decisions=jax.numpy.asarray(lengths))
    return dataclasses.replace(params, cases=type(cases)(batched, cases.shared))


def check_rows(ended, flown, fresh, rounding=0.0):
    """Every leaf after an end equals that of the fresh reset in the rows that ended, to the bit without `rounding`."""
    for ours, expected in zip(jax.tree.leaves(flown), jax.tree.leaves(fresh), strict=True):
        np.testing.assert_allclose(np.asarray(ours)[ended], np.asarray(expected)[ended], rtol=rounding, atol=rounding)


def batch_programs(environment):
    """Return the compiled reset and step of a batch."""
    return jax.jit(jax.vmap(environment.reset, (0, None))), jax.jit(jax.vmap(environment.step, (0, 0, 0, None)))


def check_resets(environment, reset, step, seed, scale, rounding=0.0):
    """Fly random cases of random lengths under random actions, some not finite, through several ends of episodes.

    `reset` and `step` are those of `batch_programs`.
    """
    rng = np.random.default_rng(seed)
    params = environment.default_params
    params = shortened(params, rng.integers(1, 6, len(params.decisions)))
    first_keys, *later_keys = jax.random.split(jax.random.key(seed), (12, BATCH))
    observation, state = reset(first_keys, params)
    shape = (*np.shape(observation)[:-1], environment.num_actions)
    ends = np.zeros(BATCH, int)
    for keys in later_keys:
        actions = (scale * rng.uniform(-1.0, 1.0, shape)).astype(np.float32)
        actions[rng.random(BATCH) < 0.1] = np.nan  # ends the episode by failure, and nothing of it may stay
        observation, state, _, terminated, truncated, info = step(keys, state, actions, params)
        ended = np.asarray(terminated | truncated)
        if ended.any():
            check_rows(ended, (observation, state), reset(keys, params), rounding)
            assert not np.array_equal(np.asarray(info["final_observation"])[ended], np.asarray(observation)[ended])
        assert np.isfinite(observation).all()
        ends += ended
    assert ends.min() >= 2
