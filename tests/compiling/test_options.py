"""Functions compiled without the optimizer, and batches divided among cores: equal results, one compilation per shape."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import blocks_on_cores, call_on_cores, compiled_quickly


@pytest.fixture
def wave():
    """A compiled function with a static argument, and the list of traced shapes and arguments."""
    traced = []

    @compiled_quickly
    def wave(x, harmonics, shift=0.0):
        traced.append((x.shape, harmonics))
        return sum(jnp.sin(k * x + shift) for k in range(1, harmonics + 1))

    return wave, traced


def plain(x, harmonics, shift=0.0):
    return sum(np.sin(k * x + shift) for k in range(1, harmonics + 1))


X = np.linspace(-1.0, 2.0, 7)


def test_functions_are_traced_once_per_shape_and_static_argument(wave):
    function, traced = wave
    for shift in (0.0, 0.3):
        # rounding: sums of a few sines
        np.testing.assert_allclose(
            function(jnp.asarray(X), 3, shift=jnp.asarray(shift)), plain(X, 3, shift), atol=1e-14
        )
    np.testing.assert_allclose(function(jnp.asarray(X), 2, shift=jnp.asarray(0.1)), plain(X, 2, 0.1), atol=1e-14)
    assert traced == [((7,), 3), ((7,), 2)]


@pytest.mark.parametrize("transform", [jax.jit, jax.vmap, lambda f: jax.jit(jax.vmap(f))])
def test_compiled_functions_work_within_other_functions(wave, transform):
    function, _ = wave
    result = transform(lambda x: 2 * function(x, 3))(jnp.asarray(X))
    np.testing.assert_allclose(result, 2 * plain(X, 3), atol=1e-14)


@pytest.mark.parametrize("derivative", [jax.grad, jax.jacfwd])
def test_compiled_functions_have_derivatives(wave, derivative):
    function, _ = wave
    slope = derivative(lambda x: function(x, 2))(jnp.asarray(0.4))
    assert float(slope) == pytest.approx(np.cos(0.4) + 2 * np.cos(0.8), abs=1e-14)


@pytest.mark.parametrize(
    ("count", "sizes"), [(4, [2, 2]), (6, [2, 2, 2]), (7, [7]), (12, [4, 4, 4]), (3, [3]), (8, [4, 4])]
)
def test_a_batch_is_divided_into_equal_blocks(count, sizes, monkeypatch):
    monkeypatch.setattr("anser.compiling.options.usable_cores", lambda: 3)
    blocks = blocks_on_cores(count, 2)
    assert [block.stop - block.start for block in blocks] == sizes
    assert np.concatenate([np.arange(count)[block] for block in blocks]).tolist() == list(range(count))


def test_calls_on_cores_keep_their_order_and_their_errors():
    squares = call_on_cores([lambda k=k: jnp.asarray(k) ** 2 for k in range(5)])
    assert [int(square) for square in squares] == [0, 1, 4, 9, 16]
    with pytest.raises(ZeroDivisionError):
        call_on_cores([lambda: jnp.asarray(1 / 0), lambda: jnp.asarray(1.0)])
