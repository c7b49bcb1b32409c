"""Tables of a DAVE-ML file in JAX.

Gridded tables grouped by shared axes, and scattered points interpolated linearly on a Delaunay triangulation.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial import Delaunay, QhullError

from anser.dave_ml.definition import Argument, Definition, Function, Interpolate, UngriddedTable
from anser.dave_ml.elements import quote
from anser.numerics.arrays import as_array
from anser.numerics.tables import Axes, Tables, make_axes, make_tables
from anser.shapes import Scalar

PACKED_NUMBERS_MAX: Final = 4_000_000
"""Numbers of all gridded functions together, counted for each corner of each cell: so they are kept."""


class Lookup(eqx.Module):
    """Functions that are looked up at once.

    Attributes
    ----------
    tables
        All their tables.
    arguments
        The variable on each axis.
    results
        The variables that each group of `tables` gives.
    between
        How each axis is interpolated.
    """

    tables: Tables
    arguments: tuple[str, ...] = eqx.field(static=True)
    results: tuple[tuple[str, ...], ...] = eqx.field(static=True)
    interpolation: tuple[Interpolate, ...] = eqx.field(static=True)

    @property
    def result_names(self) -> tuple[str, ...]:
        """All its results."""
        return tuple(result for group in self.results for result in group)

    def __call__(self, values: Mapping[str, Array], wanted: Collection[str]) -> dict[str, Array]:
        """The wanted of its results, by varID; only arguments on which they depend need be known."""
        groups = [k for k, results in enumerate(self.results) if not set(results).isdisjoint(wanted)]
        axes = sorted({axis for k in groups for axis in self.tables.axis_indices[k]})
        tables = self.tables if len(groups) == len(self.results) else _select_tables(self.tables, groups, axes)
        x = jnp.stack([values[self.arguments[axis]] for axis in axes])
        index, fraction = tables.axes.locate(x)
        if any(self.interpolation[axis] != "linear" for axis in axes):
            stepped = [_step_fraction(self.interpolation[axis], fraction[k]) for k, axis in enumerate(axes)]
            fraction = jnp.stack(stepped)
        found = tables.interpolate_cell(index, fraction)
        return {
            result: found[k][column]
            for k, group in enumerate(groups)
            for column, result in enumerate(self.results[group])
            if result in wanted
        }


def _step_fraction(interpolation: Interpolate, fraction: Array) -> Array:
    """The fraction at which an axis that is not interpolated linearly takes its value.

    DAVE-ML 2.0.2 reference, section 6.3: the next breakpoint's value from the middle on (discrete), as soon as the last
    is passed (ceiling), when it is reached (floor).
    """
    if interpolation == "discrete":
        return jnp.where(fraction >= 0.5, 1.0, 0.0)
    if interpolation == "ceiling":
        return jnp.where(fraction > 0.0, 1.0, 0.0)
    if interpolation == "floor":
        return jnp.where(fraction >= 1.0, 1.0, 0.0)
    return fraction


def _select_tables(tables: Tables, groups: Sequence[int], axes: Sequence[int]) -> Tables:
    """Some groups of tables, on the axes that they need."""
    all_axes = tables.axes
    part = Axes(
        breakpoints=jnp.stack([all_axes.breakpoints[axis] for axis in axes]),
        lower=jnp.stack([all_axes.lower[axis] for axis in axes]),
        upper=jnp.stack([all_axes.upper[axis] for axis in axes]),
        sizes=tuple(all_axes.sizes[axis] for axis in axes),
        even=all_axes.even,
    )
    return Tables(
        axes=part,
        cells=tuple(tables.cells[k] for k in groups),
        axis_indices=tuple(tuple(axes.index(axis) for axis in tables.axis_indices[k]) for k in groups),
    )


def refuse_too_large(definition: Definition, functions: Sequence[Function]) -> None:
    """Refuse gridded functions whose tables, as they are looked up, take too much memory together.

    Raises
    ------
    DaveMlError
        They do.
    """
    numbers = 0
    for function in functions:
        shape = definition.gridded[function.table].values.shape
        numbers += 2 ** len(shape) * math.prod(max(n - 1, 1) for n in shape)
        if numbers > PACKED_NUMBERS_MAX:
            arrived = f"tables with more than {PACKED_NUMBERS_MAX:,} numbers at the corners of their cells"
            raise function.location.fault(arrived, "fewer or smaller tables")


@dataclass(frozen=True)
class _Axis:
    """An argument on breakpoints, with what happens beyond and between them; equal ones are looked up once."""

    variable: str
    points: tuple[float, ...]
    lower: float
    upper: float
    interpolation: Interpolate
    even: bool


def _axis_of(argument: Argument, points: np.ndarray) -> _Axis:
    """The axis of an argument: clipped to its own limits, and to the table's ends where it is not extrapolated."""
    stepped = argument.interpolate != "linear"
    below = argument.extrapolate in ("min", "both") and not stepped and points.size > 1
    above = argument.extrapolate in ("max", "both") and not stepped and points.size > 1
    lower = -np.inf if below else points[0]
    upper = np.inf if above else points[-1]
    if argument.minimum is not None:
        lower = min(max(lower, argument.minimum), upper)
    if argument.maximum is not None:
        upper = max(min(upper, argument.maximum), lower)
    held = np.append(points, points[0] + 1.0) if points.size == 1 else points
    even = not stepped and make_axes([held], clamp=True).even
    return _Axis(argument.id, tuple(held.tolist()), float(lower), float(upper), argument.interpolate, even)


