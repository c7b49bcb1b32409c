"""Serialized programs without fused instructions: smaller, with the same results; custom fusions keep theirs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.executables import Executable, load_executable, without_fused_instructions
from anser.compiling.program import _compile_serializable

X = jnp.linspace(-1.0, 2.0, 400).reshape(20, 20)


def fused(x):
    """A function that XLA compiles as fusions, within a loop and a condition too."""
    moved = jax.lax.fori_loop(0, 3, lambda k, y: jnp.sin(y) * jnp.cos(k * x) + jnp.exp(-y * y), x)
    return jax.lax.cond(x[0, 0] < 0.0, lambda y: jnp.sum(jnp.tanh(y) / (1.0 + y * y), axis=0), lambda y: y[0], moved)


def with_product(x):
    """A function with a product of matrices, which may be a custom fusion."""
    return jnp.tanh(x @ jnp.cos(x)) + 1.0


def serialized(function):
    """The result of the compiled function, and its code as XLA serializes it."""
    program, is_whole = _compile_serializable(jax.jit(function).lower(X), {})
    assert is_whole
    return program(X), program.runtime_executable().serialize()


@pytest.mark.parametrize("function", [fused, with_product])
def test_programs_without_fused_instructions_have_bit_identical_results(function):
    expected, code = serialized(function)
    shortened = without_fused_instructions(code)
    (result,) = load_executable(Executable(shortened, [0]), [jax.ShapeDtypeStruct(expected.shape, expected.dtype)])([X])
    np.testing.assert_array_equal(result, expected)


def test_operations_inside_fusions_are_left_out():
    code = serialized(fused)[1]
    shortened = without_fused_instructions(code)
    assert len(shortened) < len(code)
    operation = b"\x12\x0bexponential"  # the field of the operation code; names of kernels contain the word too
    assert operation in code
    assert operation not in shortened
    assert without_fused_instructions(shortened) == shortened


def test_custom_fusions_keep_their_instructions():
    code = serialized(fused)[1]
    custom = code.replace(b"kLoop", b"kUser")
    assert custom != code
    assert len(without_fused_instructions(custom)) > len(without_fused_instructions(code))


@pytest.mark.parametrize("code", [b"", b"\x00", b"\xff" * 40, b"no program at all", b"\x02ab\x0a\x05abc"])
def test_other_content_is_returned_unchanged(code):
    assert without_fused_instructions(code) == code
