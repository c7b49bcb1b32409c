"""Layers of wind fitted to a wind field for planning, with rigorous bounds of the difference between field and layers.

In each cell of a wind field, the wind is linear in time, in both horizontal coordinates and between two levels. The
altitude of a level is linear in time and in both horizontal coordinates. If the layers' wind is linear in altitude
within the cell, the magnitude of the difference is convex in each coordinate, with the maximum at a vertex. Deviations
of the layers' wind from a linear function are bounded separately.
"""

from itertools import pairwise, product
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import GEOPOTENTIAL_RADIUS_M
from anser.environment.air import geometric_altitude, geopotential_altitude
from anser.environment.environment import AbstractWind, LayeredWind
from anser.numerics.arrays import as_array
from anser.shapes import ScalarLike, Vector3

BEYOND_FIELD_M_S = 1e3
"""Bound of the difference outside of the blocks, m/s: no path there satisfies its limits."""
_BLOCKS = 8  # blocks along each axis of the box `Way`; one more block on each side reaches to the ends
_LAYERS = 8  # number of layers, with the padding: one shape, so that another field does not compile again
_MISSED_M_S = 1e-6  # deviation of a level from the chosen layers below which it is left out
_PADDING_SPACING_M = 1000.0  # between the altitudes of padding layers
_PART_M, _PARTS_MAX = 300.0, 8  # thickness of the parts of an interval between levels, and their greatest number
_FAR_M = 1e5  # distance of the levels that hold the boundary values


class FittedWind(AbstractWind):
    """Layers of wind, and bounds of the difference between a wind field and the layers in blocks of the airspace.

    The bounds hold at every time of the flight.
    """

    layers: LayeredWind  #: Wind with which the planner computes.
    residuals: Float[Array, "north east altitude"]  #: Bound of |wind of the field - wind of the layers| per block, m/s.
    north_edges: Float[Array, " north_edges"]  #: Edges of the blocks, m north of the local map's origin, rising.
    east_edges: Float[Array, " east_edges"]  #: Edges of the blocks, m east of the local map's origin, rising.
    altitude_edges: Float[Array, " altitude_edges"]  #: Edges of the blocks, geometric altitude, m, rising.

    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Return the wind of the layers at the altitude of a position, NED, m/s; the time has no effect."""
        return self.layers.at(position_n, time)

    def residual_max(
        self, least_n: Float[Array, "cells 3"], greatest_n: Float[Array, "cells 3"]
    ) -> Float[Array, " cells"]:
        """Return an upper bound of |wind of the field - wind of the layers|, m/s, in boxes of the airspace.

        Row k of `least_n` and of `greatest_n` has two opposite corners of box k, NED, m. For a box that extends beyond
        the blocks, the bound is `BEYOND_FIELD_M_S`.
        """
        ranges = (
            (self.north_edges, least_n[:, 0], greatest_n[:, 0]),
            (self.east_edges, least_n[:, 1], greatest_n[:, 1]),
            (self.altitude_edges, -greatest_n[:, 2], -least_n[:, 2]),
        )
        north, east, altitude = (
            (high[:, None] >= edges[None, :-1]) & (low[:, None] <= edges[None, 1:]) for edges, low, high in ranges
        )
        residuals = jnp.max(jnp.where(altitude[:, None, None, :], self.residuals[None], 0.0), axis=3)
        residuals = jnp.max(jnp.where(east[:, None, :], residuals, 0.0), axis=2)
        residuals = jnp.max(jnp.where(north, residuals, 0.0), axis=1)
        for edges, low, high in ranges:
            residuals = jnp.where((low >= edges[0]) & (high <= edges[-1]), residuals, BEYOND_FIELD_M_S)
        return residuals


class FieldSamples(NamedTuple):
    """Wind field (one member of an ensemble) at its nodes in time, horizontal coordinates and levels."""

    times: Float[np.ndarray, " time"]  #: Times, s after the start of the flight, at least one.
    north: Float[np.ndarray, " north"]  #: Northward coordinates on the local map, m, or angles from its origin, rad.
    east: Float[np.ndarray, " east"]  #: Eastward coordinates, in the unit of `north`.
    #: Velocity of the air (NED, m/s) and altitude (m) of each level, lowest first.
    columns: Float[np.ndarray, "time north east level 4"]
    #: Radii (north, east; m) that convert angles to lengths on the map, radius * tan(angle); None for axes in m.
    radii_m: Float[np.ndarray, "2"] | None
    is_geopotential: bool  #: Whether the altitudes are geopotential.
    is_held: bool  #: Whether the values at the boundary of the field hold beyond the boundary, too.


class Way(NamedTuple):
    """Region of a flight: box around starts, goals and rendezvous, and the distance that paths can go beyond it."""

    least_m: Float[np.ndarray, "3"]  #: Least northward and eastward position and altitude, m.
    greatest_m: Float[np.ndarray, "3"]  #: Greatest northward and eastward position and altitude, m.
    reach_m: float  #: Greatest horizontal distance of any path from the box, m.
    end_s: float  #: End of the flight, s.


def wind_layers(wind: AbstractWind) -> AbstractWind:
    """Return the layers of a fitted wind; any other wind is returned as it is."""
    return wind.layers if isinstance(wind, FittedWind) else wind


def fit_layers(field: FieldSamples, way: Way) -> FittedWind:
    """Fit layers of wind to a wind field, and bound the difference of field and layers in blocks of the airspace.

    The layers lie at the mean altitudes of up to eight levels of the field. Their wind is the mean of the field over
    the time of the flight and the horizontal extent of `way`. The bounds hold wherever the flight can go within the
    field, to rounding.
    """
    times = np.unique(np.clip([0.0, *field.times, way.end_s], 0.0, way.end_s))
    edges_m, nodes, box = [], [], []
    for axis, coordinates in enumerate((field.north, field.east)):
        low, high = way.least_m[axis], way.greatest_m[axis]
        inner = np.linspace(low, high, _BLOCKS + 1)
        edges = np.concatenate([[low - way.reach_m], inner, [high + way.reach_m]])
        if not field.is_held:
            edges = np.clip(edges, *_to_length_m(field, axis, coordinates[[0, -1]]))
        at_edges = _to_coordinate(field, axis, edges)
        inside = coordinates[(coordinates > at_edges[0]) & (coordinates < at_edges[-1])]
        edges_m.append(edges)
        nodes.append(np.unique([*at_edges, *inside]))
        box.append(_to_coordinate(field, axis, inner))
    altitudes, velocities_n = _mean_layers(field, _columns_at(field, times, *box), way)
    columns = _divide_levels(_columns_at(field, times, *nodes))
    lowest, highest = _geometric(field, np.array([columns[..., 0, 3].max(), columns[..., -1, 3].min()]))
    inner = np.linspace(way.least_m[2], way.greatest_m[2], _BLOCKS + 1)
    edges_m.append(np.clip([lowest, *inner, highest], lowest, highest))
    residuals = np.zeros((_BLOCKS + 2,) * 3)
    blocks = [
        np.searchsorted(_to_coordinate(field, axis, edges_m[axis]), 0.5 * (nodes[axis][:-1] + nodes[axis][1:])) - 1
        for axis in (0, 1)
    ]
    for row, block in enumerate(blocks[0]):
        bounds, low, high = _cell_bounds(field, columns[:, row : row + 2], altitudes, velocities_n)
        for k, (bottom, top) in enumerate(pairwise(edges_m[2])):
            greatest = np.where((high >= bottom) & (low <= top), bounds, 0.0).max(axis=-1)
            np.maximum.at(residuals[block, :, k], blocks[1], greatest)
    return FittedWind(LayeredWind(as_array(altitudes), as_array(velocities_n)), *map(as_array, (residuals, *edges_m)))


def _to_coordinate(field: FieldSamples, axis: int, length_m: np.ndarray) -> np.ndarray:
    """Convert distances from the map's origin (m) to coordinates of the field: angles (rad), or equal if in m."""
    return length_m if field.radii_m is None else np.arctan(length_m / field.radii_m[axis])


