"""Arrays and pytrees: creation without compilation, precision, rows, and equal structures stacked for `vmap`."""

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
from jaxtyping import Array, Float

from anser.compiling.single_kernel import is_tracing_single_kernel
from anser.shapes import Flag, Integer, ScalarLike

T = TypeVar("T")

_SHARED_MAX = 16
"""Greatest number of elements of an array that `as_array` caches and returns again for equal numbers."""


def namespace(*values: Any) -> ModuleType:
    """Return the module `jax.numpy` if any value is traced; if not, return `numpy`, which compiles nothing."""
    return jnp if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(values)) else np


def take_rows(tree: T, indices: slice | np.ndarray) -> T:
    """Return the rows `indices` (leading axis) of every concrete array in a pytree, as JAX arrays; scalars remain."""
    return jax.tree.map(lambda leaf: as_array(np.asarray(leaf)[indices], None) if np.ndim(leaf) else leaf, tree)


def first_rows(tree: T, count: int) -> T:
    """Return the first `count` rows (leading axis) of every concrete array in a pytree; scalars remain."""
    return take_rows(tree, slice(count))


def rows_on_host(tree: T, indices: int | slice | np.ndarray) -> T:
    """Return the rows `indices` (leading axis) of every array in a pytree, as NumPy arrays; scalars remain."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[indices] if np.ndim(leaf) else leaf, tree)


def with_rows(tree: T, indices: int | np.ndarray, values: Any) -> T:
    """Return a pytree with the rows `indices` (leading axis) of every array replaced by `values`, without compilation.

    `values` must be a pytree of the same structure.
    """

    def replace_rows(leaf: Any, rows: Any) -> Array:
        table = np.array(leaf)
        table[indices] = rows
        return as_array(table, None)

    return jax.tree.map(replace_rows, tree, values)


def unstack_rows(tree: T) -> list[T]:
    """Split a pytree of concrete arrays along the leading axis into a list of pytrees of NumPy arrays."""
    arrays = jax.tree.map(np.asarray, tree)
    count = jax.tree.leaves(arrays)[0].shape[0]
    return [jax.tree.map(lambda leaf, k=k: leaf[k], arrays) for k in range(count)]


def bucket_size(count: int, smallest: int) -> int:
    """Return the least of `smallest`, 2 `smallest`, 4 `smallest`, ... that is at least `count` (1 or more).

    If fleets are padded to these sizes, few programs are compiled.
    """
    return smallest * 2 ** max(0, math.ceil(math.log2(count / smallest)))


def pad_to_multiple(tree: T, size: int) -> T:
    """Pad every concrete array of a pytree with copies of the last row up to a multiple of `size`."""

    def pad(leaf: Any) -> Array:
        array = np.asarray(leaf)
        return as_array(np.concatenate([array, *[array[-1:]] * (-len(array) % size)]), None)

    return jax.tree.map(pad, tree)


def zeros_like_result(function: Callable[..., T], *args: Any) -> T:
    """Return zeros with the shapes and types of a function's result, without evaluating the function."""
    return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(function, *args))


def as_array(value: Any, dtype: Any = float) -> Array:
    """Convert numbers to a strongly typed JAX array without compilation; if `dtype` is None, the type is preserved."""
    if namespace(value) is jnp:
        return jnp.asarray(value, dtype)
    if isinstance(value, jax.Array) and dtype in (None, value.dtype) and not value.weak_type:
        return value
    # `jnp.asarray` would compile a program for each new shape
    array = np.asarray(value, dtype)
    if array.size <= _SHARED_MAX:
        return _on_device(array.tobytes(), array.dtype, array.shape)
    return jax.device_put(array)


