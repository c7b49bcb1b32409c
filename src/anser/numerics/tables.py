"""Linear interpolation in tables, packed so that one gather fetches a whole cell of all tables that share the axes."""

from collections.abc import Sequence
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import as_array
from anser.shapes import ScalarLike

_EVEN = 1e-14
"""Part of an axis by which its intervals may differ where it counts as evenly spaced."""


_ON_STEP = 1e-9
"""Part of a step by which a breakpoint may lie off it."""
_PARTS_MAX, _RULER_MAX = 8, 256
"""How finely the least interval of an axis is divided to find a common step; the most steps of a ruler."""


class Axes(eqx.Module):
    """Breakpoints of several table axes, and what happens beyond their ends; arguments are looked up on all at once.

    Attributes
    ----------
    breakpoints
        Of each axis strictly increasing, then plus infinity up to a common length; shape (k, n).
    lower, upper
        Arguments are clipped to this range before the look-up: the end breakpoints for a clamped axis, minus and plus
        infinity for one along which tables are extrapolated linearly; shape (k,).
    sizes
        Number of breakpoints of each axis, 2 or more.
    even
        Whether the breakpoints of every axis are evenly spaced, to rounding: then the interval is computed.
    ruler
        Where they are not, but are multiples of a step on each axis: for every step of an axis the interval that it
        lies in, the breakpoint at which that begins, and one over its length; shape (k steps, 3), one axis after the
        other. The interval is then read off instead of searched for, in half of the time. Otherwise None.
    step
        Of the ruler, shape (k,); or None.
    """

    breakpoints: Float[Array, "k n"]
    lower: Float[Array, " k"]
    upper: Float[Array, " k"]
    sizes: tuple[int, ...] = eqx.field(static=True)
    even: bool = eqx.field(static=True)
    step_lookup: Float[Array, "all_steps 3"] | None = None
    step: Float[Array, " k"] | None = None

    def locate(self, x: Float[Array, " k"]) -> tuple[Int[Array, " k"], Float[Array, " k"]]:
        """Interval index and the fraction within it (outside 0..1 where tables are extrapolated) on each axis."""
        x = jnp.clip(x, self.lower, self.upper)
        if self.even:
            first, second = self.breakpoints[:, 0], self.breakpoints[:, 1]
            place = (x - first) / (second - first)
            below = jnp.clip(jnp.floor(place), 0.0, np.asarray(self.sizes, place.dtype) - 2)
            return below.astype(jnp.int32), place - below
        if self.step_lookup is not None and self.step is not None:
            steps = self.step_lookup.shape[0] // len(self.sizes)
            place = jnp.floor((x - self.breakpoints[:, 0]) / self.step)
            at = jnp.clip(place, 0.0, steps - 1.0).astype(jnp.int32)
            here = self.step_lookup[at + steps * np.arange(len(self.sizes), dtype=np.int32)]
            return here[:, 0].astype(jnp.int32), (x - here[:, 1]) * here[:, 2]
        above = jnp.sum(x[:, None] >= self.breakpoints[:, 1:], axis=1, dtype=jnp.int32)
        index = jnp.minimum(above, np.asarray(self.sizes, dtype=np.int32) - 2)
        ends = jnp.take_along_axis(self.breakpoints, index[:, None] + np.arange(2, dtype=np.int32)[None], axis=1)
        return index, (x - ends[:, 0]) / (ends[:, 1] - ends[:, 0])

    def outside(self, x: Float[Array, " k"]) -> Bool[Array, " k"]:
        """Whether each argument lies beyond the first or last breakpoint of its axis."""
        last = self.breakpoints[np.arange(len(self.sizes)), np.asarray(self.sizes) - 1]
        return (x < self.breakpoints[:, 0]) | (x > last)


