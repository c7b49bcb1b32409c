"""Ungridded tables: linear within the simplices of a Delaunay triangulation of their points."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any, Final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial import Delaunay, QhullError

from anser.dave_ml.definition import Definition, Function, UngriddedTable
from anser.dave_ml.errors import shown
from anser.numerics import as_array
from anser.shapes import Scalar

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
    def gives(self) -> tuple[str, ...]:
        """Its result."""
        return (self.result,)

    def __call__(self, values: Mapping[str, Array], wanted: Collection[str]) -> dict[str, Array]:
        """The result, by varID, if it is wanted."""
        x = jnp.stack([values[name] for name in self.arguments])
        return {self.result: self._at(x)} if self.result in wanted else {}

    def _at(self, x: Float[Array, " d"]) -> Scalar:
        x = jnp.clip(x, self.lower, self.upper)
        first = jnp.sum(self.to_barycentric * (x[None] - self.origins)[:, None, :], axis=2)
        weights = jnp.concatenate([first, 1.0 - jnp.sum(first, axis=1, keepdims=True)], axis=1)
        least = jnp.min(weights, axis=1)
        best = jnp.argmax(least)
        inside = jnp.sum(weights[best] * self.values[self.corners[best]])
        if self.extrapolated:
            return inside
        return jnp.where(least[best] >= _INSIDE, inside, self._held(x))

    def _held(self, x: Float[Array, " d"]) -> Scalar:
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
    limits = [(argument.least, argument.greatest) for argument in function.arguments]
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
        raise function.place.fault("interpolation other than linear between scattered points", "linear")
    ways = {argument.extrapolate for argument in function.arguments}
    if ways not in ({"neither"}, {"both"}):
        arrived = f"extrapolate={' and '.join(sorted(ways))} of scattered points"
        raise function.place.fault(arrived, "neither or both, the same for all arguments")
    return ways == {"both"}


def meshes_of(tables: Iterable[UngriddedTable]) -> dict[str, Any]:
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
            raise table.place.fault(f"{count:,} scattered points of {d} coordinates in {shown(table.id)}", right)
        meshes[table.id] = _mesh(table)
    return meshes


def _mesh(table: UngriddedTable) -> Any:
    """Delaunay triangulation of the points, in the units in which they stand."""
    count, d = table.points.shape
    refuse_doubles(table)
    flat = table.place.fault(
        f"table {shown(table.id)}, whose points span no volume", f"points that span {d} dimensions"
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


def refuse_doubles(table: UngriddedTable) -> None:
    """Refuse two points with the same coordinates.

    Raises
    ------
    DaveMlError
        There are two.
    """
    if len(np.unique(table.points, axis=0)) < len(table.points):
        raise table.place.fault(f"table {shown(table.id)} with two points at one place", "one value for each place")
