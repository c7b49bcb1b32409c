"""Certified plans: one candidate path per aircraft, chosen for separation, and the certificate of these paths.

Aircraft choose one after another: each takes its cheapest candidate that is separated from the paths chosen before.
Then aircraft in conflict choose again, until no conflict is left or the number of rounds is reached.
"""

import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.compiling.options import compiled_by_older_generator
from anser.compiling.program import PreparedProgram
from anser.numerics.arrays import as_array, first_rows, namespace, select_rows, zeros_like_result
from anser.planning.certified.candidates import (
    ABSENT,
    SPLINE,
    Candidates,
    absent_candidates,
    concatenate_candidates,
    fleet_candidates,
    knot_count,
)
from anser.planning.certified.clearance import (
    INTERVALS_PER_CYLINDER,
    BoundingCylinders,
    Track,
    bounded_track,
    clearance_from_keep_outs,
    continue_straight,
    fleet_clearance_ratio,
    fleet_clearance_ratios,
    fleet_cylinders,
    path_track,
)
from anser.planning.certified.path_bounds import PathBounds, excess, path_bounds
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.timed_profiles import (
    EXTRA_SETS,
    MINIMAL,
    STANDARD,
    CandidateSet,
    ProfileSpeeds,
    fleet_speeds,
)
from anser.planning.limits import PathLimits
from anser.planning.separation import Separation
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Integer, Scalar, ScalarLike

SMALL_FLEET = 12
"""Greatest number of aircraft for which turn-and-leg paths and splines are tried besides the standard candidates."""
_CHUNK_SIZE = 4  # candidates compared with the whole fleet in one step, the cheapest first
_ROUNDS = 6
_INVALID_COST = 1e6
_CONFLICT_COST = 1e3
_Choice = tuple[BoundingCylinders, Array]  # cylinders and index of the candidate of each aircraft


class Placement(eqx.Module):
    """Chosen candidate of each aircraft, from `place_candidates`."""

    chosen: Int[Array, " aircraft"]  # index of the chosen candidate
    valid: Bool[Array, " aircraft"]  # whether the chosen candidate is within the aircraft's limits


