"""Clearance between moving aircraft, and between aircraft and keep-outs, between the instants looked at too.

Over a short interval a path stays within acceleration x interval^2 / 8 of the straight line between its ends. Two
straight motions have their least distance in closed form.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.planning.certified.task import KeepOuts
from anser.planning.separation import Separation, nearest_fraction, separation_ratio
from anser.shapes import Scalar

_TINY = 1e-9  # m^2


class Track(eqx.Module):
    """A path at equal intervals of time.

    Attributes
    ----------
    positions_n
        Over the ground, (instant, axis), NED, m.
    error_bound
        Of the distance between the path and its chord in each interval, m.
    counted
        1 in intervals that begin before the arrival, else 0.
    """

    positions_n: Float[Array, "*batch instants 3"]
    error_bound: Float[Array, "*batch intervals"]
    counted: Float[Array, "*batch intervals"]


def _nearest(begin: Float[Array, "*b 2"], end: Float[Array, "*b 2"]) -> Float[Array, "*b"]:
    """Least length of a vector that changes evenly between two."""
    step = end - begin
    near = begin + nearest_fraction(begin, step, _TINY)[..., None] * step
    return jnp.sqrt(jnp.maximum(jnp.sum(near * near, axis=-1), _TINY))


def _level_distance(begin: Float[Array, "*b"], end: Float[Array, "*b"]) -> Float[Array, "*b"]:
    """Least size of a number that changes evenly between two."""
    return jnp.where(begin * end <= 0.0, 0.0, jnp.minimum(jnp.abs(begin), jnp.abs(end)))


def pair_clearance_ratio(one: Track, other: Track, separation: Separation) -> Float[Array, "*batch"]:
    """Least ratio of distance to separation between two paths: 1 is just enough.

    In each interval the better of the two ratios of distance to separation, horizontal and vertical, counts; infinite
    where nothing is asked. Batches broadcast; the ranks must agree.
    """
    apart = other.positions_n - one.positions_n
    error_bound = one.error_bound + other.error_bound
    level = _nearest(apart[..., :-1, :2], apart[..., 1:, :2]) - error_bound
    height = _level_distance(apart[..., :-1, 2], apart[..., 1:, 2]) - error_bound
    ratio = separation_ratio(level, height, separation.horizontal, separation.vertical)
    return jnp.min(jnp.where(one.counted * other.counted > 0.0, ratio, jnp.inf), axis=-1)


def clearance_from_keep_outs(
    track: Track, times: Float[Array, " instants"], volumes: KeepOuts
) -> Float[Array, " volumes"]:
    """By how much one path stays out of each volume at the least, m: negative inside."""

    def one(volume: KeepOuts) -> Scalar:
        apart = track.positions_n[:, :2] - volume.position_n[None, :] - times[:, None] * volume.velocity_n[None, :]
        beside = _nearest(apart[:-1], apart[1:]) - track.error_bound - volume.radius
        up = -track.positions_n[:, 2]
        low, high = jnp.minimum(up[:-1], up[1:]) - track.error_bound, jnp.maximum(up[:-1], up[1:]) + track.error_bound
        clearance = jnp.maximum(jnp.maximum(beside, volume.bottom - high), low - volume.top)
        return jnp.min(jnp.where(track.counted > 0.0, clearance, jnp.inf))

    return jax.vmap(one)(volumes)


def chord_error_bound(acceleration: Float[Array, "*batch intervals"], step: Scalar) -> Float[Array, "*batch intervals"]:
    """Distance from the chord, m, by a bound of the acceleration in each interval (m/s^2) and its length (s)."""
    return acceleration * step**2 / 8
