"""Multilinear interpolation in tables; one memory access fetches a grid cell of all tables with common axes."""

from collections.abc import Sequence
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import as_array
from anser.shapes import ScalarLike

_EVEN = 1e-14
"""Greatest variation of the intervals of an evenly spaced axis, relative to the axis length."""


_ON_STEP = 1e-9
"""Greatest deviation of a breakpoint from a multiple of the step, relative to the step."""
_PARTS_MAX, _STEPS_MAX = 8, 256
"""Greatest divisor of the smallest interval in the search for a common step; greatest number of steps of an axis."""


class Axes(eqx.Module):
    """Axes of tables, with clamping or linear extrapolation beyond the breakpoints; see `make_axes`.

    Attributes
    ----------
    breakpoints, sizes
        Strictly increasing breakpoints of each of the k axes, padded with plus infinity; number of breakpoints of each
        axis, at least 2.
    lower, upper
        Limits of the arguments before the look-up. A clamped axis has the first and last breakpoint, an extrapolated
        axis has minus and plus infinity.
    even
        Whether the breakpoints of every axis are evenly spaced, to rounding; the interval then needs no search.
    step_lookup, step
        Data for a fast look-up if not `even`, but the breakpoints of each axis are at multiples of a step from the
        first; None for other axes. `step` has the step of each axis. `step_lookup` has for every step the interval
        index, the lower breakpoint and 1 / interval length, axes concatenated.
    """

    breakpoints: Float[Array, "k n"]
    lower: Float[Array, " k"]
    upper: Float[Array, " k"]
    sizes: tuple[int, ...] = eqx.field(static=True)
    even: bool = eqx.field(static=True)
    step_lookup: Float[Array, "all_steps 3"] | None = None
    step: Float[Array, " k"] | None = None

    def locate(self, x: Float[Array, " k"]) -> tuple[Int[Array, " k"], Float[Array, " k"]]:
        """Return the interval index and the fraction within the interval on each axis, from one argument per axis.

        The fraction of an extrapolated argument is outside 0..1.
        """
        x = jnp.clip(x, self.lower, self.upper)
        if self.even:
            origin, next_breakpoint = self.breakpoints[:, 0], self.breakpoints[:, 1]
            position = (x - origin) / (next_breakpoint - origin)
            below = jnp.clip(jnp.floor(position), 0.0, np.asarray(self.sizes, position.dtype) - 2)
            return below.astype(jnp.int32), position - below
        if self.step_lookup is not None and self.step is not None:
            steps = self.step_lookup.shape[0] // len(self.sizes)
            position = jnp.floor((x - self.breakpoints[:, 0]) / self.step)
            at = jnp.clip(position, 0.0, steps - 1.0).astype(jnp.int32)
            interval = self.step_lookup[at + steps * np.arange(len(self.sizes), dtype=np.int32)]
            return interval[:, 0].astype(jnp.int32), (x - interval[:, 1]) * interval[:, 2]
        above = jnp.sum(x[:, None] >= self.breakpoints[:, 1:], axis=1, dtype=jnp.int32)
        index = jnp.minimum(above, np.asarray(self.sizes, dtype=np.int32) - 2)
        endpoints = jnp.take_along_axis(self.breakpoints, index[:, None] + np.arange(2, dtype=np.int32)[None], axis=1)
        return index, (x - endpoints[:, 0]) / (endpoints[:, 1] - endpoints[:, 0])

    def outside(self, x: Float[Array, " k"]) -> Bool[Array, " k"]:
        """Whether each argument lies beyond the first or last breakpoint of its axis."""
        last_breakpoint = self.breakpoints[np.arange(len(self.sizes)), np.asarray(self.sizes) - 1]
        return (x < self.breakpoints[:, 0]) | (x > last_breakpoint)


class Tables(eqx.Module):
    """Groups of tabulated functions, multilinear between the breakpoints; see `make_tables`.

    The functions of a group depend on the axes `axis_indices` of the group. `cells` holds for each group and each cell
    of the grid (row-major) the coefficients of 1, u, v, u v, ... in the fractions u, v, ... along these axes.
    """

    axes: Axes
    cells: tuple[Float[Array, "cells corners functions"], ...]
    axis_indices: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    def __call__(self, *x: ScalarLike) -> tuple[Float[Array, " functions"], ...]:
        """Return the values of each group's functions, a tuple over the groups; `x` has one argument per axis."""
        dtype = self.axes.breakpoints.dtype
        return self.interpolate_cell(*self.axes.locate(jnp.stack([jnp.asarray(value, dtype) for value in x])))

    def interpolate_cell(
        self, index: Int[Array, " k"], fraction: Float[Array, " k"]
    ) -> tuple[Float[Array, " functions"], ...]:
        """Return the values of each group's functions from the results of `Axes.locate`: index and fraction."""
        return tuple(
            self._interpolated(cells, along, index, fraction)
            for cells, along in zip(self.cells, self.axis_indices, strict=True)
        )

    def _interpolated(
        self,
        cells: Float[Array, "cells corners functions"],
        axis_indices: tuple[int, ...],
        index: Int[Array, " k"],
        fraction: Float[Array, " k"],
    ) -> Float[Array, " functions"]:
        cell_index = index[axis_indices[0]]
        for axis in axis_indices[1:]:
            cell_index = cell_index * (self.axes.sizes[axis] - 1) + index[axis]
        value = jnp.take(cells, cell_index, axis=0, mode="clip")  # the index is within the table
        *others, last = axis_indices
        for axis in others:
            value = value[0::2] + fraction[axis] * value[1::2]
        # XLA stores the result of a sum; other linear steps are computed anew for each use of a function
        factors = jnp.stack([jnp.ones_like(fraction[last]), fraction[last]])
        return jnp.sum(value * factors[:, None], axis=0)