def cast_to_precision(value: T, dtype: Any) -> T:
    """Return a pytree with real arrays (or `jax.ShapeDtypeStruct`) cast to `dtype`; other leaves are unchanged."""
    target = jnp.dtype(dtype)

    def cast(leaf: Any) -> Any:
        current = getattr(leaf, "dtype", target)
        if not jnp.issubdtype(current, jnp.floating) or current == target:
            return leaf
        if isinstance(leaf, jax.ShapeDtypeStruct):
            return jax.ShapeDtypeStruct(leaf.shape, target)
        return as_array(leaf, target)

    return jax.tree.map(cast, value)


def cast_like(value: T, reference: T) -> T:
    """Return a pytree with each array cast to the type of the corresponding array in `reference`."""

    def cast(leaf: Any, reference_leaf: Any) -> Any:
        target = getattr(reference_leaf, "dtype", None)
        return leaf if target is None or getattr(leaf, "dtype", target) == target else leaf.astype(target)

    return jax.tree.map(cast, value, reference)


@functools.lru_cache(maxsize=8192)
def _on_device(raw: bytes, dtype: np.dtype, shape: tuple[int, ...]) -> Array:
    """Return a small array on the device from its bytes, type and shape; cached, because copying is slow."""
    with jax.ensure_compile_time_eval():  # otherwise the cache would hold a tracer
        return jax.device_put(np.frombuffer(raw, dtype).reshape(shape))


class Stacked(eqx.Module, Generic[T]):
    """Several objects of equal structure for `vmap`, made by `stack_objects`; shared leaves are stored once."""

    # leaves that differ between the objects, with a leading axis over the objects; None in place of shared leaves
    batched: T
    shared: T  # leaves equal for every object; None in place of batched leaves

    def combine(self, batched: T) -> T:
        """Return the object with the shared leaves and the leaves `batched`, a slice of the attribute of this name."""
        return eqx.combine(batched, self.shared)

    def at(self, index: int) -> T:
        """Return object number `index`, from 0."""
        return self.combine(jax.tree.map(lambda leaf: leaf[index], self.batched))

    def map(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return `function(object, *slices)` for every object, stacked along a leading axis, by `vmap`.

        Object k gets the slices with index k along the leading axes of the arguments.
        """
        return jax.vmap(lambda batched, *slices: function(self.combine(batched), *slices))(self.batched, *arguments)

    def loop(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of `map`, computed for one object after another: less code to compile, but slower."""
        return jax.lax.map(lambda rows: function(self.combine(rows[0]), *rows[1:]), (self.batched, *arguments))


def map_rows(function: Callable[..., Any], *rows: Any) -> Any:
    """Return `vmap(function)(*rows)`; a single row is computed without `vmap`, with less code to compile."""
    if jax.tree.leaves(rows)[0].shape[0] != 1:
        return jax.vmap(function)(*rows)
    result = function(*jax.tree.map(lambda leaf: leaf[0], rows))
    return jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], result)


