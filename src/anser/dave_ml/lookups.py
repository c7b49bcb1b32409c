"""Gridded tables of a DAVE-ML file, grouped by the arguments and breakpoints that they share."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.dave_ml.definition import Argument, Definition, Function, Interpolate
from anser.numerics import Axes, Tables, as_array, make_axes, make_tables

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
    between: tuple[Interpolate, ...] = eqx.field(static=True)

    @property
    def gives(self) -> tuple[str, ...]:
        """All its results."""
        return tuple(result for group in self.results for result in group)

    def __call__(self, values: Mapping[str, Array], wanted: Collection[str]) -> dict[str, Array]:
        """The wanted of its results, by varID; only arguments on which they depend need be known."""
        groups = [k for k, results in enumerate(self.results) if not set(results).isdisjoint(wanted)]
        axes = sorted({axis for k in groups for axis in self.tables.along[k]})
        tables = self.tables if len(groups) == len(self.results) else _part_of(self.tables, groups, axes)
        x = jnp.stack([values[self.arguments[axis]] for axis in axes])
        index, fraction = tables.axes.locate(x)
        if any(self.between[axis] != "linear" for axis in axes):
            stepped = [_stepped(self.between[axis], fraction[k]) for k, axis in enumerate(axes)]
            fraction = jnp.stack(stepped)
        found = tables.within(index, fraction)
        return {
            result: found[k][column]
            for k, group in enumerate(groups)
            for column, result in enumerate(self.results[group])
            if result in wanted
        }


def _stepped(between: Interpolate, fraction: Array) -> Array:
    """The fraction at which an axis that is not interpolated linearly takes its value.

    DAVE-ML 2.0.2 reference, section 6.3: the next breakpoint's value from the middle on (discrete), as soon as the last
    is passed (ceiling), when it is reached (floor).
    """
    if between == "discrete":
        return jnp.where(fraction >= 0.5, 1.0, 0.0)
    if between == "ceiling":
        return jnp.where(fraction > 0.0, 1.0, 0.0)
    if between == "floor":
        return jnp.where(fraction >= 1.0, 1.0, 0.0)
    return fraction


def _part_of(tables: Tables, groups: Sequence[int], axes: Sequence[int]) -> Tables:
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
        along=tuple(tuple(axes.index(axis) for axis in tables.along[k]) for k in groups),
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
            raise function.place.fault(arrived, "fewer or smaller tables")


@dataclass(frozen=True)
class _Axis:
    """An argument on breakpoints, with what happens beyond and between them; equal ones are looked up once."""

    variable: str
    points: tuple[float, ...]
    lower: float
    upper: float
    between: Interpolate
    even: bool


def _axis_of(argument: Argument, points: np.ndarray) -> _Axis:
    """The axis of an argument: clipped to its own limits, and to the table's ends where it is not extrapolated."""
    stepped = argument.interpolate != "linear"
    below = argument.extrapolate in ("min", "both") and not stepped and points.size > 1
    above = argument.extrapolate in ("max", "both") and not stepped and points.size > 1
    lower = -np.inf if below else points[0]
    upper = np.inf if above else points[-1]
    if argument.least is not None:
        lower = min(max(lower, argument.least), upper)
    if argument.greatest is not None:
        upper = max(min(upper, argument.greatest), lower)
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
        even=made.even and all(axis.between == "linear" for axis in places),
    )
    return Lookup(
        tables=make_tables(axes, [(along, [values for _, values in group]) for along, group in groups.items()]),
        arguments=tuple(axis.variable for axis in places),
        results=tuple(tuple(result for result, _ in group) for group in groups.values()),
        between=tuple(axis.between for axis in places),
    )
