"""Compilation of arithmetic as one kernel: equal results, and only for functions that XLA can compile so."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.single_kernel import COMPUTED_MAX, MOVED_MAX, as_single_kernel

MARK = 'xla_cpu_small_call = "true"'
POINTS = jnp.linspace(0.1, 2.0, 12)


def waves(x, label="points"):
    def body(sum_, _):
        return sum_ + jnp.sin(sum_ * x), None

    return {"sum": jax.lax.scan(body, x, length=3)[0], "greatest": jnp.max(jnp.cos(x)), "label": label}


@jax.jit
def marked(x):
    result = as_single_kernel(waves)(x, "kept")
    assert result.pop("label") == "kept"
    return result


def test_results_and_derivatives_equal_those_of_the_function():
    result, plain = marked(POINTS), waves(POINTS)
    assert MARK in marked.lower(POINTS).as_text()
    for key, value in result.items():
        np.testing.assert_allclose(value, plain[key], rtol=1e-14, err_msg=key)
    for derivative in (jax.jacfwd, jax.jacrev):
        slopes = derivative(lambda x: marked(x)["sum"])(POINTS)
        np.testing.assert_allclose(slopes, derivative(lambda x: waves(x)["sum"])(POINTS), rtol=1e-13, atol=1e-15)


def test_the_compiled_program_is_one_kernel():
    def several(x):
        return jnp.cos(x / jnp.max(jnp.sin(x)))

    programs = [
        jax.jit(function).lower(POINTS).compile().as_text() for function in (as_single_kernel(several), several)
    ]
    assert [" call(" in program for program in programs] == [True, False]


def test_library_operations_are_not_compiled_as_one_kernel():
    square = jnp.eye(40) + 0.01
    for function in (
        lambda a: a @ a,
        jnp.linalg.inv,
        lambda a: jax.pure_callback(np.cos, jax.ShapeDtypeStruct(a.shape, a.dtype), a),
        lambda a: jax.lax.cond(a[0, 0] > 1.0, jnp.sin, lambda b: b @ b, a),
    ):
        compiled = jax.jit(as_single_kernel(function))
        assert MARK not in compiled.lower(square).as_text()
        np.testing.assert_allclose(compiled(square), function(square), rtol=1e-12, atol=1e-14)


def costly(x):
    return sum(jnp.exp(jnp.sin(k * x) ** 3.3) / (1.0 + jnp.arctan2(x, k + x * x)) for k in range(12))


@pytest.mark.parametrize(
    ("function", "size", "small"),
    [
        (costly, COMPUTED_MAX, True),
        (costly, COMPUTED_MAX + 1, False),
        (lambda x: x[::-1], MOVED_MAX, True),
        (lambda x: x[::-1], MOVED_MAX + 1, False),
    ],
)
def test_large_arrays_are_not_compiled_as_one_kernel(function, size, small):
    """XLA compiles arrays up to the size limit as one kernel."""
    x = jnp.linspace(0.0, 1.0, size)
    lowered = jax.jit(as_single_kernel(function)).lower(x)
    assert (MARK in lowered.as_text()) == small
    np.testing.assert_allclose(lowered.compile()(x), function(x), rtol=1e-13)


@pytest.mark.parametrize(("size", "small"), [(MOVED_MAX, True), (MOVED_MAX + 1, False)])
def test_a_loop_over_large_rows_is_not_compiled_as_one_kernel(size, small):
    """Each iteration moves a row."""
    rows = jnp.arange(2.0 * size).reshape(2, size)
    lowered = jax.jit(as_single_kernel(lambda rows: jax.lax.map(lambda row: row[1], rows))).lower(rows)
    assert (MARK in lowered.as_text()) == small
    np.testing.assert_array_equal(lowered.compile()(rows), rows[:, 1])


def test_programs_for_a_gpu_are_not_marked(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert MARK not in jax.jit(as_single_kernel(jnp.sin)).lower(POINTS).as_text()


def test_the_other_form_is_compiled_where_one_kernel_is_impossible(monkeypatch):
    square, traced = jnp.eye(3) + 0.01, []

    def otherwise(a):
        traced.append(a.shape)
        return jnp.sin(a)

    def lowered(function):
        traced.clear()
        return jax.jit(as_single_kernel(function, otherwise)).lower(square)

    np.testing.assert_array_equal(lowered(lambda a: a @ a).compile()(square), jnp.sin(square))
    assert traced
    assert MARK in lowered(jnp.cos).as_text()
    assert not traced
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    lowered(jnp.cos)
    assert traced