def make_axes(axes: Sequence[Sequence[float] | np.ndarray], *, clamp: bool | Sequence[bool]) -> Axes:
    """Build the axes of tables from the breakpoints of each axis.

    `clamp`, one flag or a flag for each axis: True holds the boundary value beyond the breakpoints, False extrapolates
    linearly. Raises ValueError if an axis has fewer than two breakpoints, or breakpoints do not strictly increase.
    """
    points = [np.asarray(axis, dtype=float) for axis in axes]
    for axis in points:
        if axis.ndim != 1 or axis.size < 2 or not all(b > a for a, b in pairwise(axis)):
            raise ValueError(f"table axis: breakpoints must be two or more, strictly increasing; got {axis.tolist()}")
    longest = max(axis.size for axis in points)
    clamped = np.broadcast_to(clamp, (len(points),))
    even = all(np.ptp(np.diff(axis)) <= _EVEN * np.ptp(axis) for axis in points)
    steps = [None if even else _common_step(axis) for axis in points]
    common_steps = [step for step in steps if step is not None]
    has_steps = len(common_steps) == len(points)
    return Axes(
        breakpoints=as_array([np.append(axis, np.full(longest - axis.size, np.inf)) for axis in points]),
        lower=as_array(np.where(clamped, [axis[0] for axis in points], -np.inf)),
        upper=as_array(np.where(clamped, [axis[-1] for axis in points], np.inf)),
        sizes=tuple(axis.size for axis in points),
        even=even,
        step_lookup=as_array(_tabulate_steps(points, common_steps)) if has_steps else None,
        step=as_array(common_steps) if has_steps else None,
    )


def _common_step(points: np.ndarray) -> float | None:
    """Return the greatest step that divides the distance of every breakpoint from the first; None if not found."""
    smallest_interval = float(np.min(np.diff(points)))
    for parts in range(1, _PARTS_MAX + 1):
        positions = (points - points[0]) / (smallest_interval / parts)
        if positions[-1] > _STEPS_MAX:
            return None
        if np.allclose(positions, np.round(positions), rtol=0.0, atol=_ON_STEP):
            return smallest_interval / parts
    return None


def _tabulate_steps(points: Sequence[np.ndarray], steps: Sequence[float]) -> np.ndarray:
    counts = [round(np.ptp(axis) / step) for axis, step in zip(points, steps, strict=True)]
    step_tables = []
    for axis, step in zip(points, steps, strict=True):
        middles = axis[0] + step * (np.arange(max(counts)) + 0.5)
        interval = np.clip(np.searchsorted(axis, middles, side="right") - 1, 0, axis.size - 2)
        step_tables.append(np.stack([interval, axis[interval], 1.0 / np.diff(axis)[interval]], axis=-1))
    return np.concatenate(step_tables)


def make_tables(axes: Axes, groups: Sequence[tuple[Sequence[int], Sequence[Sequence[float] | np.ndarray]]]) -> Tables:
    """Build tables from groups of functions.

    A group is the pair (indices of the group's axes, values of each function). The values of a function are an array
    with one array axis for each of these axes, in this order. Raises ValueError if values do not have the shape of
    their axes.
    """
    packed = []
    for along, functions in groups:
        table = np.stack([np.asarray(values, dtype=float) for values in functions], axis=-1)
        shape = tuple(axes.sizes[axis] for axis in along)
        if table.shape[:-1] != shape:
            raise ValueError(f"table: values of shape {table.shape[:-1]} on axes of {shape} breakpoints")
        corners = table[None]
        for axis in range(1, len(shape) + 1):
            lower, upper = (np.take(corners, np.arange(k, shape[axis - 1] - 1 + k), axis=axis) for k in (0, 1))
            corners = np.concatenate([lower, upper - lower])
        packed.append(as_array(np.moveaxis(corners, 0, -2).reshape(-1, 2 ** len(shape), table.shape[-1])))
    return Tables(axes=axes, cells=tuple(packed), axis_indices=tuple(tuple(along) for along, _ in groups))
