"""Distances within a large fleet: blocks of many intervals first, the intervals themselves for the nearest only.

What is within a block of a path stays within a circle and between two heights. For two paths these give a bound of how
much of their room is left, a thousandth of the work of looking closely, and that is enough for nearly all pairs.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.planning.certified.conflicts import Track, pair_use
from anser.planning.separation import Separation, separation_ratio

BLOCK = 4
"""Intervals of a block; every number of intervals in use is a multiple of it."""
NEAREST = 24
"""So many of a fleet are looked at closely; a smaller fleet is, all of it."""
_TINY = 1e-9  # m^2: keeps the derivatives of the roots finite; each reach grows by as much as a distance may


class Blocks(eqx.Module):
    """What holds a path, block by block.

    Attributes
    ----------
    centre
        Of the circle, north and east, m.
    reach
        Its radius, m.
    low, high
        Least and greatest down coordinate, m.
    counted
        1 where any of the block's intervals counts, else 0.
    """

    centre: Float[Array, "*batch blocks 2"]
    reach: Float[Array, "*batch blocks"]
    low: Float[Array, "*batch blocks"]
    high: Float[Array, "*batch blocks"]
    counted: Float[Array, "*batch blocks"]


def blocks_of(track: Track, size: int = BLOCK) -> Blocks:
    """Blocks of a track, or of a batch of them, of `size` intervals each."""
    batch, count = track.slack.shape[:-1], track.slack.shape[-1]
    if count % size:
        raise ValueError(f"track: arrived {count} intervals; expected a multiple of {size}")
    places = track.positions_n
    parts = (*batch, count // size, size)
    both = jnp.concatenate([places[..., :-1, :].reshape(*parts, 3), places[..., 1:, :].reshape(*parts, 3)], axis=-2)
    slack = jnp.max(track.slack.reshape(parts), axis=-1)
    least, most = jnp.min(both, axis=-2), jnp.max(both, axis=-2)
    centre = 0.5 * (least + most)[..., :2]
    off = both[..., :2] - centre[..., None, :]
    reach = jnp.sqrt(jnp.maximum(jnp.max(jnp.sum(off * off, axis=-1), axis=-1), _TINY)) + slack
    counted = jnp.max(track.counted.reshape(parts), axis=-1)
    return Blocks(centre, reach, least[..., 2] - slack, most[..., 2] + slack, counted)


def crowd_blocks(tracks: Track, fleet: int, size: int = BLOCK) -> Blocks:
    """Blocks for `fleet_use`, of a fleet of so many: one that is looked at closely as a whole needs none."""
    if fleet > NEAREST:
        return blocks_of(tracks, size)
    none = jnp.zeros((*tracks.slack.shape[:-1], 0))
    return Blocks(jnp.zeros((*none.shape, 2)), none, none, none, none)


def block_use(one: Blocks, other: Blocks, separation: Separation) -> Float[Array, "*batch"]:
    """A lower bound of `anser.planning.certified.conflicts.pair_use`; infinite where nothing is asked."""
    apart = other.centre - one.centre
    reach = one.reach + other.reach
    level = jnp.sqrt(jnp.maximum(jnp.sum(apart * apart, axis=-1), _TINY)) - reach
    height = jnp.maximum(other.low - one.high, one.low - other.high)
    # Inside each other's blocks it may be anything: nothing is left of the room then.
    room = jnp.maximum(separation_ratio(level, height, separation.horizontal, separation.vertical), 0.0)
    return jnp.min(jnp.where(one.counted * other.counted > 0.0, room, jnp.inf), axis=-1)


def fleet_use(
    one: Track,
    blocks: Blocks,
    fleet: Blocks,
    tracks_of: Callable[[Int[Array, " some"]], Track],
    others: Bool[Array, " aircraft"],
    separation: Separation,
) -> Float[Array, " aircraft"]:
    """How much of its room one path leaves with each of a fleet: see `anser.planning.certified.conflicts.pair_use`.

    Parameters
    ----------
    one, blocks
        A path, and its blocks.
    fleet
        Blocks of the fleet's paths, stacked.
    tracks_of
        Stacked paths of some of the fleet, by their indices.
    others
        Which of the fleet count; infinite for those that do not.
    separation
        The room.

    Returns
    -------
    Closely for the `NEAREST` whose blocks are nearest, for the others the bound of the blocks: it is never too much.
    """
    count = others.shape[0]

    def closely(some: Int[Array, " some"]) -> Float[Array, " some"]:
        return pair_use(jax.tree.map(lambda leaf: leaf[None], one), tracks_of(some), separation)

    if count <= NEAREST:
        return jnp.where(others, closely(jnp.arange(count)), jnp.inf)
    bound = block_use(jax.tree.map(lambda leaf: leaf[None], blocks), fleet, separation)
    bound = jnp.where(others, bound, jnp.inf)
    near = jax.lax.top_k(-bound, NEAREST)[1]
    return bound.at[near].set(jnp.where(others[near], jnp.maximum(closely(near), bound[near]), jnp.inf))
