"""Tables of a DAVE-ML file in JAX: gridded tables, and ungridded tables on a Delaunay triangulation."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from anser.dave_ml.definition import Argument, Definition, Function, Interpolate, UngriddedTable
from anser.dave_ml.elements import quote
from anser.numerics.arrays import as_array
from anser.numerics.tables import Axes, Tables, make_axes, make_tables
from anser.shapes import Scalar

PACKED_NUMBERS_MAX: Final = 4_000_000
"""Greatest number of stored values of all gridded functions together: a value for each corner of each cell."""


class Lookup(eqx.Module):
    """Gridded functions that are looked up together; functions on the same axes form a group."""

    tables: Tables
    arguments: tuple[str, ...] = eqx.field(static=True)  #: Variable (varID) on each axis.
    results: tuple[tuple[str, ...], ...] = eqx.field(static=True)  #: Results (varID) of the functions in each group.
    interpolation: tuple[Interpolate, ...] = eqx.field(static=True)  #: Kind of interpolation on each axis.

    @property
    def result_names(self) -> tuple[str, ...]:
        """VarIDs of the results of all functions."""
        return tuple(result for group in self.results for result in group)

    def __call__(self, values: Mapping[str, Array], requested: Collection[str]) -> dict[str, Array]:
        """Return the `requested` results by varID, before clipping to the limits of the variables.

        `values`, by varID, must contain the arguments of the requested functions.
        """
        groups = [k for k, results in enumerate(self.results) if not set(results).isdisjoint(requested)]
        axes = sorted({axis for k in groups for axis in self.tables.axis_indices[k]})
        tables = self.tables if len(groups) == len(self.results) else _select_tables(self.tables, groups, axes)
        x = jnp.stack([values[self.arguments[axis]] for axis in axes])
        index, fraction = tables.axes.locate(x)
        if any(self.interpolation[axis] != "linear" for axis in axes):
            stepped = [_step_fraction(self.interpolation[axis], fraction[k]) for k, axis in enumerate(axes)]
            fraction = jnp.stack(stepped)
        interpolated = tables.interpolate_cell(index, fraction)
        return {
            result: interpolated[k][column]
            for k, group in enumerate(groups)
            for column, result in enumerate(self.results[group])
            if result in requested
        }


def _step_fraction(interpolation: Interpolate, fraction: Array) -> Array:
    """Return the fraction within the interval between two breakpoints; 0 or 1 if the interpolation is not linear.

    The fraction is 1 at or above the middle (discrete), 1 above the lower breakpoint (ceiling), 1 at the upper
    breakpoint (floor). Source: DAVE-ML 2.0.2 reference, section 6.3.
    """
    if interpolation == "linear":
        return fraction
    is_next = {"discrete": fraction >= 0.5, "ceiling": fraction > 0.0, "floor": fraction >= 1.0}[interpolation]
    return jnp.where(is_next, 1.0, 0.0)


def _select_tables(tables: Tables, groups: Sequence[int], axes: Sequence[int]) -> Tables:
    all_axes = tables.axes
    arrays = (all_axes.breakpoints, all_axes.lower, all_axes.upper)
    breakpoints, lower, upper = (jnp.stack([array[axis] for axis in axes]) for array in arrays)
    part = Axes(breakpoints, lower, upper, sizes=tuple(all_axes.sizes[axis] for axis in axes), even=all_axes.even)
    return Tables(
        axes=part,
        cells=tuple(tables.cells[k] for k in groups),
        axis_indices=tuple(tuple(axes.index(axis) for axis in tables.axis_indices[k]) for k in groups),
    )


def refuse_too_large(definition: Definition, functions: Sequence[Function]) -> None:
    """Raise DaveMlError if the stored tables of gridded functions exceed `PACKED_NUMBERS_MAX` numbers in total."""
    numbers = 0
    for function in functions:
        shape = definition.gridded[function.table].values.shape
        numbers += 2 ** len(shape) * math.prod(max(n - 1, 1) for n in shape)
        if numbers > PACKED_NUMBERS_MAX:
            arrived = f"tables with more than {PACKED_NUMBERS_MAX:,} numbers at the corners of their cells"
            raise function.location.fault(arrived, "fewer or smaller tables")


@dataclass(frozen=True)
class _Axis:
    """Axis of a table: variable (varID), breakpoints, and limits to which the variable is clipped before the lookup."""

    variable: str
    points: tuple[float, ...]
    lower: float
    upper: float
    interpolation: Interpolate
    even: bool  #: Whether the interpolation is linear and the breakpoints are evenly spaced.


def _axis_of(argument: Argument, points: np.ndarray) -> _Axis:
    stepped = argument.interpolate != "linear"
    below = argument.extrapolate in ("min", "both") and not stepped and points.size > 1
    above = argument.extrapolate in ("max", "both") and not stepped and points.size > 1
    lower = -np.inf if below else points[0]
    upper = np.inf if above else points[-1]
    if argument.minimum is not None:
        lower = min(max(lower, argument.minimum), upper)
    if argument.maximum is not None:
        upper = max(min(upper, argument.maximum), lower)
    axis_points = np.append(points, points[0] + 1.0) if points.size == 1 else points
    even = not stepped and make_axes([axis_points], clamp=True).even
    return _Axis(argument.id, tuple(axis_points.tolist()), float(lower), float(upper), argument.interpolate, even)


def make_lookups(definition: Definition, functions: Sequence[Function]) -> tuple[Lookup, ...]:
    """Return one lookup for the gridded functions on evenly spaced axes, and one for all other gridded functions.

    Even spacing allows a lookup without a search for the cell. A lookup without functions is left out.
    """
    gridded: dict[Function, tuple[list[_Axis], np.ndarray]] = {}
    for function in functions:
        table = definition.gridded[function.table]
        points = [definition.breakpoints[identifier].points for identifier in table.axes]
        axes = [
            _axis_of(argument, axis_points) for argument, axis_points in zip(function.arguments, points, strict=True)
        ]
        values = table.values
        for k in (k for k, size in enumerate(table.values.shape) if size == 1):
            values = np.repeat(values, 2, axis=k)
        gridded[function] = (axes, values)
    even = {f: v for f, v in gridded.items() if all(axis.even for axis in v[0])}
    uneven = {f: v for f, v in gridded.items() if f not in even}
    return tuple(_lookup(part) for part in (even, uneven) if part)


def _lookup(gridded: Mapping[Function, tuple[list[_Axis], np.ndarray]]) -> Lookup:
    axis_index: dict[_Axis, int] = {}
    for axes, _ in gridded.values():
        for axis in axes:
            axis_index.setdefault(axis, len(axis_index))
    groups: dict[tuple[int, ...], list[tuple[str, np.ndarray]]] = {}
    for function, (axes, values) in gridded.items():
        # common axis order, so that functions of the same arguments share a group
        order = sorted(range(len(axes)), key=lambda k, axes=axes: axis_index[axes[k]])
        axis_indices = tuple(axis_index[axes[k]] for k in order)
        groups.setdefault(axis_indices, []).append((function.result, np.transpose(values, order)))
    search_axes = make_axes([axis.points for axis in axis_index], clamp=True)
    axes = Axes(
        breakpoints=search_axes.breakpoints,
        lower=as_array([axis.lower for axis in axis_index]),
        upper=as_array([axis.upper for axis in axis_index]),
        sizes=search_axes.sizes,
        # a computed cell index may be off by one at a breakpoint: harmless for linear axes, wrong for stepped axes
        even=search_axes.even and all(axis.interpolation == "linear" for axis in axis_index),
    )
    return Lookup(
        tables=make_tables(
            axes, [(axis_indices, [values for _, values in group]) for axis_indices, group in groups.items()]
        ),
        arguments=tuple(axis.variable for axis in axis_index),
        results=tuple(tuple(result for result, _ in group) for group in groups.values()),
        interpolation=tuple(axis.interpolation for axis in axis_index),
    )


POINTS_MAX: Final = {2: 5000, 3: 200, 4: 100, 5: 50}
"""Greatest number of points of an ungridded table, by number of coordinates; bounds memory and search time."""
_INSIDE: Final = -1e-12
"""Least barycentric coordinate of a point inside a simplex; below 0 because of rounding."""


class ScatteredTable(eqx.Module):
    """Function given by values at scattered points (ungridded table), linear on each simplex.

    Outside the convex hull, the value of the nearest point on the hull's facets is used; for more than two arguments
    this point is approximate. If `extrapolated`, the linear function of the nearest simplex is continued instead. The
    nearest simplex is the simplex in which the least barycentric coordinate is greatest.
    """

    # s simplices with d + 1 corners, and f facets of the hull
    to_barycentric: Float[Array, "s d d"]  #: Matrix from x - origin to the first d barycentric coordinates.
    origins: Float[Array, "s d"]
    corners: Int[Array, "s c"]  #: Indices of the corners in `values`.
    facet_origins: Float[Array, "f d"]
    facet_inverses: Float[Array, "f e d"]  #: Pseudo-inverses of `facet_edges`.
    facet_edges: Float[Array, "f d e"]
    facet_corners: Int[Array, "f d"]  #: Indices of the corners in `values`.
    values: Float[Array, " n"]  #: Value at each point.
    #: Limits to which the arguments are clipped.
    lower: Float[Array, " d"]
    upper: Float[Array, " d"]
    arguments: tuple[str, ...] = eqx.field(static=True)  #: varIDs of the arguments.
    result: str = eqx.field(static=True)  #: varID of the dependent variable.
    extrapolated: bool = eqx.field(static=True)

    @property
    def result_names(self) -> tuple[str, ...]:
        """VarID of the dependent variable, as a tuple."""
        return (self.result,)

    def __call__(self, values: Mapping[str, Array], requested: Collection[str]) -> dict[str, Array]:
        """Return the interpolated value by the varID of the result; an empty mapping if the result is not requested."""
        x = jnp.stack([values[name] for name in self.arguments])
        return {self.result: self._interpolate(x)} if self.result in requested else {}

    def _interpolate(self, x: Float[Array, " d"]) -> Scalar:
        x = jnp.clip(x, self.lower, self.upper)
        leading = jnp.sum(self.to_barycentric * (x[None] - self.origins)[:, None, :], axis=2)
        weights = jnp.concatenate([leading, 1.0 - jnp.sum(leading, axis=1, keepdims=True)], axis=1)
        smallest_weight = jnp.min(weights, axis=1)
        simplex = jnp.argmax(smallest_weight)
        inside = jnp.sum(weights[simplex] * self.values[self.corners[simplex]])
        if self.extrapolated:
            return inside
        return jnp.where(smallest_weight[simplex] >= _INSIDE, inside, self._nearest_facet_value(x))

    def _nearest_facet_value(self, x: Float[Array, " d"]) -> Scalar:
        offset = x[None] - self.facet_origins
        trailing = jnp.sum(self.facet_inverses * offset[:, None, :], axis=2)
        weights = jnp.concatenate([1.0 - jnp.sum(trailing, axis=1, keepdims=True), trailing], axis=1)
        weights = jnp.clip(weights, 0.0, None)
        weights = weights / jnp.sum(weights, axis=1, keepdims=True)
        facet_offset = jnp.sum(self.facet_edges * weights[:, None, 1:], axis=2)
        nearest = jnp.argmin(jnp.sum((offset - facet_offset) ** 2, axis=1))
        return jnp.sum(weights[nearest] * self.values[self.facet_corners[nearest]])


def make_scattered(definition: Definition, function: Function, mesh: Any) -> ScatteredTable:
    """Build the function of an ungridded table with two or more arguments; `mesh` is the Delaunay mesh of its points.

    Raises DaveMlError if the file requests an interpolation or extrapolation that scattered points do not support.
    """
    table = definition.ungridded[function.table]
    extrapolated = _extrapolated(function)
    points = mesh.points
    d = points.shape[1]
    hull_simplices, opposite_corners = np.nonzero(mesh.neighbors == -1)
    facets = np.array([np.delete(mesh.simplices[s], k) for s, k in zip(hull_simplices, opposite_corners, strict=True)])
    edges = np.swapaxes(points[facets[:, 1:]] - points[facets[:, :1]], 1, 2)
    limits = [(argument.minimum, argument.maximum) for argument in function.arguments]
    return ScatteredTable(
        to_barycentric=as_array(mesh.transform[:, :d]),
        origins=as_array(mesh.transform[:, d]),
        corners=as_array(mesh.simplices, np.int32),
        facet_origins=as_array(points[facets[:, 0]]),
        facet_inverses=as_array(np.linalg.pinv(edges)),
        facet_edges=as_array(edges),
        facet_corners=as_array(facets, np.int32),
        values=as_array(table.values),
        lower=as_array([-np.inf if minimum is None else minimum for minimum, _ in limits]),
        upper=as_array([np.inf if maximum is None else maximum for _, maximum in limits]),
        arguments=tuple(argument.id for argument in function.arguments),
        result=function.result,
        extrapolated=extrapolated,
    )


def _extrapolated(function: Function) -> bool:
    if any(argument.interpolate != "linear" for argument in function.arguments):
        raise function.location.fault("interpolation other than linear between scattered points", "linear")
    extrapolations = {argument.extrapolate for argument in function.arguments}
    if extrapolations not in ({"neither"}, {"both"}):
        arrived = f"extrapolate={' and '.join(sorted(extrapolations))} of scattered points"
        raise function.location.fault(arrived, "neither or both, the same for all arguments")
    return extrapolations == {"both"}


def make_meshes(tables: Iterable[UngriddedTable]) -> dict[str, Any]:
    """Compute the Delaunay triangulations of the tables with two or more coordinates, by utID.

    Raises DaveMlError if the points of a table span no volume or coincide, or if there are too many points or
    coordinates (`POINTS_MAX`).
    """
    meshes = {}
    effort = 0.0
    for table in tables:
        count, d = table.points.shape
        effort += (count / POINTS_MAX[d]) ** 2 if d in POINTS_MAX else 2.0
        if effort > 1.0:
            limits = ", ".join(f"{n:,} of {k}" for k, n in POINTS_MAX.items())
            right = f"at most {limits} coordinates; of several tables the squares of the parts count together"
            raise table.location.fault(f"{count:,} scattered points of {d} coordinates in {quote(table.id)}", right)
        meshes[table.id] = _mesh(table)
    return meshes


def _mesh(table: UngriddedTable) -> Any:
    count, d = table.points.shape
    refuse_duplicate_points(table)
    flat = table.location.fault(
        f"table {quote(table.id)}, whose points span no volume", f"points that span {d} dimensions"
    )
    if count < d + 1 or np.linalg.matrix_rank(table.points - table.points[0]) < d:
        raise flat
    from scipy.spatial import Delaunay, QhullError  # a sixth of a second, for aircraft with such a table only

    try:
        mesh = Delaunay(table.points)
    except QhullError:
        raise flat from None
    if not np.all(np.isfinite(mesh.transform)) or mesh.coplanar.size:
        raise flat
    return mesh


def refuse_duplicate_points(table: UngriddedTable) -> None:
    """Raise DaveMlError if two points of a table have the same coordinates."""
    if len(np.unique(table.points, axis=0)) < len(table.points):
        raise table.location.fault(f"table {quote(table.id)} with two points at one place", "one value for each place")
