"""Wind of a weather model on a grid in time, altitude and two horizontal axes, with linear interpolation."""

from itertools import product

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from anser.environment.air import geopotential_altitude
from anser.environment.environment import AbstractWind
from anser.numerics.tables import Axes
from anser.shapes import Flag, Scalar, ScalarLike, Vector3
from anser.spatial.wgs84 import angle_on_flat_map


class GriddedWind(AbstractWind):
    """Wind field on a grid, linear between the nodes; beyond the grid, the wind at the boundary.

    The altitude of a level may differ between nodes and times, for example on pressure levels. Altitudes are
    interpolated like velocities.

    Attributes
    ----------
    columns
        Velocity of the air (NED, m/s) and altitude (m) of each level, lowest first. The first axis holds the nodes in
        row-major order of ensemble member, time, northward and eastward coordinate.
    member
        Index of the ensemble member that is flown.
    axes
        Axes of the grid: times (s; absent if the field has one time), northward and eastward coordinates. The
        coordinates are in m on the chart, or in rad of latitude and longitude from the chart's origin.
    level_tops
        For each level except the first and the last, the greatest altitude over all nodes, m.
    altitude_min, altitude_max
        Least and greatest altitude at which every column has wind, m.
    radii
        Radii (m) for `angle_on_flat_map`, north and east, if the axes are in rad; None if the axes are in m.
    is_geopotential
        Whether the altitudes of the field are geopotential.
    interval_count
        Number of neighbouring intervals between levels to search for an altitude; more than 1 if one altitude lies in
        different intervals at different nodes.
    is_held
        True: beyond the grid a flight meets the wind at the boundary. False: `has_left_field` is True beyond the grid.
    """

    columns: Float[Array, "node level 4"]
    member: Int[Array, ""]
    axes: Axes
    level_tops: Float[Array, " inner"]
    altitude_min: Scalar
    altitude_max: Scalar
    radii: Float[Array, "2"] | None
    is_geopotential: bool = eqx.field(static=True)
    interval_count: int = eqx.field(static=True)
    is_held: bool = eqx.field(static=True)

    def at(self, position_n: Vector3, time: ScalarLike) -> Vector3:
        """Return the velocity of the air (3,), NED, m/s, at a chart position (3,), NED, m, and a time (s)."""
        index, fraction = self.axes.locate(self._coordinates(position_n, time))
        sizes = self.axes.sizes
        node = self.member
        for k, size in enumerate(sizes):
            node = node * size + index[k]
        strides = [int(np.prod(sizes[k + 1 :])) for k in range(len(sizes))]
        corners = np.array([sum(np.multiply(corner, strides)) for corner in product((0, 1), repeat=len(sizes))])
        altitude = self._altitude(position_n)
        lowest = jnp.sum(altitude >= self.level_tops, dtype=jnp.int32)
        lowest = jnp.clip(lowest, 0, self.columns.shape[1] - 1 - self.interval_count)
        levels = lowest + np.arange(self.interval_count + 1, dtype=np.int32)
        nodes = node + corners.astype(np.int32)
        profile = self.columns.at[nodes[:, None], levels[None, :]].get(mode="clip")  # the indices are within the grid
        for k in reversed(range(len(sizes))):
            profile = profile[0::2] + fraction[k] * (profile[1::2] - profile[0::2])
        profile = profile[0]
        lower, upper = profile[0], profile[1]
        for k in range(1, self.interval_count):
            is_above = altitude >= profile[k, 3]
            lower, upper = jnp.where(is_above, profile[k], lower), jnp.where(is_above, profile[k + 1], upper)
        share = jnp.clip((altitude - lower[3]) / (upper[3] - lower[3]), 0.0, 1.0)
        return lower[:3] + share * (upper[:3] - lower[:3])

    def is_outside(self, position_n: Vector3, time: ScalarLike) -> Flag:
        """Whether a chart position (NED, m) or a time (s) lies beyond the grid."""
        altitude = self._altitude(position_n)
        is_beyond = jnp.any(self.axes.outside(self._coordinates(position_n, time)))
        return is_beyond | (altitude < self.altitude_min) | (altitude > self.altitude_max)

    def _altitude(self, position_n: Vector3) -> Scalar:
        return geopotential_altitude(-position_n[2]) if self.is_geopotential else -position_n[2]

    def _coordinates(self, position_n: Vector3, time: ScalarLike) -> Float[Array, " axes"]:
        north, east = position_n[0], position_n[1]
        if self.radii is not None:
            north, east = angle_on_flat_map(north, self.radii[0]), angle_on_flat_map(east, self.radii[1])
        horizontal = jnp.stack([north, east])
        if len(self.axes.sizes) == 2:
            return horizontal
        return jnp.concatenate([jnp.asarray(time, horizontal.dtype)[None], horizontal])


def has_left_field(wind: AbstractWind, position_n: Vector3, time: ScalarLike) -> Flag:
    """Whether a chart position (NED, m) or a time (s) lies beyond the grid of a `GriddedWind` without `is_held`.

    For every other wind the result is False.
    """
    if isinstance(wind, GriddedWind) and not wind.is_held:
        return wind.is_outside(position_n, time)
    return jnp.zeros((), bool)
