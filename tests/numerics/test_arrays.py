"""Arrays: small ones are shared, tracers are never cached, and counts in ascending arrays are those of NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.numerics.arrays import as_array, count_not_above


def test_equal_small_arrays_are_shared():
    assert as_array([1.0, 2.5]) is as_array(np.array([1.0, 2.5]))
    assert as_array(1.0) is not as_array(1, np.int32)
    assert np.signbit(as_array(-0.0))
    assert not np.signbit(as_array(0.0))
    assert as_array(np.arange(100.0)) is not as_array(np.arange(100.0))


def test_arrays_created_while_tracing_are_not_tracers_afterwards():
    number = 0.123456789  # asked for nowhere else
    np.testing.assert_allclose(jax.jit(lambda x: x + as_array(number))(1.0), 1.0 + number, rtol=1e-15)
    np.testing.assert_allclose(jax.grad(lambda x: x * as_array(2 * number))(1.0), 2 * number, rtol=1e-15)
    assert not isinstance(as_array(number), jax.core.Tracer)
    assert float(as_array(number) + jnp.zeros(())) == number


_counts = {size: jax.jit(jax.vmap(count_not_above, in_axes=(None, 0))) for size in (1, 2, 7, 149)}


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(_counts)), st.integers(0, 2**32 - 1))
def test_counts_in_an_ascending_array_are_those_of_a_binary_search(size, seed):
    """Whole numbers: entries repeat, and values equal entries; a value beyond either end is among them."""
    random = np.random.default_rng(seed)
    ascending = np.sort(random.integers(0, 20, size)).astype(float)
    values = np.concatenate([np.arange(-1.0, 22.0), random.choice(ascending, 9) - 1e-9, [np.inf]])
    counts = _counts[size](jnp.asarray(ascending), jnp.asarray(values))
    np.testing.assert_array_equal(counts, np.searchsorted(ascending, values, side="right"))