def place_candidates(candidates: Candidates, separation: Separation, order: Int[Array, " aircraft"]) -> Placement:
    """Choose one candidate per aircraft such that the paths are separated and cheap; conflicts may remain.

    `order` has the indices of the aircraft in the order of their first choice. Invalid candidates and candidates inside
    a keep-out are allowed at a high cost.
    """
    cost = candidates.cost + jnp.where(candidates.valid, 0.0, _INVALID_COST)
    cost = cost + jnp.where(candidates.penetration > 0.0, _CONFLICT_COST + candidates.penetration, 0.0)
    fleet, count = cost.shape
    chunks = -(-count // _CHUNK_SIZE)
    ranked = jnp.argsort(cost, axis=1)
    ranked = jnp.concatenate([ranked, jnp.repeat(ranked[:, -1:], chunks * _CHUNK_SIZE - count, axis=1)], axis=1)
    separated = (separation.horizontal > 0.0) & (fleet > 1)
    all_cylinders, aircraft_indices = fleet_cylinders(candidates.tracks, fleet), jnp.arange(fleet)

    def shortfall(
        aircraft: Integer, options: Int[Array, " k"], cylinders: BoundingCylinders, chosen: Array, neighbours: Array
    ) -> Float[Array, " k"]:
        """Return the sum of 1 - clearance ratio over neighbours that are too near, for each of `options` (indices)."""

        def tracks_of(indices: Int[Array, " selected"]) -> Track:
            return jax.tree.map(lambda leaf: leaf[indices, chosen[indices]], candidates.tracks)

        def lack(k: Integer) -> Scalar:
            track, track_cylinders = jax.tree.map(lambda leaf: leaf[aircraft, k], (candidates.tracks, all_cylinders))
            ratio = fleet_clearance_ratio(track, track_cylinders, cylinders, tracks_of, neighbours, separation)
            return jnp.sum(jnp.maximum(1.0 - ratio, 0.0))

        return jax.vmap(lack)(options)

    def choose(aircraft: Integer, cylinders: BoundingCylinders, chosen: Array, neighbours: Array) -> Integer:
        """Return the index of the candidate of least cost, including the cost of conflicts with the neighbours."""

        def compare(carry: tuple[Integer, Integer, Scalar]) -> tuple[Integer, Integer, Scalar]:
            chunk, best, cost_min = carry
            options = jax.lax.dynamic_slice_in_dim(ranked[aircraft], chunk * _CHUNK_SIZE, _CHUNK_SIZE)
            missing = shortfall(aircraft, options, cylinders, chosen, neighbours)
            total = cost[aircraft, options] + jnp.where(missing > 0.0, _CONFLICT_COST * (1.0 + missing), 0.0)
            k = jnp.argmin(total)
            better = total[k] < cost_min
            return chunk + 1, jnp.where(better, options[k], best), jnp.where(better, total[k], cost_min)

        def may_improve(carry: tuple[Integer, Integer, Scalar]) -> Array:
            chunk, _, cost_min = carry
            following = cost[aircraft, ranked[aircraft, jnp.minimum(chunk * _CHUNK_SIZE, ranked.shape[1] - 1)]]
            return (chunk < chunks) & (following < cost_min)

        begin = (jnp.asarray(0), jnp.asarray(0, dtype=ranked.dtype), jnp.asarray(jnp.inf))
        return jax.lax.while_loop(may_improve, compare, begin)[1]

    def assign(aircraft: Integer, cylinders: BoundingCylinders, chosen: Array, neighbours: Array) -> _Choice:
        best = choose(aircraft, cylinders, chosen, neighbours & separated)
        cylinders = jax.tree.map(
            lambda chosen_cylinders, options: chosen_cylinders.at[aircraft].set(options[aircraft, best]),
            cylinders,
            all_cylinders,
        )
        return cylinders, chosen.at[aircraft].set(best)

    def first_choice(step: Integer, carry: tuple[_Choice, Array]) -> tuple[_Choice, Array]:
        (cylinders, chosen), placed = carry
        aircraft = order[step]
        return assign(aircraft, cylinders, chosen, placed), placed.at[aircraft].set(True)

    initial_cylinders = jax.tree.map(lambda leaf: jnp.zeros_like(leaf[:, 0]), all_cylinders)
    begin = ((initial_cylinders, jnp.zeros(fleet, dtype=ranked.dtype)), jnp.zeros(fleet, dtype=bool))
    (cylinders, chosen), _ = jax.lax.fori_loop(0, fleet, first_choice, begin)

    def shortfalls(cylinders: BoundingCylinders, chosen: Array) -> Float[Array, " aircraft"]:
        def aircraft_shortfall(aircraft: Integer) -> Scalar:
            return shortfall(
                aircraft, chosen[aircraft][None], cylinders, chosen, (aircraft_indices != aircraft) & separated
            )[0]

        return jax.lax.map(aircraft_shortfall, aircraft_indices)

    def choose_again(
        carry: tuple[Integer, BoundingCylinders, Array, Array],
    ) -> tuple[Integer, BoundingCylinders, Array, Array]:
        step, cylinders, chosen, missing = carry
        # Only aircraft in conflict choose again, alternately in the order of choosing and in reverse order.
        rank = jnp.where(step % 2 == 0, -jnp.argsort(order), jnp.argsort(order))
        queue = jnp.argsort(jnp.where(missing > 0.0, rank, fleet))

        def reassign(k: Integer, carry: _Choice) -> _Choice:
            return assign(queue[k], *carry, aircraft_indices != queue[k])

        cylinders, chosen = jax.lax.fori_loop(0, jnp.sum(missing > 0.0), reassign, (cylinders, chosen))
        return step + 1, cylinders, chosen, shortfalls(cylinders, chosen)

    _, _, chosen, _ = jax.lax.while_loop(
        lambda c: (c[0] < _ROUNDS) & jnp.any(c[3] > 0.0),
        choose_again,
        (jnp.asarray(0), cylinders, chosen, shortfalls(cylinders, chosen)),
    )
    return Placement(chosen, candidates.valid[aircraft_indices, chosen])


def choice_order(candidates: Candidates) -> Int[Array, " aircraft"]:
    """Return the indices of the aircraft in rising order of the number of valid candidates outside of keep-outs."""
    return jnp.argsort(jnp.sum(candidates.valid & (candidates.penetration <= 0.0), axis=1))


TIMES_PER_INTERVAL = 4
"""Number of intervals for which the certificate bounds distances, in each of a path's equal intervals between knots."""


class Certificate(eqx.Module):
    """Proven bounds of flight quantities and distances for a fleet's paths, valid between the sample times, too."""

    bounds: PathBounds  # bounds of each path
    # excess over each of `CERTIFIED_LIMITS`, relative to the limit; positive: violated
    excess: Float[Array, "aircraft limits"]
    # lower bound of each pair's ratio of distance to separation; at least 1 is required. Infinite on the diagonal. In a
    # large fleet, the bound is close for the nearest pairs only, see `anser.planning.certified.clearance`
    clearance_ratio: Float[Array, "aircraft aircraft"]
    keep_out_clearance: Float[Array, "aircraft volumes"]  # lower bound of the distance to each keep-out, m

    @property
    def satisfied_individually(self) -> Bool[Array, " aircraft"]:
        """Whether each path is proven to keep its aircraft's limits and the keep-outs, regardless of separation."""
        xp = namespace(self)
        excess, clearance = xp.asarray(self.excess), xp.asarray(self.keep_out_clearance)
        return xp.all(excess <= _ROUNDING, axis=1) & xp.all(clearance >= -_ROUNDING_M, axis=1)

    @property
    def satisfied(self) -> Bool[Array, " aircraft"]:
        """Whether each path is proven to keep its aircraft's limits, the keep-outs and the separation."""
        xp = namespace(self)
        return self.satisfied_individually & xp.all(xp.asarray(self.clearance_ratio) >= 1.0 - _ROUNDING, axis=1)


_ROUNDING = 1e-7  # relative to a limit: a path that starts at a limit is not refused for rounding
_ROUNDING_M = 1e-3


class CertifiedPlan(eqx.Module):
    """Paths of a fleet with their certificate; leading axis aircraft.

    Four masks grade the paths:

    - `valid`: within the aircraft's limits at sample times
    - `certificate.satisfied_individually`: limits and keep-outs are proven at all times
    - `certificate.satisfied`: the separation from the other aircraft is proven, too
    - `feasible`: `valid` and `certificate.satisfied`
    """

    paths: TimedPath  #: Position over time.
    arrival_times: Float[Array, " aircraft"]  #: Times of arrival at each rendezvous, s.
    certificate: Certificate  #: Rigorous bounds on the paths.
    valid: Bool[Array, " aircraft"]  #: Whether the path is within the aircraft's limits at sample times.
    #: Three-dimensional lengths of the paths through the air, from the latest replanning to the arrival, m.
    lengths: Float[Array, " aircraft"]
    total_turn: Float[Array, " aircraft"]  #: Sum of the absolute turn angles of each planned path, rad.
    speeds: Float[Array, " aircraft"]  #: Mean airspeeds, m/s.

    def leading(self, count: int) -> "CertifiedPlan":
        """Return the plan of the first `count` aircraft; not traceable by JAX."""
        plan = first_rows(self, count)
        ratios = as_array(np.asarray(plan.certificate.clearance_ratio)[:, :count])
        return eqx.tree_at(lambda p: p.certificate.clearance_ratio, plan, ratios)

    @property
    def feasible(self) -> Bool[Array, " aircraft"]:
        """Mask of the aircraft whose path is `valid` and proven to keep limits, keep-outs and separation."""
        return namespace(self).asarray(self.valid) & self.certificate.satisfied


class FixedPaths(eqx.Module):
    """Paths that stay unchanged while the rest of a fleet is planned around them; leading axis aircraft."""

    selected: Bool[Array, " aircraft"]  # mask of the aircraft with a fixed path
    # fixed paths, and arrival times, s; arbitrary for aircraft that are not selected
    paths: TimedPath
    arrival_times: Float[Array, " aircraft"]


def fleet_bounds(paths: TimedPath, airspace: Airspace) -> PathBounds:
    """Compute proven bounds of the flight quantities (`PathBounds`) along each of the stacked paths."""
    # A loop over the aircraft compiles in less time than a batch, and runs as fast.
    return jax.lax.map(lambda path: path_bounds(path, airspace.wind, airspace.gravity), paths)


def within_limits(bounds: PathBounds, limits: PathLimits) -> Bool[Array, " aircraft"]:
    """Whether the proven bounds of each aircraft's path are within the aircraft's limits."""
    return jnp.all(jax.vmap(excess)(bounds, limits) <= _ROUNDING, axis=1)


def certify(
    paths: TimedPath,
    tasks: AircraftTask,
    airspace: Airspace,
    intervals: int,
    from_time: ScalarLike = -jnp.inf,
    bounds: PathBounds | None = None,
) -> Certificate:
    """Compute the certificate of a fleet's paths, each with `intervals` equal intervals between its knots.

    Limits are checked over the whole paths; distances are checked from `from_time` (s) to the arrivals, for active
    aircraft. `bounds` are the bounds of the paths; None: computed here.
    """
    bounds = fleet_bounds(paths, airspace) if bounds is None else bounds
    over = jax.vmap(excess)(bounds, tasks.limits)
    # An invalid path is reported by its own bounds; its times must not spoil the common time grid.
    start_times, end_times = paths.times[:, 0], paths.times[:, -1]
    start = jnp.min(jnp.where(jnp.isfinite(start_times), start_times, jnp.inf))
    end = jnp.max(jnp.where(jnp.isfinite(end_times), end_times, -jnp.inf))
    times = start + (end - start) * jnp.linspace(0.0, 1.0, TIMES_PER_INTERVAL * intervals + 1)

    def tracked(path: TimedPath, accelerations: Array, active: Scalar) -> Track:
        return path_track(path, accelerations, active, times, from_time)

    tracks = jax.lax.map(lambda row: tracked(*row), (paths, bounds.cell_acceleration, tasks.active))
    ratios = fleet_clearance_ratios(tracks, airspace.separation, TIMES_PER_INTERVAL * INTERVALS_PER_CYLINDER)
    clearance = jax.lax.map(
        lambda fleet_track: clearance_from_keep_outs(fleet_track, times, airspace.keep_outs), tracks
    )
    return Certificate(bounds, over, ratios, clearance)


def _candidates(
    start_time: ScalarLike,
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    intervals: int,
    candidate_set: CandidateSet,
    # airspeeds, selected aircraft and number of profiles for `fleet_candidates`
    speeds: ProfileSpeeds | None = None,
    selected: Bool[Array, " aircraft"] | None = None,
    profile_count: Integer | None = None,
) -> Candidates:
    airspace = airspace.at_start(start_time)
    return fleet_candidates(tasks, airspace, durations, intervals, candidate_set, speeds, selected, profile_count)


def _choose_and_certify(
    start_time: ScalarLike,
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    candidates: Candidates,
    intervals: int,
    rounds: Integer,  # greatest number of rounds of choosing and certifying, see `_choose_best_placement`
    fixed_paths: FixedPaths | None,
    members: Bool[Array, " candidates"] | None = None,  # mask of the `candidates` to choose from; None: all
    extra: tuple[Candidates, ...] = (),  # candidates to append to `candidates`, the splines last
    # duration, s, for which each aircraft is assumed to fly straight on after its arrival; if possible, the choice also
    # separates the aircraft in this time. None or 0: separation up to the arrivals only
    look_ahead: ScalarLike | None = None,
) -> CertifiedPlan:
    """Choose one candidate per aircraft, keep fixed paths as they are, and certify the plan."""
    if members is not None:
        present = candidates.valid & members[None], jnp.where(members[None], candidates.cost, ABSENT)
        candidates = eqx.tree_at(lambda c: (c.valid, c.cost), candidates, present)
    candidates = functools.reduce(concatenate_candidates, extra, candidates)
    fleet, is_planned = jnp.arange(durations.shape[0]), tasks.active > 0.0
    if fixed_paths is not None:
        is_planned = is_planned & ~fixed_paths.selected
        candidates = _with_fixed_paths(candidates, fixed_paths, airspace, start_time, durations, intervals)
        tasks = eqx.tree_at(lambda t: t.active, tasks, jnp.where(fixed_paths.selected, 1.0, tasks.active))

    compared = candidates  # with the tracks that count for the separation
    if look_ahead is not None:
        tracks = continue_straight(candidates.tracks, durations, look_ahead, is_planned)
        compared = eqx.tree_at(lambda c: c.tracks, candidates, tracks)

    def place_and_certify(valid: Bool[Array, "aircraft candidates"]) -> tuple[CertifiedPlan, Placement]:
        remaining = eqx.tree_at(lambda c: c.valid, compared, valid)
        placement = place_candidates(remaining, airspace.separation, choice_order(remaining))
        paths, arrivals = candidates.paths(start_time, placement.chosen), start_time + durations
        if fixed_paths is not None:
            paths = select_rows(fixed_paths.selected, fixed_paths.paths, paths)
            arrivals = jnp.where(fixed_paths.selected, fixed_paths.arrival_times, arrivals)
        plan = CertifiedPlan(
            paths=paths,
            arrival_times=arrivals,
            certificate=certify(paths, tasks, airspace, intervals, start_time),
            valid=placement.valid,
            lengths=jax.lax.map(TimedPath.air_length, paths),
            total_turn=candidates.total_turn[fleet, placement.chosen],
            speeds=candidates.speed[fleet, placement.chosen],
        )
        return plan, placement

    # Splines are certified already: after a rejection, an aircraft with splines loses its other candidates.
    uncertified = candidates.generator != SPLINE
    withdrawn = uncertified & jnp.any(candidates.valid & ~uncertified, axis=1, keepdims=True)
    return _choose_best_placement(place_and_certify, candidates.valid, withdrawn, is_planned, rounds)


_find_speeds = compiled_by_older_generator(("intervals",), "airspeeds")(fleet_speeds)
_generate = compiled_by_older_generator(("intervals", "candidate_set"), "paths")(_candidates)
_choose = compiled_by_older_generator(("intervals",), "choice of paths")(_choose_and_certify)


# Time after the arrivals, s, in which the second choice of `plans_at` separates aircraft as if they flew straight on.
# An F-16 in its tightest hold leaves the straight line by 15 m in 2 s and 110 m in 5 s, while two aircraft head-on at
# 190 m/s close by 760 m and 1,900 m.
_LOOK_AHEAD_S = 5.0


def standard_candidates(
    start_time: ScalarLike,
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    intervals: int,
    candidate_set: CandidateSet = STANDARD,
) -> Candidates:
    """Generate the candidates of the set `STANDARD`, by one compiled program for `STANDARD` and smaller sets.

    The candidates of a profile (altitude and airspeed) of `STANDARD` are absent if `candidate_set`, such as `MINIMAL`,
    contains neither this nor a later profile.
    """
    speeds = _find_speeds(tasks, airspace, durations, intervals, *_speed_flags(STANDARD, candidate_set))
    arguments = as_array(start_time), tasks, airspace, durations
    return _generate(*arguments, intervals, STANDARD, speeds, profile_count=_profile_count(candidate_set))


def plans_at(
    start_time: ScalarLike,  # start of the paths, s
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],  # each aircraft's time to the rendezvous, s
    intervals: int,  # number of equal intervals between the knots of a path
    candidate_set: CandidateSet,
    candidates: Candidates,  # from `standard_candidates`, for the set and the same arguments
    # aircraft that get `candidate_set.extra`; None: every active one
    extra_for: Bool[Array, " aircraft"] | None = None,
    # fixed paths that the planned aircraft avoid; their aircraft may be inactive. None: every path is planned
    fixed_paths: FixedPaths | None = None,
) -> Iterator[CertifiedPlan]:
    """Yield two certified plans: separated up to the arrivals; separated after the arrivals, too, as far as possible.

    The second plan is for fleets whose first plan has no separated holds. Its candidates are chosen as if each aircraft
    flew straight on for `_LOOK_AHEAD_S` after its arrival.
    """
    arguments = as_array(start_time), tasks, airspace, durations
    extra_set = candidate_set.extra
    extra = _absent_extra(candidates, extra_set)
    if extra_set is not None:
        selected = as_array(tasks.active if extra_for is None else extra_for, bool)
        speeds = None
        if extra_set.speeds:
            speeds = _find_speeds(tasks, airspace, durations, intervals, *_speed_flags(extra_set, extra_set))
        extra[extra_set] = _generate(*arguments, intervals, extra_set, speeds, selected)
    choice = _choice_arguments(candidates, intervals, candidate_set, extra, fixed_paths)
    for look_ahead_s in (0.0, _LOOK_AHEAD_S):
        yield _choose(*arguments, *choice, look_ahead=as_array(look_ahead_s))