def make_lookups(definition: Definition, functions: Sequence[Function]) -> tuple[Lookup, ...]:
    """Look-ups of gridded functions whose arguments are known at the same time.

    Those on evenly spaced axes alone are kept apart, since their place is computed and not searched for.
    """
    given: dict[Function, tuple[list[_Axis], np.ndarray]] = {}
    for function in functions:
        table = definition.gridded[function.table]
        axes = []
        values = table.values
        for k, (argument, identifier) in enumerate(zip(function.arguments, table.axes, strict=True)):
            axis = _axis_of(argument, definition.breakpoints[identifier].points)
            if values.shape[k] == 1:
                values = np.repeat(values, 2, axis=k)
            axes.append(axis)
        given[function] = (axes, values)
    even = {f: v for f, v in given.items() if all(axis.even for axis in v[0])}
    rest = {f: v for f, v in given.items() if f not in even}
    return tuple(_lookup(part) for part in (even, rest) if part)


def _lookup(given: Mapping[Function, tuple[list[_Axis], np.ndarray]]) -> Lookup:
    places: dict[_Axis, int] = {}
    for axes, _ in given.values():
        for axis in axes:
            places.setdefault(axis, len(places))
    groups: dict[tuple[int, ...], list[tuple[str, np.ndarray]]] = {}
    for function, (axes, values) in given.items():
        # One order of the axes for all, so that functions of the same arguments fall into one group.
        order = sorted(range(len(axes)), key=lambda k, axes=axes: places[axes[k]])
        along = tuple(places[axes[k]] for k in order)
        groups.setdefault(along, []).append((function.result, np.transpose(values, order)))
    made = make_axes([axis.points for axis in places], clamp=True)
    axes = Axes(
        breakpoints=made.breakpoints,
        lower=as_array([axis.lower for axis in places]),
        upper=as_array([axis.upper for axis in places]),
        sizes=made.sizes,
        # A computed place may miss a breakpoint by rounding, which a step does not forgive.
        even=made.even and all(axis.interpolation == "linear" for axis in places),
    )
    return Lookup(
        tables=make_tables(axes, [(along, [values for _, values in group]) for along, group in groups.items()]),
        arguments=tuple(axis.variable for axis in places),
        results=tuple(tuple(result for result, _ in group) for group in groups.values()),
        interpolation=tuple(axis.interpolation for axis in places),
    )


POINTS_MAX: Final = {2: 5000, 3: 200, 4: 100, 5: 50}
"""Points of an ungridded table, by the number of its coordinates: bounds the simplices and the time to find them."""
_INSIDE: Final = -1e-12
"""Least barycentric coordinate of a point within a simplex: rounding."""


