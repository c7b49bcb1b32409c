"""Choosing one candidate per aircraft so that none is in another's way.

Aircraft choose one after the other, each the candidate it likes best among those that keep clear of all that have
chosen; then those still in conflict choose again, against everybody's choice, until none is or the rounds are spent.
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.planning.certified.candidates import Candidate, candidates
from anser.planning.certified.choices import Choices
from anser.planning.certified.conflicts import Track, keep_out_room
from anser.planning.certified.crowd import Blocks, crowd_blocks, fleet_use
from anser.planning.certified.motions import Motions, find_motions
from anser.planning.certified.profile import Timetable
from anser.planning.certified.request import Airspace, KeepOuts, Traveller
from anser.planning.certified.tracking import make_schedule, path_track, track
from anser.planning.separation import Separation
from anser.shapes import Count, Flag, Scalar

_AT_A_TIME = 4  # candidates compared with the whole fleet at once, the best liked first
_ROUNDS = 6
_INVALID = 1e6
_NOTHING = 1e9
_CONFLICT = 1e3
_MOVED = 6.0  # cost of a motion that nobody would expect


class Options(eqx.Module):
    """What a fleet can choose from: (aircraft, candidate), free motions after the others.

    Attributes
    ----------
    candidates
        Those with a shape and a profile.
    tables
        Of the profiles, (aircraft, profile).
    motions
        Free motions; None where none were looked for.
    valid, cost, tracks
        Of all.
    closed
        How far each goes into a closed volume, m.
    """

    candidates: Candidate
    tables: Timetable
    motions: Motions | None
    valid: Bool[Array, "aircraft candidates"]
    cost: Float[Array, "aircraft candidates"]
    tracks: Track
    closed: Float[Array, "aircraft candidates"]


class Placed(eqx.Module):
    """One candidate for each aircraft.

    Attributes
    ----------
    chosen
        Index of its candidate.
    valid
        Whether that keeps the aircraft's own limits.
    conflict
        How much of the separation it lacks, summed over the others, and of the distance from closed volumes.
    """

    chosen: Int[Array, " aircraft"]
    valid: Bool[Array, " aircraft"]
    conflict: Float[Array, " aircraft"]


def make_options(
    travellers: Traveller,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    ticks: int,
    instants: int,
    choices: Choices,
    sought: Bool[Array, " aircraft"] | None = None,
) -> Options:
    """All candidates of a fleet, with their tracks on one grid of instants up to the last arrival.

    Parameters
    ----------
    travellers, airspace, durations
        The task: stacked, s.
    ticks, instants
        Even intervals of the paths and of the grid.
    choices
        What to look at.
    sought
        Aircraft for which `choices.beyond` is looked at too; None: all that are active.
    """
    step = jnp.max(durations) / instants
    times = step * jnp.arange(instants + 1)

    def one(choices: Choices, traveller: Traveller, duration: Scalar) -> Options:
        found, tables = candidates(traveller, airspace, duration, ticks, choices)
        schedules = jax.vmap(lambda table: make_schedule(table, times))(tables)

        def flown(candidate: Candidate) -> tuple[Track, Flag]:
            table, schedule = jax.tree.map(lambda leaf: leaf[candidate.which], (tables, schedules))
            return track(candidate, table, schedule, times, traveller.limits, airspace.gravity, traveller.active)

        tracks, kept = jax.vmap(flown)(found)
        valid, cost, motions = found.valid & kept, found.cost, None
        if choices.motions:
            motions = find_motions(traveller, airspace, duration, ticks, choices.motions, choices.motions_kept)
            # A path that ends before the last one has shorter intervals than the grid.
            own = jax.vmap(lambda path, a: path_track(path, a, traveller.active, times))(
                motions.paths, motions.accelerations
            )
            tracks = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), tracks, own)
            valid = jnp.concatenate([valid, motions.valid])
            cost = jnp.concatenate([cost, jnp.where(motions.valid, _MOVED + motions.turned, _INVALID)])
        return Options(found, tables, motions, valid, cost, tracks, _closed(tracks, times, airspace.keep_outs))

    options = jax.vmap(functools.partial(one, choices))(travellers, durations)
    if choices.beyond is None:
        return options
    wanted = travellers.active > 0.0 if sought is None else sought
    return _joined(
        options, _each_sought(jax.jit(functools.partial(one, choices.beyond)), travellers, durations, wanted)
    )


def _each_sought(
    one: Callable[[Traveller, Scalar], Options],
    travellers: Traveller,
    durations: Float[Array, " aircraft"],
    sought: Bool[Array, " aircraft"],
) -> Options:
    """Options of some aircraft, one after the other, so that the others cost nothing; they have none."""
    first = jax.tree.map(lambda leaf: leaf[0], (travellers, durations))
    fleet = sought.shape[0]
    empty = jax.tree.map(lambda leaf: jnp.zeros((fleet, *leaf.shape), leaf.dtype), jax.eval_shape(one, *first))
    # What was not looked for is no path: it is not chosen even where nothing is valid.
    empty = eqx.tree_at(lambda o: o.cost, empty, jnp.full_like(empty.cost, _NOTHING))
    queue = jnp.argsort(~sought, stable=True)

    def add(k: Count, options: Options) -> Options:
        own = one(*jax.tree.map(lambda leaf: leaf[queue[k]], (travellers, durations)))
        return jax.tree.map(lambda all_, leaf: all_.at[queue[k]].set(leaf), options, own)

    return jax.lax.fori_loop(0, jnp.sum(sought), add, empty)


def _joined(options: Options, beyond: Options) -> Options:
    """Two sets of candidates of each aircraft as one, free motions of the second last."""
    assert options.motions is None
    profiles = options.tables.length.shape[1]
    later = eqx.tree_at(lambda o: o.candidates.which, beyond, beyond.candidates.which + profiles)
    alike = eqx.tree_at(lambda o: o.motions, later, None)
    both = jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=1), options, alike)
    return eqx.tree_at(lambda o: o.motions, both, beyond.motions, is_leaf=lambda leaf: leaf is None)


def _closed(tracks: Track, times: Float[Array, " instants"], volumes: KeepOuts) -> Float[Array, " candidates"]:
    if volumes.radius.shape[0] == 0:
        return jnp.zeros(tracks.positions_n.shape[0])
    room = jax.vmap(lambda one: keep_out_room(one, times, volumes))(tracks)
    return jnp.sum(jnp.maximum(-room, 0.0), axis=-1)


def place(options: Options, separation: Separation, order: Int[Array, " aircraft"]) -> Placed:
    """Choose for each aircraft, in an order."""
    cost = options.cost + jnp.where(options.valid, 0.0, _INVALID)
    cost = cost + jnp.where(options.closed > 0.0, _CONFLICT + options.closed, 0.0)
    fleet, count = cost.shape
    chunks = -(-count // _AT_A_TIME)
    liked = jnp.argsort(cost, axis=1)
    liked = jnp.concatenate([liked, jnp.repeat(liked[:, -1:], chunks * _AT_A_TIME - count, axis=1)], axis=1)
    apart_matters = (separation.horizontal > 0.0) & (fleet > 1)

    every, everyone = crowd_blocks(options.tracks, fleet), jnp.arange(fleet)

    def lacking(
        who: Count, which: Int[Array, " k"], blocks: Blocks, chosen: Array, others: Bool[Array, " aircraft"]
    ) -> Float[Array, " k"]:
        """What some candidates of one aircraft lack of the separation from others."""

        def tracks_of(some: Int[Array, " some"]) -> Track:
            return jax.tree.map(lambda leaf: leaf[some, chosen[some]], options.tracks)

        def one(k: Count) -> Scalar:
            own, held = jax.tree.map(lambda leaf: leaf[who, k], (options.tracks, every))
            use = fleet_use(own, held, blocks, tracks_of, others, separation)
            return jnp.sum(jnp.maximum(1.0 - use, 0.0))

        return jax.vmap(one)(which)

    def choose(
        who: Count, blocks: Blocks, chosen: Array, others: Bool[Array, " aircraft"]
    ) -> tuple[Count, Scalar, Scalar]:
        def look(carry: tuple[Count, Count, Scalar, Scalar]) -> tuple[Count, Count, Scalar, Scalar]:
            chunk, best, least, lack = carry
            which = jax.lax.dynamic_slice_in_dim(liked[who], chunk * _AT_A_TIME, _AT_A_TIME)
            missing = lacking(who, which, blocks, chosen, others)
            total = cost[who, which] + jnp.where(missing > 0.0, _CONFLICT * (1.0 + missing), 0.0)
            k = jnp.argmin(total)
            better = total[k] < least
            return (
                chunk + 1,
                jnp.where(better, which[k], best),
                jnp.where(better, total[k], least),
                jnp.where(better, missing[k], lack),
            )

        def going(carry: tuple[Count, Count, Scalar, Scalar]) -> Array:
            chunk, _, least, _ = carry
            following = cost[who, liked[who, jnp.minimum(chunk * _AT_A_TIME, liked.shape[1] - 1)]]
            return (chunk < chunks) & (following < least)

        zero = jnp.asarray(0, dtype=liked.dtype)
        begin = (jnp.asarray(0), zero, jnp.asarray(jnp.inf), jnp.asarray(0.0))
        _, best, _, lack = jax.lax.while_loop(going, look, begin)
        return best, lack, cost[who, best]

    def put(blocks: Blocks, who: Count, which: Count) -> Blocks:
        return jax.tree.map(lambda all_, one: all_.at[who].set(one[who, which]), blocks, every)

    def settle(turn: Count, carry: tuple[Blocks, Array, Array]) -> tuple[Blocks, Array, Array]:
        blocks, chosen, placed = carry
        who = order[turn]
        best, _, _ = choose(who, blocks, chosen, placed & apart_matters)
        return put(blocks, who, best), chosen.at[who].set(best), placed.at[who].set(True)

    first = jax.tree.map(lambda leaf: jnp.zeros_like(leaf[:, 0]), every)
    begin = (first, jnp.zeros(fleet, dtype=liked.dtype), jnp.zeros(fleet, dtype=bool))
    blocks, chosen, _ = jax.lax.fori_loop(0, fleet, settle, begin)

    def all_lack(blocks: Blocks, chosen: Array) -> Float[Array, " aircraft"]:
        return jax.lax.map(
            lambda who: lacking(who, chosen[who][None], blocks, chosen, (everyone != who) & apart_matters)[0], everyone
        )

    def again(carry: tuple[Count, Blocks, Array, Array]) -> tuple[Count, Blocks, Array, Array]:
        turn, blocks, chosen, lacks = carry
        # Those in conflict, in the order of choosing and back; the others keep what they have.
        rank = jnp.where(turn % 2 == 0, -jnp.argsort(order), jnp.argsort(order))
        queue = jnp.argsort(jnp.where(lacks > 0.0, rank, fleet))

        def one(k: Count, carry: tuple[Blocks, Array]) -> tuple[Blocks, Array]:
            blocks, chosen = carry
            who = queue[k]
            best, _, _ = choose(who, blocks, chosen, (everyone != who) & apart_matters)
            return put(blocks, who, best), chosen.at[who].set(best)

        blocks, chosen = jax.lax.fori_loop(0, jnp.sum(lacks > 0.0), one, (blocks, chosen))
        return turn + 1, blocks, chosen, all_lack(blocks, chosen)

    _, blocks, chosen, lacks = jax.lax.while_loop(
        lambda c: (c[0] < _ROUNDS) & jnp.any(c[3] > 0.0),
        again,
        (jnp.asarray(0), blocks, chosen, all_lack(blocks, chosen)),
    )
    return Placed(chosen, options.valid[everyone, chosen], lacks + options.closed[everyone, chosen])


def chosen_of(options: Options, placed: Placed) -> tuple[Candidate, Timetable]:
    """The candidates chosen, and their timetables, stacked by aircraft; any where a free motion is."""
    fleet = jnp.arange(placed.chosen.shape[0])
    chosen = jnp.minimum(placed.chosen, options.candidates.valid.shape[1] - 1)
    candidate = jax.tree.map(lambda leaf: leaf[fleet, chosen], options.candidates)
    return candidate, jax.tree.map(lambda leaf: leaf[fleet, candidate.which], options.tables)


def chosen_motions(motions: Motions, which: Int[Array, " aircraft"]) -> Motions:
    """One free motion for each aircraft; any for a negative index."""
    fleet = jnp.arange(which.shape[0])
    return jax.tree.map(lambda leaf: leaf[fleet, jnp.maximum(which, 0)], motions)


def fewest_first(options: Options) -> Int[Array, " aircraft"]:
    """Order of choosing: those with the fewest valid candidates first."""
    return jnp.argsort(jnp.sum(options.valid & (options.closed <= 0.0), axis=1))
