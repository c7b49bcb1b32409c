"""Linear interpolation in tables, packed so that one gather fetches a whole cell of all tables that share the axes."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from anser.shapes import Flag, Scalar, ScalarLike


class Axis(eqx.Module):
    """Breakpoints of one table axis and what happens beyond its ends.

    Attributes
    ----------
    breakpoints
        Strictly increasing, shape (n,), n >= 2.
    lower, upper
        The argument is clipped to this range before the look-up: the end breakpoints for a clamped table, minus and
        plus infinity for one that is extrapolated linearly.
    """

    breakpoints: Float[Array, " n"]
    lower: Scalar
    upper: Scalar

    @property
    def cells(self) -> int:
        """Number of intervals."""
        return self.breakpoints.shape[0] - 1

    def locate(self, x: ScalarLike) -> tuple[Int[Array, ""], Scalar]:
        """Interval index and the fraction within it (outside 0..1 where the table is extrapolated)."""
        x = jnp.clip(x, self.lower, self.upper)
        index = jnp.sum(x >= self.breakpoints[1:-1], dtype=jnp.int32)
        left = self.breakpoints[index]
        return index, (x - left) / (self.breakpoints[index + 1] - left)

    def outside(self, x: ScalarLike) -> Flag:
        """Whether x lies beyond the first or last breakpoint."""
        return (x < self.breakpoints[0]) | (x > self.breakpoints[-1])


class Curves(eqx.Module):
    """K functions of one argument on one axis.

    Attributes
    ----------
    axis
        The common axis, n breakpoints.
    cells
        Per interval: value at its left end, then the difference to its right end; shape (n - 1, 2, k).
    """

    axis: Axis
    cells: Float[Array, "cells 2 k"]

    def __call__(self, x: ScalarLike) -> Float[Array, " k"]:
        """Interpolate all k curves at x."""
        index, u = self.axis.locate(x)
        cell = self.cells[index]
        return cell[0] + u * cell[1]


class Surfaces(eqx.Module):
    """K functions of two arguments on the same two axes, bilinear within a cell.

    Attributes
    ----------
    axis_x, axis_y
        The common axes, nx and ny breakpoints.
    cells
        Per cell (row-major over x, y) the four coefficients of 1, u, v, u v; shape ((nx - 1)(ny - 1), 4, k).
    """

    axis_x: Axis
    axis_y: Axis
    cells: Float[Array, "cells 4 k"]

    def __call__(self, x: ScalarLike, y: ScalarLike) -> Float[Array, " k"]:
        """Interpolate all k surfaces at (x, y)."""
        i, u = self.axis_x.locate(x)
        j, v = self.axis_y.locate(y)
        cell = self.cells[i * self.axis_y.cells + j]
        return cell[0] + u * cell[1] + v * (cell[2] + u * cell[3])


def make_axis(breakpoints: Sequence[float] | np.ndarray, *, clamp: bool) -> Axis:
    """Build an axis; `clamp` holds the end values, otherwise the end cells are extrapolated linearly.

    Raises
    ------
    ValueError
        If there are fewer than two breakpoints or they do not strictly increase.
    """
    points = np.asarray(breakpoints, dtype=float)
    if points.ndim != 1 or points.shape[0] < 2 or not np.all(points[1:] > points[:-1]):
        raise ValueError(f"table axis: breakpoints must be two or more, strictly increasing; got {breakpoints}")
    lower, upper = (points[0], points[-1]) if clamp else (-np.inf, np.inf)
    return Axis(breakpoints=jnp.asarray(points), lower=jnp.asarray(np.array(lower)), upper=jnp.asarray(np.array(upper)))


def make_curves(axis: Axis, values: Sequence[Sequence[float] | np.ndarray]) -> Curves:
    """Pack k curves, each of n values on the axis.

    Raises
    ------
    ValueError
        If a curve's length is not the axis' length.
    """
    table = np.asarray(values, dtype=float).T
    if table.shape[0] != axis.breakpoints.shape[0]:
        raise ValueError(f"table: {table.shape[0]} values on an axis of {axis.breakpoints.shape[0]} breakpoints")
    return Curves(axis=axis, cells=jnp.asarray(np.stack([table[:-1], table[1:] - table[:-1]], axis=1)))


def make_surfaces(axis_x: Axis, axis_y: Axis, values: Sequence[np.ndarray]) -> Surfaces:
    """Pack k surfaces, each of shape (nx, ny) on the two axes.

    Raises
    ------
    ValueError
        If a surface's shape is not that of the axes.
    """
    table = np.stack([np.asarray(value, dtype=float) for value in values], axis=-1)
    shape = (axis_x.breakpoints.shape[0], axis_y.breakpoints.shape[0])
    if table.shape[:2] != shape:
        raise ValueError(f"table: values of shape {table.shape[:2]} on axes of {shape} breakpoints")
    corner = table[:-1, :-1]
    along_x = table[1:, :-1] - corner
    along_y = table[:-1, 1:] - corner
    twist = table[1:, 1:] - corner - along_x - along_y
    cells = np.stack([corner, along_x, along_y, twist], axis=2).reshape(-1, 4, table.shape[-1])
    return Surfaces(axis_x=axis_x, axis_y=axis_y, cells=jnp.asarray(cells))
