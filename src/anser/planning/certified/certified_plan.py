"""Certified plans: one candidate chosen for each aircraft so that all keep the separation.

And bounds that prove what the plan keeps. Aircraft choose one after the other, each its cheapest candidate among
those that keep clear of all that have chosen; then aircraft still in conflict choose again, until there is no
conflict or the rounds are used up.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.compiling.options import compiled_by_older_generator
from anser.numerics.arrays import first_rows, namespace, select_rows, zeros_like_result
from anser.planning.certified.candidates import SPLINE, Candidates, fleet_candidates
from anser.planning.certified.clearance import (
    INTERVALS_PER_CYLINDER,
    BoundingCylinders,
    Track,
    clearance_from_keep_outs,
    fleet_clearance_ratio,
    fleet_cylinders,
    path_track,
)
from anser.planning.certified.path_bounds import PathBounds, excess, path_bounds
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.timed_profiles import CandidateSet
from anser.planning.limits import PathLimits
from anser.planning.separation import Separation
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike

_CHUNK_SIZE = 4  # candidates compared with the whole fleet at once, the cheapest first
_ROUNDS = 6
_INVALID_COST = 1e6
_CONFLICT_COST = 1e3
_Choice = tuple[BoundingCylinders, Array]  # cylinders and index of the candidate of each aircraft


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


def place_candidates(candidates: Candidates, separation: Separation, order: Int[Array, " aircraft"]) -> Placement:
    """Choose for each aircraft, in an order."""
    cost = candidates.cost + jnp.where(candidates.valid, 0.0, _INVALID_COST)
    cost = cost + jnp.where(candidates.penetration > 0.0, _CONFLICT_COST + candidates.penetration, 0.0)
    fleet, count = cost.shape
    chunks = -(-count // _CHUNK_SIZE)
    ranked = jnp.argsort(cost, axis=1)
    ranked = jnp.concatenate([ranked, jnp.repeat(ranked[:, -1:], chunks * _CHUNK_SIZE - count, axis=1)], axis=1)
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
            which = jax.lax.dynamic_slice_in_dim(ranked[who], chunk * _CHUNK_SIZE, _CHUNK_SIZE)
            missing = shortfall(who, which, cylinders, chosen, others)
            total = cost[who, which] + jnp.where(missing > 0.0, _CONFLICT_COST * (1.0 + missing), 0.0)
            k = jnp.argmin(total)
            better = total[k] < least
            return chunk + 1, jnp.where(better, which[k], best), jnp.where(better, total[k], least)

        def may_improve(carry: tuple[Count, Count, Scalar]) -> Array:
            chunk, _, least = carry
            following = cost[who, ranked[who, jnp.minimum(chunk * _CHUNK_SIZE, ranked.shape[1] - 1)]]
            return (chunk < chunks) & (following < least)

        begin = (jnp.asarray(0), jnp.asarray(0, dtype=ranked.dtype), jnp.asarray(jnp.inf))
        return jax.lax.while_loop(may_improve, compare, begin)[1]

    def assign(who: Count, cylinders: BoundingCylinders, chosen: Array, others: Array) -> _Choice:
        best = choose(who, cylinders, chosen, others & separated)
        cylinders = jax.tree.map(lambda all_, one: all_.at[who].set(one[who, best]), cylinders, all_cylinders)
        return cylinders, chosen.at[who].set(best)

    def first_choice(turn: Count, carry: tuple[_Choice, Array]) -> tuple[_Choice, Array]:
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

        def one(k: Count, carry: _Choice) -> _Choice:
            return assign(queue[k], *carry, everyone != queue[k])

        cylinders, chosen = jax.lax.fori_loop(0, jnp.sum(missing > 0.0), one, (cylinders, chosen))
        return turn + 1, cylinders, chosen, shortfalls(cylinders, chosen)

    _, _, chosen, _ = jax.lax.while_loop(
        lambda c: (c[0] < _ROUNDS) & jnp.any(c[3] > 0.0),
        choose_again,
        (jnp.asarray(0), cylinders, chosen, shortfalls(cylinders, chosen)),
    )
    return Placement(chosen, candidates.valid[everyone, chosen])


def choice_order(candidates: Candidates) -> Int[Array, " aircraft"]:
    """Order of choosing: those with the fewest valid candidates first."""
    return jnp.argsort(jnp.sum(candidates.valid & (candidates.penetration <= 0.0), axis=1))


TIMES_PER_INTERVAL = 4
"""Intervals of the certificate's distances for each interval between a path's even knots."""


class Certificate(eqx.Module):
    """What a fleet's paths certainly keep, between the instants looked at too.

    Attributes
    ----------
    bounds
        Of each path.
    excess
        By how much each passes each limit, as a part of it, in the order of `CERTIFIED_LIMITS`; positive: broken.
    clearance_ratio
        Of each pair, the least ratio of distance to separation, or less; 1 is enough. Infinite for an aircraft and
        itself. In a large fleet it is exact for the nearest only, see `anser.planning.certified.clearance`.
    keep_out_clearance
        How far each stays out of each keep-out at least, m.
    """

    bounds: PathBounds
    excess: Float[Array, "aircraft limits"]
    clearance_ratio: Float[Array, "aircraft aircraft"]
    keep_out_clearance: Float[Array, "aircraft volumes"]

    @property
    def satisfied_individually(self) -> Bool[Array, " aircraft"]:
        """Whether each aircraft keeps everything but its distance from others."""
        xp = namespace(self)
        excess, clearance = xp.asarray(self.excess), xp.asarray(self.keep_out_clearance)
        return xp.all(excess <= _ROUNDING, axis=1) & xp.all(clearance >= -_ROUNDING_M, axis=1)

    @property
    def satisfied(self) -> Bool[Array, " aircraft"]:
        """Whether each aircraft keeps everything."""
        xp = namespace(self)
        return self.satisfied_individually & xp.all(xp.asarray(self.clearance_ratio) >= 1.0 - _ROUNDING, axis=1)


_ROUNDING = 1e-7  # as a part of a limit: a path that starts at it is not refused for rounding
_ROUNDING_M = 1e-3


class CertifiedPlan(eqx.Module):
    """Paths of a fleet; leading axis aircraft.

    Whether a path is good is said in steps: `valid`, one was found within its aircraft's own limits; then, of what was
    found, `certificate.satisfied_individually`, limits and keep-outs are kept between all knots too;
    `certificate.kept`, and the separation from the others; `feasible`, all of this together.

    Attributes
    ----------
    paths
        Where each is when.
    arrival_times
        When each is at its rendezvous, s.
    certificate
        What they keep.
    valid
        Whether a path was found for each within its own limits, as far as its samples tell.
    lengths
        Of the paths through the air, in space, from the plan's last renewal on, m.
    turned
        Sum of the sizes of all turns of each, as planned, rad.
    speeds
        Mean airspeeds, m/s.
    """

    paths: TimedPath
    arrival_times: Float[Array, " aircraft"]
    certificate: Certificate
    valid: Bool[Array, " aircraft"]
    lengths: Float[Array, " aircraft"]
    total_turn: Float[Array, " aircraft"]
    speeds: Float[Array, " aircraft"]

    def leading(self, count: int) -> "CertifiedPlan":
        """Of the first aircraft only; concrete."""
        first = first_rows(self, count)
        return eqx.tree_at(lambda p: p.certificate.clearance_ratio, first, first.certificate.clearance_ratio[:, :count])

    @property
    def feasible(self) -> Bool[Array, " aircraft"]:
        """Whether each aircraft's path is there and keeps everything."""
        return namespace(self).asarray(self.valid) & self.certificate.satisfied