def plan_at(
    start_time: ScalarLike,
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    intervals: int,
    candidate_set: CandidateSet,
    fixed_paths: FixedPaths | None = None,  # fixed paths that the planned aircraft avoid; None: every path is planned
) -> CertifiedPlan:
    """Generate candidates with which each aircraft arrives after its duration (s), choose among them, and certify.

    The result is the first plan of `plans_at`: separated up to the arrivals.
    """
    arguments = start_time, tasks, airspace, durations, intervals, candidate_set
    return next(plans_at(*arguments, standard_candidates(*arguments), fixed_paths=fixed_paths))


def prepare_plan_at(tasks: AircraftTask, airspace: Airspace, intervals: int) -> Iterator[PreparedProgram]:
    """Yield the compiled programs that `plan_at` calls if no extra candidates are needed; the last returns the plan."""
    times = as_array(0.0), jax.ShapeDtypeStruct(tasks.active.shape, tasks.active.dtype)
    arguments = times[0], tasks, airspace, times[1]
    speeds = _find_speeds.prepare(*arguments[1:], intervals, *_speed_flags(STANDARD, MINIMAL))
    yield speeds
    count = _profile_count(MINIMAL)
    candidates = _generate.prepare(*arguments, intervals, STANDARD, speeds.shapes, profile_count=count)
    yield candidates
    extra = _absent_extra(candidates.shapes, STANDARD.extra)
    choice = _choice_arguments(candidates.shapes, intervals, STANDARD, extra, None)
    yield _choose.prepare(*arguments, *choice, look_ahead=as_array(0.0))


