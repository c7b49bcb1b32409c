"""Random numbers: equal to JAX's generator, equal alone and in any batch, with the stated distributions."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.extend.random
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from anser.numerics import PrescribedRandomness, flight_randomness
from anser.numerics.randomness import AIR, GOAL_SENSOR, INITIAL_SAMPLE, fold_key, threefry

integers = st.integers(0, 2**32 - 1)


@given(integers, integers, integers, integers)
@settings(deadline=None, max_examples=50)
def test_the_bits_equal_those_of_jax(a, b, c, d):
    key = np.array([a, b], dtype=np.uint32)
    ours = np.concatenate(threefry(key, np.array([c], dtype=np.uint32), np.array([d], dtype=np.uint32)))
    theirs = jax.extend.random.threefry_2x32(jnp.asarray(key), jnp.array([c, d], dtype=jnp.uint32))
    np.testing.assert_array_equal(ours, theirs)


@given(integers, integers)
@settings(deadline=None, max_examples=20)
def test_folded_keys_equal_those_of_jax(seed, value):
    expected = jax.random.key_data(jax.random.fold_in(jax.random.key(seed), value))
    np.testing.assert_array_equal(fold_key(np.array([0, seed], dtype=np.uint32), np.asarray(value)), expected)


def draw_normals(flight, aircraft, number):
    source = flight_randomness(5, 3).for_aircraft(aircraft)
    return source.normals(AIR, number, 7) + 0.0 * flight


@pytest.mark.long
def test_numbers_alone_and_in_a_batch_are_bit_identical():
    """Compiled with the default options: the test suite's compiler options allow different rounding."""
    path = os.pathsep.join(filter(None, (str(Path(__file__).parent), os.environ.get("PYTHONPATH"))))
    environment = {key: value for key, value in os.environ.items() if key != "XLA_FLAGS"} | {"PYTHONPATH": path}
    code = "import test_randomness; test_randomness.check_the_same_numbers()"
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)


def check_the_same_numbers():
    batch = jax.jit(jax.vmap(lambda a, k: draw_normals(0.0, a, k)))(jnp.arange(64) % 8, jnp.arange(64) * 37)
    alone = np.stack([jax.jit(draw_normals)(0.0, jnp.asarray(k % 8), jnp.asarray(k * 37)) for k in range(64)])
    np.testing.assert_array_equal(batch, alone)

    def scanned(carry, k):
        return carry, draw_normals(carry, jnp.asarray(2), k * 37)

    _, in_time = jax.lax.scan(scanned, 0.0, jnp.arange(64))
    np.testing.assert_array_equal(np.asarray(in_time)[2::8], alone[2::8])


def test_seed_flight_aircraft_part_and_sample_change_the_numbers():
    source = flight_randomness(5, 3).for_aircraft(jnp.asarray(1))
    base = np.asarray(source.normals(AIR, 10, 4))
    draws = [
        flight_randomness(6, 3).for_aircraft(jnp.asarray(1)).normals(AIR, 10, 4),
        flight_randomness(5, 4).for_aircraft(jnp.asarray(1)).normals(AIR, 10, 4),
        flight_randomness(5, 3).for_aircraft(jnp.asarray(2)).normals(AIR, 10, 4),
        source.normals(GOAL_SENSOR, 10, 4),
        source.normals(AIR, 11, 4),
        source.normals(AIR, INITIAL_SAMPLE, 4),
    ]
    for draw in draws:
        assert not np.any(np.asarray(draw) == base)
    np.testing.assert_array_equal(source.normals(AIR, 10, 6)[:4], base)  # more of them do not change the first


def test_normals_are_normal_and_independent():
    numbers = np.asarray(jax.jit(jax.vmap(lambda k: flight_randomness(1).normals(AIR, k, 5)))(jnp.arange(40_000)))
    for column in numbers.T:
        assert stats.kstest(column, "norm").pvalue > 1e-3
    correlation = np.corrcoef(np.concatenate([numbers[1:], numbers[:-1]], axis=1).T) - np.eye(10)
    assert np.max(np.abs(correlation)) < 5.0 / np.sqrt(40_000)
    even = np.asarray(jax.jit(jax.vmap(lambda k: flight_randomness(1).uniforms(AIR, k, 1)))(jnp.arange(40_000)))
    assert even.min() > 0.0
    assert even.max() < 1.0
    np.testing.assert_allclose(stats.norm.ppf(even[:, 0]), numbers[:, 0], atol=1e-9)


def test_prescribed_numbers_are_replayed():
    table = np.random.default_rng(0).normal(size=(2, 6, 3))
    prescribed = PrescribedRandomness({AIR: jnp.asarray(table)}).for_aircraft(jnp.asarray(1))
    np.testing.assert_array_equal(prescribed.normals(AIR, INITIAL_SAMPLE, 3), table[1, 0])
    np.testing.assert_array_equal(prescribed.normals(AIR, jnp.asarray(4), 2), table[1, 5, :2])
    np.testing.assert_allclose(prescribed.uniforms(AIR, 0, 3), stats.norm.cdf(table[1, 1]), rtol=1e-12)
    after = jax.jit(lambda number: prescribed.normals(AIR, number, 2))(5)
    assert np.isnan(after).all()  # after the record there are no numbers
    with pytest.raises(ValueError, match="part 2 draws 1 random numbers a sample; none given"):
        prescribed.normals(GOAL_SENSOR, 0, 1)
    with pytest.raises(ValueError, match="3 a sample given"):
        prescribed.normals(AIR, 0, 4)