class FixedPaths(eqx.Module):
    """Paths that stand as they are while the rest of a fleet is planned around them; leading axis aircraft.

    Attributes
    ----------
    which
        Whose paths stand.
    paths
        Where they are when; of the others they mean nothing.
    arrival_times
        When they are at their rendezvous, s.
    """

    selected: Bool[Array, " aircraft"]
    paths: TimedPath
    arrival_times: Float[Array, " aircraft"]


def fleet_bounds(paths: TimedPath, airspace: Airspace) -> PathBounds:
    """Bounds of stacked paths."""
    return jax.vmap(path_bounds, in_axes=(0, None, None))(paths, airspace.wind, airspace.gravity)


def within_limits(bounds: PathBounds, limits: PathLimits) -> Bool[Array, " aircraft"]:
    """Whether each of stacked bounds keeps its aircraft's limits."""
    return jnp.all(jax.vmap(excess)(bounds, limits) <= _ROUNDING, axis=1)


def certify(
    paths: TimedPath,
    tasks: AircraftTask,
    airspace: Airspace,
    intervals: int,
    from_time: ScalarLike = -jnp.inf,
    bounds: PathBounds | None = None,
) -> Certificate:
    """What stacked paths keep; `intervals` even intervals lie between the knots of each.

    Limits are looked at over whole paths, distances from a time (s) on. `bounds` of the paths, where they are known.
    """
    bounds = fleet_bounds(paths, airspace) if bounds is None else bounds
    over = jax.vmap(excess)(bounds, tasks.limits)
    # A path that is none, which its own bounds tell, must not hide the others.
    starts, ends = paths.times[:, 0], paths.times[:, -1]
    start = jnp.min(jnp.where(jnp.isfinite(starts), starts, jnp.inf))
    end = jnp.max(jnp.where(jnp.isfinite(ends), ends, -jnp.inf))
    times = start + (end - start) * jnp.linspace(0.0, 1.0, TIMES_PER_INTERVAL * intervals + 1)

    def tracked(path: TimedPath, accelerations: Array, active: Scalar) -> Track:
        return path_track(path, accelerations, active, times, from_time)

    tracks = jax.vmap(tracked)(paths, bounds.cell_acceleration, tasks.active)
    fleet = paths.times.shape[0]
    cylinders, everyone = fleet_cylinders(tracks, fleet, TIMES_PER_INTERVAL * INTERVALS_PER_CYLINDER), jnp.arange(fleet)

    def ratios_of(who: Count) -> Float[Array, " aircraft"]:
        def tracks_of(some: Int[Array, " some"]) -> Track:
            return jax.tree.map(lambda leaf: leaf[some], tracks)

        one, own = jax.tree.map(lambda leaf: leaf[who], (tracks, cylinders))
        return fleet_clearance_ratio(one, own, cylinders, tracks_of, everyone != who, airspace.separation)

    ratios = jax.lax.map(ratios_of, everyone)
    clearance = jax.lax.map(lambda one: clearance_from_keep_outs(one, times, airspace.keep_outs), tracks)
    return Certificate(bounds, over, ratios, clearance)


