"""Arrays made of numbers that are known, or traced."""

import functools
import math
from collections.abc import Callable
from types import ModuleType
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

T = TypeVar("T")

_SHARED_MAX = 16
"""Elements of the largest array that is shared by all who ask for the same numbers."""


def namespace(*values: Any) -> ModuleType:
    """NumPy for values that are known, which compiles nothing; `jax.numpy` where one is traced."""
    return jnp if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values)) else np


def rows_at(rows: T, which: slice | np.ndarray) -> T:
    """Some rows of all arrays that have any; numbers as they are."""
    return jax.tree.map(lambda leaf: as_array(np.asarray(leaf)[which], None) if np.ndim(leaf) else leaf, rows)


def leading(rows: T, count: int) -> T:
    """The first rows of all arrays that have any; numbers as they are."""
    return rows_at(rows, slice(count))


def each_of(rows: T) -> list[T]:
    """The rows of all arrays, known, one after the other; as NumPy arrays."""
    known = jax.tree.map(np.asarray, rows)
    count = jax.tree.leaves(known)[0].shape[0]
    return [jax.tree.map(lambda leaf, k=k: leaf[k], known) for k in range(count)]


def few_sizes(count: int, least: int) -> int:
    """The least of `least`, twice as many, ... that is not below a count: few sizes are few programs."""
    return least * 2 ** max(0, math.ceil(math.log2(count / least)))


def filled_up(rows: T, size: int) -> T:
    """The rows of all arrays, known, with copies of the last up to a multiple of a size."""

    def one(leaf: Any) -> Array:
        held = np.asarray(leaf)
        return as_array(np.concatenate([held, *[held[-1:]] * (-len(held) % size)]), None)

    return jax.tree.map(one, rows)


def zeros_as(function: Callable[..., T], *args: Any) -> T:
    """Zeros of the shapes that a function of such arguments gives; nothing is computed."""
    return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(function, *args))


def as_array(value: Any, dtype: Any = float) -> Array:
    """Numbers as an array of JAX, strongly typed; None: of their own type.

    What is known is put on the device as it is, where `jnp.asarray` would compile a program for each new shape.
    """
    if namespace(value) is jnp:
        return jnp.asarray(value, dtype)
    if isinstance(value, jax.Array) and dtype in (None, value.dtype) and not value.weak_type:
        return value
    held = np.asarray(value, dtype)
    if held.size <= _SHARED_MAX:
        return _on_device(held.tobytes(), held.dtype, held.shape)
    return jax.device_put(held)


def in_precision(value: T, dtype: Any) -> T:
    """All real numbers of a tree, or shapes of some, in a precision; what has it already stays as it is."""
    wanted = jnp.dtype(dtype)

    def one(leaf: Any) -> Any:
        own = getattr(leaf, "dtype", wanted)
        if not jnp.issubdtype(own, jnp.floating) or own == wanted:
            return leaf
        if isinstance(leaf, jax.ShapeDtypeStruct):
            return jax.ShapeDtypeStruct(leaf.shape, wanted)
        return as_array(leaf, wanted)

    return jax.tree.map(one, value)


def typed_as(value: T, like: T) -> T:
    """Each array of a tree in the type of its counterpart; one that has it stays as it is."""

    def one(own: Any, other: Any) -> Any:
        wanted = getattr(other, "dtype", None)
        return own if wanted is None or getattr(own, "dtype", wanted) == wanted else own.astype(wanted)

    return jax.tree.map(one, value, like)


@functools.lru_cache(maxsize=8192)
def _on_device(raw: bytes, dtype: np.dtype, shape: tuple[int, ...]) -> Array:
    """A small array, which flights of a campaign have in common for the most part: putting it there takes longest."""
    with jax.ensure_compile_time_eval():  # or what is traced would be kept
        return jax.device_put(np.frombuffer(raw, dtype).reshape(shape))