def _to_length_m(field: FieldSamples, axis: int, coordinates: np.ndarray) -> np.ndarray:
    """Convert coordinates of a horizontal axis of the field to lengths on the map, m; angles are limited to 45 deg."""
    if field.radii_m is None:
        return coordinates
    return field.radii_m[axis] * np.tan(np.clip(coordinates, -0.25 * np.pi, 0.25 * np.pi))


def _geometric(field: FieldSamples, altitude: np.ndarray) -> np.ndarray:
    """Convert altitudes of a field (geometric or geopotential, m) to geometric altitude, m."""
    return geometric_altitude(altitude) if field.is_geopotential else altitude


def _field_altitude(field: FieldSamples, altitude: np.ndarray) -> np.ndarray:
    """Convert geometric altitudes, m, to altitudes of a field (geometric or geopotential, m)."""
    return geopotential_altitude(altitude) if field.is_geopotential else altitude


def _columns_at(field: FieldSamples, times: np.ndarray, north: np.ndarray, east: np.ndarray) -> np.ndarray:
    """Interpolate the columns of a field at times (s) and horizontal coordinates; shape (time, north, east, level, 4).

    Boundary values hold beyond the nodes. A field with `is_held` gets one more level far below and one far above.
    """
    columns = field.columns
    for axis, (nodes, at) in enumerate(((field.times, times), (field.north, north), (field.east, east))):
        if nodes.size == 1:
            columns = np.repeat(columns, at.size, axis)
            continue
        index = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, nodes.size - 2)
        share = np.clip((at - nodes[index]) / (nodes[index + 1] - nodes[index]), 0.0, 1.0)
        share = np.expand_dims(share, tuple(k for k in range(columns.ndim) if k != axis))
        columns = (1.0 - share) * np.take(columns, index, axis) + share * np.take(columns, index + 1, axis)
    if field.is_held:
        columns = np.concatenate([columns[..., :1, :], columns, columns[..., -1:, :]], axis=-2)
        columns[..., 0, 3] -= _FAR_M
        columns[..., -1, 3] += _FAR_M
    return columns