class ScatteredTable(eqx.Module):
    """A function of scattered points.

    Within the convex hull of the points it is linear on each simplex. Beyond, it is held at the nearest place of the
    hull's facets (of two arguments exactly the nearest; of more, barycentric coordinates are clipped to the nearest
    facet) or, where `extrapolated`, goes on as in the simplex that the point misses least.

    Attributes
    ----------
    to_barycentric, origins
        Of each simplex, the matrix from coordinates relative to its origin to its first barycentric coordinates;
        shapes (s, d, d) and (s, d).
    corners
        Points of each simplex; shape (s, d + 1).
    facet_origins, facet_inverses, facet_edges, facet_corners
        The same of the hull's facets; shapes (f, d), (f, d - 1, d), (f, d, d - 1) and (f, d).
    values
        At each point; shape (n,).
    lower, upper
        Limits of the arguments; shape (d,).
    arguments, result
        Variables.
    """

    to_barycentric: Float[Array, "s d d"]
    origins: Float[Array, "s d"]
    corners: Int[Array, "s c"]
    facet_origins: Float[Array, "f d"]
    facet_inverses: Float[Array, "f e d"]
    facet_edges: Float[Array, "f d e"]
    facet_corners: Int[Array, "f d"]
    values: Float[Array, " n"]
    lower: Float[Array, " d"]
    upper: Float[Array, " d"]
    arguments: tuple[str, ...] = eqx.field(static=True)
    result: str = eqx.field(static=True)
    extrapolated: bool = eqx.field(static=True)

    @property
    def result_names(self) -> tuple[str, ...]:
        """Its result."""
        return (self.result,)

    def __call__(self, values: Mapping[str, Array], wanted: Collection[str]) -> dict[str, Array]:
        """The result, by varID, if it is wanted."""
        x = jnp.stack([values[name] for name in self.arguments])
        return {self.result: self._interpolate(x)} if self.result in wanted else {}

    def _interpolate(self, x: Float[Array, " d"]) -> Scalar:
        x = jnp.clip(x, self.lower, self.upper)
        first = jnp.sum(self.to_barycentric * (x[None] - self.origins)[:, None, :], axis=2)
        weights = jnp.concatenate([first, 1.0 - jnp.sum(first, axis=1, keepdims=True)], axis=1)
        least = jnp.min(weights, axis=1)
        best = jnp.argmax(least)
        inside = jnp.sum(weights[best] * self.values[self.corners[best]])
        if self.extrapolated:
            return inside
        return jnp.where(least[best] >= _INSIDE, inside, self._nearest_facet_value(x))

    def _nearest_facet_value(self, x: Float[Array, " d"]) -> Scalar:
        away = x[None] - self.facet_origins
        first = jnp.sum(self.facet_inverses * away[:, None, :], axis=2)
        weights = jnp.concatenate([1.0 - jnp.sum(first, axis=1, keepdims=True), first], axis=1)
        weights = jnp.clip(weights, 0.0, None)
        weights = weights / jnp.sum(weights, axis=1, keepdims=True)
        on_facet = jnp.sum(self.facet_edges * weights[:, None, 1:], axis=2)
        nearest = jnp.argmin(jnp.sum((away - on_facet) ** 2, axis=1))
        return jnp.sum(weights[nearest] * self.values[self.facet_corners[nearest]])


def make_scattered(definition: Definition, function: Function, mesh: Any) -> ScatteredTable:
    """The function of an ungridded table of two or more arguments, on the mesh of its points.

    Raises
    ------
    DaveMlError
        A way of interpolation or extrapolation is asked for that scattered points do not have.
    """
    table = definition.ungridded[function.table]
    extrapolated = _extrapolated(function)
    points = mesh.points
    d = points.shape[1]
    at, side = np.nonzero(mesh.neighbors == -1)
    facets = np.array([np.delete(mesh.simplices[s], k) for s, k in zip(at, side, strict=True)])
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
        lower=as_array([-np.inf if least is None else least for least, _ in limits]),
        upper=as_array([np.inf if greatest is None else greatest for _, greatest in limits]),
        arguments=tuple(argument.id for argument in function.arguments),
        result=function.result,
        extrapolated=extrapolated,
    )


def _extrapolated(function: Function) -> bool:
    if any(argument.interpolate != "linear" for argument in function.arguments):
        raise function.location.fault("interpolation other than linear between scattered points", "linear")
    ways = {argument.extrapolate for argument in function.arguments}
    if ways not in ({"neither"}, {"both"}):
        arrived = f"extrapolate={' and '.join(sorted(ways))} of scattered points"
        raise function.location.fault(arrived, "neither or both, the same for all arguments")
    return ways == {"both"}


def make_meshes(tables: Iterable[UngriddedTable]) -> dict[str, Any]:
    """Delaunay triangulations of tables with two coordinates or more, by their identifiers.

    Raises
    ------
    DaveMlError
        The points of a table span no volume, two have the same coordinates, or there are too many in all.
    """
    meshes = {}
    effort = 0.0
    for table in tables:
        count, d = table.points.shape
        effort += (count / POINTS_MAX[d]) ** 2 if d in POINTS_MAX else 2.0
        if effort > 1.0:
            known = ", ".join(f"{n:,} of {k}" for k, n in POINTS_MAX.items())
            right = f"at most {known} coordinates; of several tables the squares of the parts count together"
            raise table.location.fault(f"{count:,} scattered points of {d} coordinates in {quote(table.id)}", right)
        meshes[table.id] = _mesh(table)
    return meshes


def _mesh(table: UngriddedTable) -> Any:
    """Delaunay triangulation of the points, in the units in which they stand."""
    count, d = table.points.shape
    refuse_duplicate_points(table)
    flat = table.location.fault(
        f"table {quote(table.id)}, whose points span no volume", f"points that span {d} dimensions"
    )
    if count < d + 1 or np.linalg.matrix_rank(table.points - table.points[0]) < d:
        raise flat
    try:
        mesh = Delaunay(table.points)
    except QhullError:
        raise flat from None
    if not np.all(np.isfinite(mesh.transform)) or mesh.coplanar.size:
        raise flat
    return mesh


def refuse_duplicate_points(table: UngriddedTable) -> None:
    """Refuse two points with the same coordinates.

    Raises
    ------
    DaveMlError
        There are two.
    """
    if len(np.unique(table.points, axis=0)) < len(table.points):
        raise table.location.fault(f"table {quote(table.id)} with two points at one place", "one value for each place")