def prepare_extra_candidates(tasks: AircraftTask, airspace: Airspace, intervals: int) -> Iterator[PreparedProgram]:
    """Yield one by one the programs that generate `EXTRA_SETS`, for aircraft without a feasible standard candidate."""
    durations = jax.ShapeDtypeStruct(tasks.active.shape, tasks.active.dtype)
    selected = jax.ShapeDtypeStruct(tasks.active.shape, np.bool_)
    for kind in EXTRA_SETS:
        speeds = None
        if kind.speeds:
            speeds = _find_speeds.prepare(tasks, airspace, durations, intervals, *_speed_flags(kind, kind))
            yield speeds
        shapes = None if speeds is None else speeds.shapes
        yield _generate.prepare(as_array(0.0), tasks, airspace, durations, intervals, kind, shapes, selected)


def _speed_flags(candidate_set: CandidateSet, members: CandidateSet) -> tuple[Array, Array]:
    """Return the flags for `fleet_speeds`, if only the part `members` of a candidate set is used."""
    return as_array(candidate_set.with_wide_turns, bool), as_array(members.with_matched, bool)


def _profile_count(candidate_set: CandidateSet) -> Array:
    """Return the least n for which the first n profiles of `STANDARD` include every profile of a smaller set."""
    return as_array(STANDARD.leading_profiles(candidate_set), np.int64)