def _mean_layers(field: FieldSamples, columns: np.ndarray, way: Way) -> tuple[np.ndarray, np.ndarray]:
    """Return altitudes (geometric, m) and velocities (NED, m/s) of `_LAYERS` layers: the mean profile of `columns`.

    The layers lie at levels of the field. The lowest and the highest enclose the altitudes of `way`; between them, the
    level with the greatest error of linear interpolation is added, one by one. If fewer than `_LAYERS` levels are
    needed, layers with the wind of the highest layer follow above.
    """
    columns = columns.reshape(-1, *columns.shape[-2:])
    heights = _geometric(field, columns[..., 3])
    levels = heights.mean(axis=0)[int(field.is_held) : heights.shape[1] - int(field.is_held)]
    first = max(int(np.searchsorted(levels, way.least_m[2], side="right")) - 1, 0)
    last = max(min(int(np.searchsorted(levels, way.greatest_m[2])), levels.size - 1), first + 1)
    altitudes = levels[first : last + 1]
    at_altitudes = [
        [np.interp(altitudes, h, v) for h, v in zip(heights, columns[..., k], strict=True)] for k in range(3)
    ]
    profile_n = np.mean(at_altitudes, axis=1).T
    chosen = [0, altitudes.size - 1]
    while len(chosen) < min(_LAYERS, altitudes.size):
        lines = [np.interp(altitudes, altitudes[chosen], profile_n[chosen, k]) for k in range(3)]
        missed = np.linalg.norm(profile_n - np.transpose(lines), axis=1)
        if np.max(missed) < _MISSED_M_S:
            break
        chosen = sorted([*chosen, int(np.argmax(missed))])
    altitudes, velocities_n = altitudes[chosen], profile_n[chosen]
    padding = np.arange(1, _LAYERS + 1 - altitudes.size)
    altitudes = np.concatenate([altitudes, altitudes[-1] + _PADDING_SPACING_M * padding])
    return altitudes, np.concatenate([velocities_n, np.repeat(velocities_n[-1:], padding.size, axis=0)])


def _divide_levels(columns: np.ndarray) -> np.ndarray:
    """Insert levels between those of the field by linear interpolation, so that the bounds of the cells are tight.

    Every interval between levels gets the same number of parts, at most `_PARTS_MAX`. The number is chosen such that
    the parts of an interval of median thickness are at most `_PART_M` (m) thick.
    """
    parts = int(np.clip(np.ceil(np.median(np.diff(columns[..., 3], axis=-1)) / _PART_M), 1, _PARTS_MAX))
    steps = np.arange(parts)[:, None] / parts
    lower, upper = columns[..., :-1, None, :], columns[..., 1:, None, :]
    inner = (1.0 - steps) * lower + steps * upper
    return np.concatenate([inner.reshape(*columns.shape[:-2], -1, 4), columns[..., -1:, :]], axis=-2)


def _cell_bounds(
    field: FieldSamples, columns: np.ndarray, altitudes: np.ndarray, velocities_n: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bound |wind of the field - wind of the layers| in the cells between two northward nodes, at every time.

    `columns` is the field at both nodes; `altitudes` (geometric, m) and `velocities_n` (NED, m/s) are the layers.
    Returns the bounds (m/s) and the least and greatest geometric altitude (m) of each cell, (east, level).
    """

    def layer_winds(at: np.ndarray) -> np.ndarray:
        geometric = _geometric(field, at)
        return np.stack([np.interp(geometric, altitudes, velocities_n[:, k]) for k in range(3)], axis=-1)

    count_e, count_l = columns.shape[2] - 1, columns.shape[3] - 1
    corners = [columns[:, :, j : j + count_e, k : k + count_l] for j, k in product((0, 1), repeat=2)]
    vertices = np.stack(corners).reshape(-1, count_e, count_l, 4)
    heights = vertices[..., 3]
    low, high = heights.min(axis=0), heights.max(axis=0)
    thickness = high - low
    # between the least and the greatest altitude of a cell the layers are replaced by a straight line
    wind_low, wind_high = layer_winds(low), layer_winds(high)

    def straight(at: np.ndarray) -> np.ndarray:
        share = ((at - low) / thickness)[..., None]
        return wind_low + share * (wind_high - wind_low)

    bounds = np.linalg.norm(vertices[..., :3] - straight(heights), axis=-1).max(axis=0)
    deviations = np.zeros_like(bounds)
    for altitude, wind_n in zip(_field_altitude(field, altitudes), velocities_n, strict=True):
        deviation = np.linalg.norm(wind_n - straight(np.full_like(low, altitude)), axis=-1)
        deviations = np.maximum(deviations, np.where((altitude > low) & (altitude < high), deviation, 0.0))
    if field.is_geopotential:  # geometric altitude is not linear in geopotential altitude
        shears = np.linalg.norm(np.diff(velocities_n, axis=0), axis=1) / np.diff(altitudes)
        curvature = 2.0 * GEOPOTENTIAL_RADIUS_M**2 / (GEOPOTENTIAL_RADIUS_M - high) ** 3
        deviations = deviations + shears.max() * curvature * thickness**2 / 8.0
    return bounds + deviations, _geometric(field, low), _geometric(field, high)
