"""Arrays of concrete numbers: small arrays are shared, tracers are never cached."""

import jax
import jax.numpy as jnp
import numpy as np

from anser.numerics.arrays import as_array


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
