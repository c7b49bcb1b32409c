"""Choosing one candidate per aircraft so that all keep the separation.

Aircraft choose one after the other, each its cheapest candidate among those that keep clear of all that have chosen;
then those still in conflict choose again, against everybody's choice, until none is or the rounds are spent.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.planning.certified.broad_phase import BoundingCylinders, fleet_clearance_ratio, fleet_cylinders
from anser.planning.certified.candidates import Candidates
from anser.planning.certified.clearance import Track
from anser.planning.separation import Separation
from anser.shapes import Count, Scalar

_AT_A_TIME = 4  # candidates compared with the whole fleet at once, the cheapest first
_ROUNDS = 6
_INVALID_COST = 1e6
_CONFLICT_COST = 1e3
_Chosen = tuple[BoundingCylinders, Array]  # cylinders and index of the candidate of each aircraft


class Placement(eqx.Module):
    """One candidate for each aircraft.

    Attributes
    ----------
    chosen
        Index of its candidate.
    valid
        Whether that keeps the aircraft's own limits.
    """

    chosen: Int[Array, " aircraft"]
    valid: Bool[Array, " aircraft"]


def place(candidates: Candidates, separation: Separation, order: Int[Array, " aircraft"]) -> Placement:
    """Choose for each aircraft, in an order."""
    cost = candidates.cost + jnp.where(candidates.valid, 0.0, _INVALID_COST)
    cost = cost + jnp.where(candidates.penetration > 0.0, _CONFLICT_COST + candidates.penetration, 0.0)
    fleet, count = cost.shape
    chunks = -(-count // _AT_A_TIME)
    ranked = jnp.argsort(cost, axis=1)
    ranked = jnp.concatenate([ranked, jnp.repeat(ranked[:, -1:], chunks * _AT_A_TIME - count, axis=1)], axis=1)
    separated = (separation.horizontal > 0.0) & (fleet > 1)
    all_cylinders, everyone = fleet_cylinders(candidates.tracks, fleet), jnp.arange(fleet)

    def shortfall(
        who: Count, which: Int[Array, " k"], cylinders: BoundingCylinders, chosen: Array, others: Array
    ) -> Float[Array, " k"]:
        """What some candidates of one aircraft lack of the separation from others."""

        def tracks_of(some: Int[Array, " some"]) -> Track:
            return jax.tree.map(lambda leaf: leaf[some, chosen[some]], candidates.tracks)

        def one(k: Count) -> Scalar:
            own, held = jax.tree.map(lambda leaf: leaf[who, k], (candidates.tracks, all_cylinders))
            ratio = fleet_clearance_ratio(own, held, cylinders, tracks_of, others, separation)
            return jnp.sum(jnp.maximum(1.0 - ratio, 0.0))

        return jax.vmap(one)(which)

    def choose(who: Count, cylinders: BoundingCylinders, chosen: Array, others: Array) -> Count:
        """The candidate of least cost, conflicts with others included."""

        def compare(carry: tuple[Count, Count, Scalar]) -> tuple[Count, Count, Scalar]:
            chunk, best, least = carry
            which = jax.lax.dynamic_slice_in_dim(ranked[who], chunk * _AT_A_TIME, _AT_A_TIME)
            missing = shortfall(who, which, cylinders, chosen, others)
            total = cost[who, which] + jnp.where(missing > 0.0, _CONFLICT_COST * (1.0 + missing), 0.0)
            k = jnp.argmin(total)
            better = total[k] < least
            return chunk + 1, jnp.where(better, which[k], best), jnp.where(better, total[k], least)

        def may_improve(carry: tuple[Count, Count, Scalar]) -> Array:
            chunk, _, least = carry
            following = cost[who, ranked[who, jnp.minimum(chunk * _AT_A_TIME, ranked.shape[1] - 1)]]
            return (chunk < chunks) & (following < least)

        begin = (jnp.asarray(0), jnp.asarray(0, dtype=ranked.dtype), jnp.asarray(jnp.inf))
        return jax.lax.while_loop(may_improve, compare, begin)[1]

    def assign(who: Count, cylinders: BoundingCylinders, chosen: Array, others: Array) -> _Chosen:
        best = choose(who, cylinders, chosen, others & separated)
        cylinders = jax.tree.map(lambda all_, one: all_.at[who].set(one[who, best]), cylinders, all_cylinders)
        return cylinders, chosen.at[who].set(best)

    def first_choice(turn: Count, carry: tuple[_Chosen, Array]) -> tuple[_Chosen, Array]:
        (cylinders, chosen), placed = carry
        who = order[turn]
        return assign(who, cylinders, chosen, placed), placed.at[who].set(True)

    first = jax.tree.map(lambda leaf: jnp.zeros_like(leaf[:, 0]), all_cylinders)
    begin = ((first, jnp.zeros(fleet, dtype=ranked.dtype)), jnp.zeros(fleet, dtype=bool))
    (cylinders, chosen), _ = jax.lax.fori_loop(0, fleet, first_choice, begin)

    def shortfalls(cylinders: BoundingCylinders, chosen: Array) -> Float[Array, " aircraft"]:
        def own(who: Count) -> Scalar:
            return shortfall(who, chosen[who][None], cylinders, chosen, (everyone != who) & separated)[0]

        return jax.lax.map(own, everyone)

    def choose_again(
        carry: tuple[Count, BoundingCylinders, Array, Array],
    ) -> tuple[Count, BoundingCylinders, Array, Array]:
        turn, cylinders, chosen, missing = carry
        # Those in conflict, in the order of choosing and back; the others keep what they have.
        rank = jnp.where(turn % 2 == 0, -jnp.argsort(order), jnp.argsort(order))
        queue = jnp.argsort(jnp.where(missing > 0.0, rank, fleet))

        def one(k: Count, carry: _Chosen) -> _Chosen:
            return assign(queue[k], *carry, everyone != queue[k])

        cylinders, chosen = jax.lax.fori_loop(0, jnp.sum(missing > 0.0), one, (cylinders, chosen))
        return turn + 1, cylinders, chosen, shortfalls(cylinders, chosen)

    _, _, chosen, _ = jax.lax.while_loop(
        lambda c: (c[0] < _ROUNDS) & jnp.any(c[3] > 0.0),
        choose_again,
        (jnp.asarray(0), cylinders, chosen, shortfalls(cylinders, chosen)),
    )
    return Placement(chosen, candidates.valid[everyone, chosen])


def fewest_first(candidates: Candidates) -> Int[Array, " aircraft"]:
    """Order of choosing: those with the fewest valid candidates first."""
    return jnp.argsort(jnp.sum(candidates.valid & (candidates.penetration <= 0.0), axis=1))
