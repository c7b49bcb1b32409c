"""Arrays and pytrees of arrays.

Creation without compilation, precision, rows, padding, and several objects of one structure stacked for `vmap`.
"""

import functools
import math
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.custom_batching import custom_vmap
from jaxtyping import Array

from anser.compiling.single_kernel import is_tracing_single_kernel
from anser.shapes import Flag

T = TypeVar("T")

_SHARED_MAX = 16
"""Elements of the largest array that is shared by all who ask for the same numbers."""


def namespace(*values: Any) -> ModuleType:
    """NumPy for values that are known, which compiles nothing; `jax.numpy` where one is traced."""
    return jnp if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values)) else np


def take_rows(rows: T, indices: slice | np.ndarray) -> T:
    """Some rows of all arrays that have any; numbers as they are."""
    return jax.tree.map(lambda leaf: as_array(np.asarray(leaf)[indices], None) if np.ndim(leaf) else leaf, rows)


def first_rows(rows: T, count: int) -> T:
    """The first rows of all arrays that have any; numbers as they are."""
    return take_rows(rows, slice(count))


def unstack_rows(rows: T) -> list[T]:
    """The rows of all arrays, known, one after the other; as NumPy arrays."""
    known = jax.tree.map(np.asarray, rows)
    count = jax.tree.leaves(known)[0].shape[0]
    return [jax.tree.map(lambda leaf, k=k: leaf[k], known) for k in range(count)]


def bucket_size(count: int, smallest: int) -> int:
    """The least of `least`, twice as many, ... that is not below a count: few sizes are few programs."""
    return smallest * 2 ** max(0, math.ceil(math.log2(count / smallest)))


def pad_to_multiple(rows: T, size: int) -> T:
    """The rows of all arrays, known, with copies of the last up to a multiple of a size."""

    def one(leaf: Any) -> Array:
        held = np.asarray(leaf)
        return as_array(np.concatenate([held, *[held[-1:]] * (-len(held) % size)]), None)

    return jax.tree.map(one, rows)


def zeros_like_result(function: Callable[..., T], *args: Any) -> T:
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


def cast_to_precision(value: T, dtype: Any) -> T:
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


def cast_like(value: T, like: T) -> T:
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


T = TypeVar("T")


class Stacked(eqx.Module, Generic[T]):
    """Objects of one structure.

    Attributes
    ----------
    own
        Leaves with a leading axis over the objects; None in the place of those that are common.
    common
        Leaves that all have; None in the place of the others.
    """

    batched: T
    shared: T

    def combine(self, batched: T) -> T:
        """One object, from its own leaves: to be called inside `vmap` over `own`."""
        return eqx.combine(batched, self.shared)

    def at(self, index: int) -> T:
        """The object of an index."""
        return self.combine(jax.tree.map(lambda leaf: leaf[index], self.batched))

    def map(self, function: Callable[..., Any], *others: Any) -> Any:
        """`function(object, *others)` for each object, and each row of the others, by `vmap`."""
        return jax.vmap(lambda batched, *rows: function(self.combine(batched), *rows))(self.batched, *others)


def tree_signature(value: Any) -> tuple[Any, tuple[Any, ...]]:
    """What two objects must have in common to be stacked: their structure, and shape and kind of each leaf."""
    leaves, structure = jax.tree.flatten(value)
    return structure, tuple((np.shape(leaf), np.asarray(leaf).dtype) for leaf in leaves)


def stack_objects(
    parts: Sequence[T], *, tables_only: bool = True, batched: Callable[[T], Any] | None = None
) -> Stacked[T]:
    """Stack objects of one structure; what is equal in all is common.

    Parameters
    ----------
    parts
        At least one.
    tables_only
        Whether arrays of less than two dimensions are stacked though they are equal in all. Then other numbers in one
        object do not change the structure of the whole, which would compile anew; tables and matrices can be common.
    own
        What of an object is stacked though it is equal in all; None: nothing.

    Raises
    ------
    ValueError
        The structures differ.
    """
    if len({tree_signature(part) for part in parts}) != 1:
        raise ValueError("objects of different structure cannot be stacked: each must have leaves of the same shapes")
    rows = [jax.tree.leaves(part) for part in parts]
    structure = jax.tree.structure(parts[0])
    apart = jax.tree.map(lambda _: False, parts[0])
    if batched is not None:
        apart = eqx.tree_at(batched, apart, replace_fn=lambda part: jax.tree.map(lambda _: True, part))
    stacks, common = [], []
    # NumPy: stacking on the host compiles nothing.
    for always, *leaves in zip(jax.tree.leaves(apart), *(map(np.asarray, row) for row in rows), strict=True):
        small = always or (tables_only and leaves[0].ndim < 2)
        equal = not small and all(np.array_equal(leaves[0], leaf, equal_nan=_is_float(leaf)) for leaf in leaves[1:])
        stacks.append(None if equal else as_array(np.stack(leaves), None))
        common.append(as_array(leaves[0], None) if equal else None)
    return Stacked(structure.unflatten(stacks), structure.unflatten(common))


def stack_rows(parts: Sequence[T]) -> T:
    """Objects of one structure as one, every leaf with a leading axis; stacked on the host, which compiles nothing."""
    return jax.tree.map(lambda *leaves: as_array(np.stack([np.asarray(leaf) for leaf in leaves]), None), *parts)


def _is_float(leaf: np.ndarray) -> bool:
    return np.issubdtype(leaf.dtype, np.inexact)


@custom_vmap
def any_in_batch(flag: Flag) -> Flag:
    """Whether a flag stands, in a batch by `vmap` whether it stands anywhere in it: a result that is not batched.

    A condition on it stays a condition under `vmap`. One on the flag itself would become a selection, for which both
    branches are computed for the whole batch each time.
    """
    return flag


@any_in_batch.def_vmap
def _any_in_batch(_size: int, _batched: list[bool], flags: Any) -> tuple[Any, bool]:
    return any_in_batch(jnp.any(flags, axis=0)), False


def select_if_any(chosen: Flag, new: Callable[[], T], old: T) -> T:
    """Leaves of `new()` where a flag stands, else those of `old`; nothing is computed where none of a batch has it.

    For what is due now and then only. In a program that becomes one kernel, which holds no condition, it is computed
    always.
    """

    def some() -> T:
        return jax.tree.map(lambda a, b: jnp.where(chosen, a, b), new(), old)

    return some() if is_tracing_single_kernel() else jax.lax.cond(any_in_batch(chosen), some, lambda: old)


def select_rows(chosen: Array, new: Any, old: Any) -> Any:
    """Leaves of `new` in the rows (leading axis) that are chosen, those of `old` in the others."""
    return jax.tree.map(lambda a, b: jnp.where(chosen.reshape(-1, *[1] * (jnp.ndim(a) - 1)), a, b), new, old)