def plan_fleet_at(
    start_time: ScalarLike,
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    intervals: int,
    candidate_set: CandidateSet,
    extra_for: Bool[Array, " aircraft"] | None = None,
    fixed_paths: FixedPaths | None = None,
) -> CertifiedPlan:
    """Plan a fleet from a time (s) on for given durations to each rendezvous (s).

    Parameters
    ----------
    intervals
        Even intervals between the knots of a path.
    extra_for
        Aircraft for which `candidate_set.extra` is looked at too; None: all that are active.
    standing
        Paths that the others keep clear of; these aircraft need not be active. None: there are none.
    """
    volumes = airspace.keep_outs
    begun = eqx.tree_at(
        lambda a: a.keep_outs.position_n, airspace, volumes.position_n + start_time * volumes.velocity_n
    )
    candidates = fleet_candidates(tasks, begun, durations, intervals, intervals, candidate_set, extra_for)
    fleet, since = jnp.arange(durations.shape[0]), -jnp.inf
    if fixed_paths is not None:
        candidates = _with_fixed_paths(candidates, fixed_paths, airspace, start_time, durations, intervals)
        tasks = eqx.tree_at(lambda t: t.active, tasks, jnp.where(fixed_paths.selected, 1.0, tasks.active))
        since = start_time

    def placed_of(valid: Bool[Array, "aircraft candidates"]) -> tuple[CertifiedPlan, Placement]:
        left = eqx.tree_at(lambda c: c.valid, candidates, valid)
        placed = place_candidates(left, airspace.separation, choice_order(left))
        paths, arrivals = candidates.paths(start_time, placed.chosen), start_time + durations
        if fixed_paths is not None:
            paths = select_rows(fixed_paths.selected, fixed_paths.paths, paths)
            arrivals = jnp.where(fixed_paths.selected, fixed_paths.arrival_times, arrivals)
        plan = CertifiedPlan(
            paths=paths,
            arrival_times=arrivals,
            certificate=certify(paths, tasks, airspace, intervals, since),
            valid=placed.valid,
            lengths=jax.vmap(TimedPath.air_length)(paths),
            total_turn=candidates.total_turn[fleet, placed.chosen],
            speeds=candidates.speed[fleet, placed.chosen],
        )
        return plan, placed

    if candidate_set.rounds == 1:
        return placed_of(candidates.valid)[0]
    # Splines have been certified already: an aircraft that has some gives up the others when one is rejected.
    uncertified = candidates.generator != SPLINE
    given_up = uncertified & jnp.any(candidates.valid & ~uncertified, axis=1, keepdims=True)
    return _choose_best_placement(placed_of, candidates.valid, given_up, tasks.active > 0.0, candidate_set.rounds)


