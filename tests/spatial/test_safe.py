"""Guarded lengths and angles: equal to numpy away from zero, with finite values and gradients at zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.spatial.rotations import safe_atan2, safe_hypot, safe_norm

# Compiled once each, not operation by operation.
safe_atan2, safe_hypot, safe_norm = map(jax.jit, (safe_atan2, safe_hypot, safe_norm))
atan2_slopes, hypot_slopes = (jax.jit(jax.grad(function, argnums=(0, 1))) for function in (safe_atan2, safe_hypot))
norm_slope = jax.jit(jax.grad(safe_norm))

# Down to 1e-140, whose square is still above the guard; sizes far apart are the hard case.
sizes = st.floats(1e-140, 1e6) | st.floats(-1e6, -1e-140)


@settings(deadline=None, max_examples=30)
@given(sizes, sizes, sizes)
def test_functions_away_from_zero_equal_the_unguarded_ones(x, y, z):
    # Squares and their root round a few times.
    assert safe_hypot(x, y) == pytest.approx(np.hypot(x, y), rel=1e-15)
    assert safe_atan2(y, x) == pytest.approx(np.arctan2(y, x), rel=1e-15)
    largest = max(abs(x), abs(y), abs(z))
    expected = largest * np.linalg.norm(np.array([x, y, z]) / largest)
    assert safe_norm(np.array([x, y, z])) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("size", [0.0, 1e-200, -1e-320])
def test_values_and_gradients_at_zero_are_zero(size):
    for function, slopes in ((safe_hypot, hypot_slopes), (safe_atan2, atan2_slopes)):
        assert function(size, size) == 0.0
        assert slopes(size, size) == (0.0, 0.0)
    v = np.full(3, size)
    assert safe_norm(v) == 0.0
    np.testing.assert_array_equal(norm_slope(v), np.zeros(3))


@pytest.mark.parametrize("size", [1e-144, 1e-100, 1e-8])
def test_gradients_just_above_zero_are_exact(size):
    np.testing.assert_allclose(norm_slope(np.full(3, size)), np.full(3, 3**-0.5), rtol=1e-14)
    np.testing.assert_allclose(np.array(atan2_slopes(size, size)) * size, [0.5, -0.5], rtol=1e-14)


def test_functions_support_vmap_and_jit():
    x, y = jnp.array([0.0, 3.0, -1.0]), jnp.array([0.0, 4.0, 0.0])
    np.testing.assert_allclose(jax.jit(jax.vmap(safe_hypot))(x, y), [0.0, 5.0, 1.0], rtol=1e-15)
    np.testing.assert_allclose(jax.jit(jax.vmap(safe_atan2))(y, x), [0.0, np.arctan2(4.0, 3.0), np.pi], rtol=1e-15)