def tree_signature(value: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the tree structure, and shape and type of each leaf; objects of equal signature can be stacked."""
    leaves, structure = jax.tree.flatten(value)
    arrays = (leaf if isinstance(leaf, np.ndarray | jax.Array) else np.asarray(leaf) for leaf in leaves)
    return structure, tuple((array.shape, array.dtype) for array in arrays)


def stack_objects(
    parts: Sequence[T],  # objects, one or more
    *,
    # True: arrays with fewer than two dimensions are batched even if equal. The compiled program is then the same for
    # equal and for different numbers. False: equal arrays of any dimension are shared
    tables_only: bool = True,
    batched: Callable[[T], Any] | None = None,  # selects a subtree that is batched even if equal; None: no subtree
) -> Stacked[T]:
    """Stack equally structured objects; leaves with equal values in all objects are stored once, as shared leaves.

    Raises ValueError if the objects differ in structure, shapes or types.
    """
    if len({tree_signature(part) for part in parts}) != 1:
        raise ValueError("objects of different structure cannot be stacked: each must have leaves of the same shapes")
    leaves_by_object = [jax.tree.leaves(part) for part in parts]
    structure = jax.tree.structure(parts[0])
    always_batched = _is_in_subtree(structure, batched)
    stacks, shared = [], []
    # NumPy: stacking on the host compiles nothing.
    for always, *leaves in zip(
        always_batched,
        *(map(np.asarray, object_leaves) for object_leaves in leaves_by_object),
        strict=True,
    ):
        small = always or (tables_only and leaves[0].ndim < 2)
        equal = not small and all(
            leaf is leaves[0] or np.array_equal(leaves[0], leaf, equal_nan=_is_float(leaf)) for leaf in leaves[1:]
        )
        stacks.append(None if equal else as_array(np.stack(leaves), None))
        shared.append(as_array(leaves[0], None) if equal else None)
    return Stacked(structure.unflatten(stacks), structure.unflatten(shared))


@functools.lru_cache(maxsize=64)
def _is_in_subtree(structure: Any, select: Callable[[Any], Any] | None) -> tuple[bool, ...]:
    """Return for each leaf whether the leaf is in the subtree that `select` returns; None: False for all leaves."""
    tree = structure.unflatten([False] * structure.num_leaves)
    if select is not None:
        tree = eqx.tree_at(select, tree, replace_fn=lambda part: jax.tree.map(lambda _: True, part))
    return tuple(jax.tree.leaves(tree))


def stack_rows(parts: Sequence[T]) -> T:
    """Stack equally structured objects into one object with a leading axis on every leaf; nothing is compiled."""
    return jax.tree.map(lambda *leaves: as_array(np.stack([np.asarray(leaf) for leaf in leaves]), None), *parts)


def _is_float(leaf: np.ndarray) -> bool:
    return np.issubdtype(leaf.dtype, np.inexact)


def count_not_above(ascending: Float[Array, " n"], value: ScalarLike) -> Integer:
    """Return the number of entries of an ascending array that are at most `value`."""
    count = ascending.shape[0]
    # blocks: in a batch on a CPU, a third of the time of a binary search
    size = math.isqrt(count - 1) + 1
    blocks = jnp.concatenate([ascending, jnp.full(-count % size, jnp.inf, ascending.dtype)]).reshape(-1, size)
    block = jnp.maximum(jnp.sum(blocks[:, 0] <= value, dtype=jnp.int32) - 1, 0)
    return jnp.minimum(size * block + jnp.sum(blocks[block] <= value, dtype=jnp.int32), count)


@custom_vmap
def any_in_batch(flag: Flag) -> Flag:
    """Return whether any flag of a batch under `vmap` is true, as one flag; outside `vmap` return the flag itself.

    `jax.lax.cond` on the result computes one branch even under `vmap`; on a batched flag it would compute both
    branches.
    """
    return flag


@any_in_batch.def_vmap
def _any_in_batch(_size: int, _batched: list[bool], flags: Any) -> tuple[Any, bool]:
    return any_in_batch(jnp.any(flags, axis=0)), False


def select_if_any(chosen: Flag, new: Callable[[], T], old: T) -> T:
    """Return the pytree `new()` if the flag `chosen` is true, `old` if not; for updates that are rare.

    In a batch under `vmap`, `new` is evaluated only if any flag is true; in code for a single kernel (see
    `is_tracing_single_kernel`), `new` is always evaluated.
    """

    def select() -> T:
        return jax.tree.map(lambda a, b: jnp.where(chosen, a, b), new(), old)

    return select() if is_tracing_single_kernel() else jax.lax.cond(any_in_batch(chosen), select, lambda: old)


def select_rows(chosen: Array, new: Any, old: Any) -> Any:
    """Return a pytree with the rows (leading axis) of `new` where `chosen` is true, and the rows of `old` elsewhere."""
    return jax.tree.map(lambda a, b: jnp.where(chosen.reshape(-1, *[1] * (jnp.ndim(a) - 1)), a, b), new, old)