def _absent_extra(candidates: Candidates, extra_set: CandidateSet | None) -> dict[CandidateSet, Candidates]:
    """Return absent candidates for each of `EXTRA_SETS`; empty for a large fleet if `extra_set` is None."""
    needed = extra_set is not None or candidates.cost.shape[0] <= SMALL_FLEET
    return {kind: _shared_arrays(absent_candidates, _Shapes.of(candidates), kind) for kind in EXTRA_SETS if needed}


class _Shapes(NamedTuple):
    """Tree structure of candidates, and shape and data type of each array; hashable, a key for `_shared_arrays`."""

    structure: Any
    leaves: tuple[tuple[tuple[int, ...], np.dtype], ...]

    @classmethod
    def of(cls, candidates: Candidates) -> "_Shapes":
        leaves, structure = jax.tree.flatten(candidates)
        return cls(structure, tuple((leaf.shape, np.dtype(leaf.dtype)) for leaf in leaves))


@functools.lru_cache(maxsize=8)
def _shared_arrays(make: Callable[..., Any], shapes: _Shapes, *arguments: Any) -> Any:
    """Return `make(candidates, *arguments)` for candidates of `shapes`, as arrays on the device; cached."""
    candidates = shapes.structure.unflatten([jax.ShapeDtypeStruct(*leaf) for leaf in shapes.leaves])
    return jax.tree.map(lambda leaf: as_array(leaf, None), make(candidates, *arguments))


