"""Broad phase of the clearance in a large fleet: bounding cylinders first, the paths themselves for the nearest only.

Several intervals of a path stay within an upright cylinder. For two paths these give a lower bound of the clearance
ratio, with a thousandth of the work of the exact one, and that is enough for nearly all pairs.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.planning.certified.clearance import Track, pair_clearance_ratio
from anser.planning.separation import Separation, separation_ratio

INTERVALS_PER_CYLINDER = 4
"""Every number of intervals in use is a multiple of it."""
EXACT_PAIRS = 24
"""Pairs of an aircraft whose clearance is exact; those of a smaller fleet all are."""
_TINY = 1e-9  # m^2: keeps the derivatives of the roots finite; each radius grows by as much as a distance may


class BoundingCylinders(eqx.Module):
    """Upright cylinders that hold a path, one for several intervals each.

    Attributes
    ----------
    centre
        Of the axis, north and east, m.
    radius
        m.
    low, high
        Least and greatest down coordinate, m.
    counted
        1 where any of the intervals counts, else 0.
    """

    centre: Float[Array, "*batch cylinders 2"]
    radius: Float[Array, "*batch cylinders"]
    low: Float[Array, "*batch cylinders"]
    high: Float[Array, "*batch cylinders"]
    counted: Float[Array, "*batch cylinders"]


def bounding_cylinders(track: Track, size: int = INTERVALS_PER_CYLINDER) -> BoundingCylinders:
    """Cylinders of a track, or of a batch of them, of `size` intervals each."""
    batch, count = track.error_bound.shape[:-1], track.error_bound.shape[-1]
    if count % size:
        raise ValueError(f"track: arrived {count} intervals; expected a multiple of {size}")
    places = track.positions_n
    parts = (*batch, count // size, size)
    both = jnp.concatenate([places[..., :-1, :].reshape(*parts, 3), places[..., 1:, :].reshape(*parts, 3)], axis=-2)
    error_bound = jnp.max(track.error_bound.reshape(parts), axis=-1)
    least, most = jnp.min(both, axis=-2), jnp.max(both, axis=-2)
    centre = 0.5 * (least + most)[..., :2]
    off = both[..., :2] - centre[..., None, :]
    radius = jnp.sqrt(jnp.maximum(jnp.max(jnp.sum(off * off, axis=-1), axis=-1), _TINY)) + error_bound
    counted = jnp.max(track.counted.reshape(parts), axis=-1)
    return BoundingCylinders(centre, radius, least[..., 2] - error_bound, most[..., 2] + error_bound, counted)


def fleet_cylinders(tracks: Track, fleet: int, size: int = INTERVALS_PER_CYLINDER) -> BoundingCylinders:
    """Cylinders for `fleet_clearance_ratio` of a fleet of so many; a small one, all of it exact, needs none."""
    if fleet > EXACT_PAIRS:
        return bounding_cylinders(tracks, size)
    none = jnp.zeros((*tracks.error_bound.shape[:-1], 0))
    return BoundingCylinders(jnp.zeros((*none.shape, 2)), none, none, none, none)


def cylinder_clearance_ratio(
    one: BoundingCylinders, other: BoundingCylinders, separation: Separation
) -> Float[Array, "*batch"]:
    """A lower bound of `clearance.pair_clearance_ratio`; infinite where nothing is asked."""
    apart = other.centre - one.centre
    radius = one.radius + other.radius
    level = jnp.sqrt(jnp.maximum(jnp.sum(apart * apart, axis=-1), _TINY)) - radius
    height = jnp.maximum(other.low - one.high, one.low - other.high)
    # Where cylinders overlap, the distance may be anything.
    ratio = jnp.maximum(separation_ratio(level, height, separation.horizontal, separation.vertical), 0.0)
    return jnp.min(jnp.where(one.counted * other.counted > 0.0, ratio, jnp.inf), axis=-1)


def fleet_clearance_ratio(
    one: Track,
    cylinders: BoundingCylinders,
    fleet: BoundingCylinders,
    tracks_of: Callable[[Int[Array, " some"]], Track],
    others: Bool[Array, " aircraft"],
    separation: Separation,
) -> Float[Array, " aircraft"]:
    """Clearance ratio between one path and each of a fleet, see `clearance.pair_clearance_ratio`, or a lower bound.

    Parameters
    ----------
    one, cylinders
        A path, and its cylinders.
    fleet
        Bounding cylinders of the fleet's paths, stacked.
    tracks_of
        Stacked paths of some of the fleet, by their indices.
    others
        Which of the fleet count; infinite for those that do not.
    separation
        What is asked.

    Returns
    -------
    Exact for the `EXACT_PAIRS` whose cylinders are nearest, for the others the bound of the cylinders.
    """
    count = others.shape[0]

    def exact(some: Int[Array, " some"]) -> Float[Array, " some"]:
        return pair_clearance_ratio(jax.tree.map(lambda leaf: leaf[None], one), tracks_of(some), separation)

    if count <= EXACT_PAIRS:
        return jnp.where(others, exact(jnp.arange(count)), jnp.inf)
    bound = cylinder_clearance_ratio(jax.tree.map(lambda leaf: leaf[None], cylinders), fleet, separation)
    bound = jnp.where(others, bound, jnp.inf)
    near = jax.lax.top_k(-bound, EXACT_PAIRS)[1]
    return bound.at[near].set(jnp.where(others[near], jnp.maximum(exact(near), bound[near]), jnp.inf))