def _with_fixed_paths(
    candidates: Candidates,
    fixed_paths: FixedPaths,
    airspace: Airspace,
    start_time: ScalarLike,
    durations: Float[Array, " aircraft"],
    intervals: int,
) -> Candidates:
    """Candidates with those of aircraft whose paths stand replaced by these paths."""
    times = start_time + jnp.max(durations) / intervals * jnp.arange(intervals + 1)

    def tracked(path: TimedPath) -> Track:
        bounds = path_bounds(path, airspace.wind, airspace.gravity)
        return path_track(path, bounds.cell_acceleration, 1.0, times)

    tracks, count = jax.vmap(tracked)(fixed_paths.paths), candidates.valid.shape[1]
    tracks = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf[:, None], (leaf.shape[0], count, *leaf.shape[1:])), tracks)
    own = tracks, jnp.ones_like(candidates.valid), jnp.zeros_like(candidates.cost), jnp.zeros_like(candidates.cost)
    held = (candidates.tracks, candidates.valid, candidates.cost, candidates.penetration)
    return eqx.tree_at(
        lambda c: (c.tracks, c.valid, c.cost, c.penetration), candidates, select_rows(fixed_paths.selected, own, held)
    )


def _choose_best_placement(
    placed_of: Callable[[Bool[Array, "aircraft candidates"]], tuple[CertifiedPlan, Placement]],
    valid: Bool[Array, "aircraft candidates"],
    given_up: Bool[Array, "aircraft candidates"],
    active: Bool[Array, " aircraft"],
    rounds: int,
) -> CertifiedPlan:
    """The plan in which the fewest aircraft fail, placed again without the candidates that a certificate rejects.

    With the first of its candidates, an aircraft loses those that are given up. What a candidate is held to is looked
    at from instant to instant; its certificate bounds what lies between too, and may find a limit violated by little.
    """
    fleet = jnp.arange(valid.shape[0])

    def again(
        carry: tuple[Count, Array, Array, CertifiedPlan, Flag],
    ) -> tuple[Count, Array, Array, CertifiedPlan, Flag]:
        turn, left, fewest, best, _ = carry
        plan, placed = placed_of(left)
        failed = jnp.sum(active & ~plan.feasible)
        rejected = active & plan.valid & ~plan.certificate.satisfied_individually
        best = jax.tree.map(lambda a, b: jnp.where(failed < fewest, a, b), plan, best)
        left = left.at[fleet, placed.chosen].min(~rejected) & ~(given_up & rejected[:, None])
        return turn + 1, left, jnp.minimum(failed, fewest), best, (failed > 0) & jnp.any(rejected)

    placed_of = jax.jit(placed_of)  # traced once, though its shapes are asked for first
    empty, _ = zeros_like_result(placed_of, valid)
    begin = (jnp.asarray(0), valid, jnp.asarray(fleet.size + 1), empty, jnp.asarray(True))
    return jax.lax.while_loop(lambda c: (c[0] < rounds) & c[4], again, begin)[3]


plan_at = compiled_by_older_generator(static_argnames=("intervals", "candidate_set"))(plan_fleet_at)
"""`plan_fleet_at`, compiled."""


def choose_interval_count(duration_s: float) -> int:
    """Even intervals for a path of a duration: a power of two from 64 to 2048, at most 2 s long where that will do."""
    return next((intervals for intervals in (64, 128, 256, 512, 1024) if 2.0 * intervals >= duration_s), 2048)