def _choice_arguments(
    candidates: Candidates,  # candidates of `STANDARD`, or their shapes
    intervals: int,
    candidate_set: CandidateSet,
    extra: dict[CandidateSet, Candidates],
    fixed_paths: FixedPaths | None,
) -> tuple[Any, ...]:
    """Return the arguments of `_choose` that follow the durations, in order."""
    if fixed_paths is None:
        fixed_paths = _shared_arrays(_absent_fixed_paths, _Shapes.of(candidates))
    members = _members(candidate_set)
    rounds = as_array(candidate_set.rounds, np.int32)
    return candidates, intervals, rounds, fixed_paths, members, tuple(extra.values())


@functools.cache
def _members(candidate_set: CandidateSet) -> Array:
    """Return the mask of the candidates of `STANDARD` that `candidate_set` contains, too."""
    return as_array(STANDARD.members_of(candidate_set), bool)


def _absent_fixed_paths(candidates: Candidates) -> FixedPaths:
    """Return `FixedPaths` that select no aircraft, with as many knots as the paths of the candidates; NumPy arrays."""
    fleet, knots, dtype = candidates.cost.shape[0], knot_count(candidates), candidates.cost.dtype
    states: Any = np.zeros((fleet, knots, 3, 3), dtype)
    times: Any = np.broadcast_to(np.arange(knots, dtype=dtype), (fleet, knots))
    selected: Any = np.zeros(fleet, bool)
    arrival_times: Any = np.zeros(fleet, dtype)
    return FixedPaths(selected, TimedPath(times, states, states), arrival_times)