class Tables(eqx.Module):
    """Groups of functions, multilinear between the breakpoints of axes that the groups share.

    Attributes
    ----------
    axes
        All axes.
    cells
        Of each group, for every cell of its axes (row-major), coefficients of 1, u, v, u v, ... in the fractions u of
        its first axis, v of its second, ...; shape (cells, 2^axes, functions).
    along
        Axes of each group.
    """

    axes: Axes
    cells: tuple[Float[Array, "cells corners functions"], ...]
    axis_indices: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    def __call__(self, *x: ScalarLike) -> tuple[Float[Array, " functions"], ...]:
        """Values of each group's functions; one argument for each axis."""
        dtype = self.axes.breakpoints.dtype
        return self.interpolate_cell(*self.axes.locate(jnp.stack([jnp.asarray(value, dtype) for value in x])))

    def interpolate_cell(
        self, index: Int[Array, " k"], fraction: Float[Array, " k"]
    ) -> tuple[Float[Array, " functions"], ...]:
        """Values of each group's functions, given an interval of each axis and the fraction within it."""
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
        place = index[axis_indices[0]]
        for axis in axis_indices[1:]:
            place = place * (self.axes.sizes[axis] - 1) + index[axis]
        value = cells[place]
        for axis in axis_indices:
            value = value[0::2] + fraction[axis] * value[1::2]
        return value[0]


def make_axes(axes: Sequence[Sequence[float] | np.ndarray], *, clamp: bool | Sequence[bool]) -> Axes:
    """Build axes; `clamp` holds the end values, otherwise the end cells are extrapolated linearly.

    Raises
    ------
    ValueError
        An axis has fewer than two breakpoints or they do not strictly increase.
    """
    points = [np.asarray(one, dtype=float) for one in axes]
    for one in points:
        if one.ndim != 1 or one.size < 2 or not all(b > a for a, b in pairwise(one)):
            raise ValueError(f"table axis: breakpoints must be two or more, strictly increasing; got {one.tolist()}")
    longest = max(one.size for one in points)
    held = np.broadcast_to(clamp, (len(points),))
    even = all(np.ptp(np.diff(one)) <= _EVEN * np.ptp(one) for one in points)
    steps = [None if even else _common_step(one) for one in points]
    known = [step for step in steps if step is not None]
    ruled = len(known) == len(points)
    return Axes(
        breakpoints=as_array([np.append(one, np.full(longest - one.size, np.inf)) for one in points]),
        lower=as_array(np.where(held, [one[0] for one in points], -np.inf)),
        upper=as_array(np.where(held, [one[-1] for one in points], np.inf)),
        sizes=tuple(one.size for one in points),
        even=even,
        step_lookup=as_array(_ruler(points, known)) if ruled else None,
        step=as_array(known) if ruled else None,
    )


def _common_step(points: np.ndarray) -> float | None:
    """Greatest step of which all breakpoints are multiples, seen from the first; None where a ruler would be long."""
    least = float(np.min(np.diff(points)))
    for parts in range(1, _PARTS_MAX + 1):
        places = (points - points[0]) / (least / parts)
        if places[-1] > _RULER_MAX:
            return None
        if np.allclose(places, np.round(places), rtol=0.0, atol=_ON_STEP):
            return least / parts
    return None


def _ruler(points: Sequence[np.ndarray], steps: Sequence[float]) -> np.ndarray:
    counts = [round(np.ptp(one) / step) for one, step in zip(points, steps, strict=True)]
    rulers = []
    for one, step in zip(points, steps, strict=True):
        middles = one[0] + step * (np.arange(max(counts)) + 0.5)
        interval = np.clip(np.searchsorted(one, middles, side="right") - 1, 0, one.size - 2)
        rulers.append(np.stack([interval, one[interval], 1.0 / np.diff(one)[interval]], axis=-1))
    return np.concatenate(rulers)


def make_tables(axes: Axes, groups: Sequence[tuple[Sequence[int], Sequence[Sequence[float] | np.ndarray]]]) -> Tables:
    """Pack groups of functions: of each group, the axes that it is given on and its functions' values at their points.

    Raises
    ------
    ValueError
        Values do not have the shape of their axes.
    """
    packed = []
    for along, functions in groups:
        table = np.stack([np.asarray(values, dtype=float) for values in functions], axis=-1)
        shape = tuple(axes.sizes[axis] for axis in along)
        if table.shape[:-1] != shape:
            raise ValueError(f"table: values of shape {table.shape[:-1]} on axes of {shape} breakpoints")
        corners = table[None]
        for axis in range(1, len(shape) + 1):
            left, right = (np.take(corners, np.arange(k, shape[axis - 1] - 1 + k), axis=axis) for k in (0, 1))
            corners = np.concatenate([left, right - left])
        packed.append(as_array(np.moveaxis(corners, 0, -2).reshape(-1, 2 ** len(shape), table.shape[-1])))
    return Tables(axes=axes, cells=tuple(packed), axis_indices=tuple(tuple(along) for along, _ in groups))
