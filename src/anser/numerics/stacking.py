"""Several objects of one structure as one, for `vmap`: what is common to all is kept once."""

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap
from jaxtyping import Array

from anser.compiling import in_one_kernel
from anser.numerics.arrays import as_array
from anser.shapes import Flag

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

    own: T
    common: T

    def one(self, own: T) -> T:
        """One object, from its own leaves: to be called inside `vmap` over `own`."""
        return eqx.combine(own, self.common)

    def at(self, index: int) -> T:
        """The object of an index."""
        return self.one(jax.tree.map(lambda leaf: leaf[index], self.own))

    def map(self, function: Callable[..., Any], *others: Any) -> Any:
        """`function(object, *others)` for each object, and each row of the others, by `vmap`."""
        return jax.vmap(lambda own, *rows: function(self.one(own), *rows))(self.own, *others)


def structure_of(value: Any) -> tuple[Any, tuple[Any, ...]]:
    """What two objects must have in common to be stacked: their structure, and shape and kind of each leaf."""
    leaves, structure = jax.tree.flatten(value)
    return structure, tuple((np.shape(leaf), np.asarray(leaf).dtype) for leaf in leaves)


def stacked(parts: Sequence[T], *, tables_only: bool = True, own: Callable[[T], Any] | None = None) -> Stacked[T]:
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
    if len({structure_of(part) for part in parts}) != 1:
        raise ValueError("objects of different structure cannot be stacked: each must have leaves of the same shapes")
    rows = [jax.tree.leaves(part) for part in parts]
    structure = jax.tree.structure(parts[0])
    apart = jax.tree.map(lambda _: False, parts[0])
    if own is not None:
        apart = eqx.tree_at(own, apart, replace_fn=lambda part: jax.tree.map(lambda _: True, part))
    stacks, common = [], []
    # NumPy: stacking on the host compiles nothing.
    for always, *leaves in zip(jax.tree.leaves(apart), *(map(np.asarray, row) for row in rows), strict=True):
        small = always or (tables_only and leaves[0].ndim < 2)
        equal = not small and all(np.array_equal(leaves[0], leaf, equal_nan=_is_float(leaf)) for leaf in leaves[1:])
        stacks.append(None if equal else as_array(np.stack(leaves), None))
        common.append(as_array(leaves[0], None) if equal else None)
    return Stacked(structure.unflatten(stacks), structure.unflatten(common))


def rows_of(parts: Sequence[T]) -> T:
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


def where_any(chosen: Flag, new: Callable[[], T], old: T) -> T:
    """Leaves of `new()` where a flag stands, else those of `old`; nothing is computed where none of a batch has it.

    For what is due now and then only. In a program that becomes one kernel, which holds no condition, it is computed
    always.
    """

    def some() -> T:
        return jax.tree.map(lambda a, b: jnp.where(chosen, a, b), new(), old)

    return some() if in_one_kernel() else jax.lax.cond(any_in_batch(chosen), some, lambda: old)


def rows_where(chosen: Array, new: Any, old: Any) -> Any:
    """Leaves of `new` in the rows (leading axis) that are chosen, those of `old` in the others."""
    return jax.tree.map(lambda a, b: jnp.where(chosen.reshape(-1, *[1] * (jnp.ndim(a) - 1)), a, b), new, old)