def _with_fixed_paths(
    candidates: Candidates,
    fixed_paths: FixedPaths,
    airspace: Airspace,
    start_time: ScalarLike,
    durations: Float[Array, " aircraft"],
    intervals: int,
) -> Candidates:
    """If an aircraft has a fixed path, replace all its candidates by this path: valid, no cost, proven tracks."""
    times = start_time + jnp.max(durations) / intervals * jnp.arange(intervals + 1)
    tracks = jax.lax.map(lambda path: bounded_track(path, airspace, 1.0, times), fixed_paths.paths)
    count = candidates.valid.shape[1]
    tracks = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf[:, None], (leaf.shape[0], count, *leaf.shape[1:])), tracks)
    fixed_fields = (
        tracks,
        jnp.ones_like(candidates.valid),
        jnp.zeros_like(candidates.cost),
        jnp.zeros_like(candidates.cost),
    )
    planned_fields = (candidates.tracks, candidates.valid, candidates.cost, candidates.penetration)
    return eqx.tree_at(
        lambda c: (c.tracks, c.valid, c.cost, c.penetration),
        candidates,
        select_rows(fixed_paths.selected, fixed_fields, planned_fields),
    )


def _choose_best_placement(
    place_and_certify: Callable[[Bool[Array, "aircraft candidates"]], tuple[CertifiedPlan, Placement]],
    valid: Bool[Array, "aircraft candidates"],
    withdrawn: Bool[Array, "aircraft candidates"],
    active: Bool[Array, " aircraft"],
    rounds: Integer,
) -> CertifiedPlan:
    """Choose candidates for the fleet and certify them, repeatedly; return the plan with the fewest failing aircraft.

    If the chosen candidate of an aircraft lacks proven limits and keep-outs, later rounds exclude this candidate and
    the aircraft's candidates in the mask `withdrawn`. The search ends with a round in which no aircraft fails or no
    candidate is excluded, at the latest after `rounds` rounds. `valid` is the mask for the first round.
    """
    fleet = jnp.arange(valid.shape[0])

    def retry(
        carry: tuple[Integer, Array, Array, CertifiedPlan, Flag],
    ) -> tuple[Integer, Array, Array, CertifiedPlan, Flag]:
        round_index, remaining, fewest, best, _ = carry
        plan, placement = place_and_certify(remaining)
        failed = jnp.sum(active & ~plan.feasible)
        rejected = active & plan.valid & ~plan.certificate.satisfied_individually
        best = jax.tree.map(lambda a, b: jnp.where(failed < fewest, a, b), plan, best)
        remaining = remaining.at[fleet, placement.chosen].min(~rejected) & ~(withdrawn & rejected[:, None])
        return round_index + 1, remaining, jnp.minimum(failed, fewest), best, (failed > 0) & jnp.any(rejected)

    place_and_certify = jax.jit(place_and_certify)  # traced once, for its shapes and for the loop
    empty, _ = zeros_like_result(place_and_certify, valid)
    begin = (jnp.asarray(0), valid, jnp.asarray(fleet.size + 1), empty, jnp.asarray(True))
    return jax.lax.while_loop(lambda c: (c[0] < rounds) & c[4], retry, begin)[3]


def choose_interval_count(duration_s: float) -> int:
    """Return the number of intervals for a duration (s): the least power of two with intervals of at most 2 s.

    The number is at least 128, and at most 2048 even if the intervals are then longer.
    """
    return next((intervals for intervals in (128, 256, 512, 1024) if 2.0 * intervals >= duration_s), 2048)
