"""Candidates: paths on which an aircraft arrives at its rendezvous at a required time.

A candidate is a route (turns and straight legs, horizontal) with a profile (altitude and airspeed over time), or a
spline in time. The chosen candidates are converted to timed paths (`TimedPath`).
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import map_rows, select_rows
from anser.planning.certified.clearance import Track, clearance_from_keep_outs, path_track, route_track, sample_profile
from anser.planning.certified.detours import (
    DETOUR_KINDS,
    detour,
    greatest_curvature,
    solve_detour,
    solve_racetrack,
    widen_detour,
    widen_racetrack,
)
from anser.planning.certified.profile import KINKS, TabulatedProfile, flown_between
from anser.planning.certified.routes import PIECES, PathEndpoints, Route, TurnsAndLegs, cis, route
from anser.planning.certified.spline_search import find_splines
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.timed_profiles import (
    RACETRACK,
    CandidateSet,
    ProfileSpeeds,
    TimedProfile,
    profile_speeds,
    timed_profiles,
)
from anser.planning.certified.turn_leg_paths import (
    TurnLegProblem,
    keep_outs_along_path,
    make_radius_schedule,
    make_starts,
    solve_turn_leg_paths,
)
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3

_CLOSE_S = 0.02  # closer knots are merged, because accelerations from differences of positions lose digits


def _knots(marks: Float[Array, " marks"], duration: Scalar, intervals: int) -> Float[Array, " knots"]:
    """Return knot times, s: the bounds of equal intervals and the times `marks`; times closer than `_CLOSE_S` merge."""
    even = duration * jnp.linspace(0.0, 1.0, intervals + 1)
    times = jnp.sort(jnp.concatenate([even, jnp.clip(marks, 0.0, duration)]))
    times = jnp.where(duration - times < _CLOSE_S, duration, times)

    def merge(previous: Scalar, time: Scalar) -> tuple[Scalar, Scalar]:
        merged = jnp.where(time - previous < _CLOSE_S, previous, time)
        return merged, merged

    return jax.lax.scan(merge, jnp.zeros(()), times)[1]


def deliver(start_time: ScalarLike, table: TabulatedProfile, horizontal: Route) -> TimedPath:
    """Convert a profile and a route to a timed path that starts at a time (s).

    Profile and route must have the same length through the air to a part in a million; the airspeed is multiplied by
    route length / profile length. Knots are at equal intervals and at every kink of curvature, climb or speed.
    """
    duration = table.profile.duration
    marks = jax.vmap(table.time_at)(horizontal.marks[1:-1] * (table.length / jnp.maximum(horizontal.length, 1.0)))
    times = _knots(jnp.concatenate([marks, table.profile.kinks]), duration, table.lengths.shape[0] - 1)
    # Integrated from knot to knot, without kinks: the table's lengths are slightly wrong in intervals with a kink, and
    # in a cell of some hundredths of a second a tenth of a millimetre is an acceleration of 1 m/s^2.
    flown, drifted = jax.vmap(lambda begin, span: flown_between(table.profile, table.wind, begin, span))(
        times[:-1], times[1:] - times[:-1]
    )
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(flown)])
    drifts = jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(drifted, axis=0)])
    # The correction makes the path end exactly at the rendezvous, which was computed with the table's drift.
    drift_correction = (table.drift_n - drifts[-1]) / duration
    scale = horizontal.length / jnp.maximum(lengths[-1], 1.0)

    def knot_state(t: Scalar, length: Scalar, drift: Vector3) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
        (speed, wind), (speed_dot, wind_dot) = jax.jvp(table.rates, (t,), (jnp.ones_like(t),))
        position, heading, curvature = horizontal.at(scale * length)
        drift, wind = drift + t * drift_correction, wind + drift_correction
        state = table.profile.at(t)
        direction = cis(heading)
        velocity = scale * speed * direction
        acceleration = (scale * speed_dot + 1j * curvature * (scale * speed) ** 2) * direction
        level = [jnp.stack([jnp.real(x), jnp.imag(x)]) for x in (position, velocity, acceleration)]
        down = (-state.altitude - drift[2], -state.climb - wind[2], -state.climb_dot - wind_dot[2])
        air = jnp.stack([jnp.append(x, z) for x, z in zip(level, down, strict=True)])
        return air, jnp.stack([drift, wind, wind_dot])

    air_n, drift_n = jax.vmap(knot_state)(times, lengths, drifts)
    return TimedPath(start_time + times, air_n, drift_n)


DETOUR, TURN_LEG_PATH, SPLINE = range(3)
_REFINED_FRACTION = 0.4  # fraction of the starts of turn-and-leg paths that is refined
_RACETRACK_COST, _TURN_LEG_COST, _SPLINE_COST = 2.0, 3.0, 6.0  # of unusual path shapes
_BANK_COST = 1.0  # per radian of the greatest bank angle
_INVALID = 1e6
ABSENT = 1e9
"""Cost of an absent candidate, which fills an unused place in an array: higher than that of any generated candidate."""


class Routes(NamedTuple):
    """Horizontal routes of candidates, each with the index of its profile of altitude and airspeed."""

    endpoints: PathEndpoints  # start and end conditions of each route
    turns_and_legs: TurnsAndLegs  # turns and legs between the endpoints
    profile: Integer  # index of the profile in `Candidates.profiles`


class Candidates(eqx.Module):
    """Candidate paths, routes before splines; leading axes (aircraft, candidate), or (candidate) for one aircraft."""

    generator: Int[Array, "*aircraft candidates"]  # `DETOUR`, `TURN_LEG_PATH` or `SPLINE`
    valid: Bool[Array, "*aircraft candidates"]  # whether the candidate exists and keeps its aircraft's limits
    cost: Float[Array, "*aircraft candidates"]  # no unit; a smaller cost is preferred
    # sum of the absolute turn angles, rad, and mean airspeed, m/s
    total_turn: Float[Array, "*aircraft candidates"]
    speed: Float[Array, "*aircraft candidates"]
    tracks: Track  # positions at the sample times that are common to the fleet
    penetration: Float[Array, "*aircraft candidates"]  # depth inside keep-outs, m
    # routes of all candidates except the splines, and profiles of altitude and airspeed, with leading axes (aircraft,
    # profile); None if all candidates are splines
    routes: Routes | None
    profiles: TabulatedProfile | None
    splines: TimedPath | None  # paths of the spline candidates, from time 0; None if there are none

    def paths(self, start_time: ScalarLike, chosen: Int[Array, " aircraft"]) -> TimedPath:
        """Return the timed path of one candidate per aircraft (index `chosen`), from a start time (s) on, stacked.

        Raises ValueError if all candidates are splines.
        """
        if self.routes is None:
            raise ValueError("paths are chosen among routes and splines, not among splines alone")
        fleet, routed = jnp.arange(chosen.shape[0]), self.routes.profile.shape[1]
        selected_routes = jax.tree.map(lambda leaf: leaf[fleet, jnp.minimum(chosen, routed - 1)], self.routes)
        profiles = jax.tree.map(lambda leaf: leaf[fleet, selected_routes.profile], self.profiles)

        def path(row: tuple[TabulatedProfile, Routes]) -> TimedPath:
            return deliver(start_time, row[0], route(row[1].endpoints, row[1].turns_and_legs))

        paths = jax.lax.map(path, (profiles, selected_routes))
        if self.splines is None:
            return paths
        splines = jax.tree.map(lambda leaf: leaf[fleet, jnp.maximum(chosen - routed, 0)], self.splines)
        splines = eqx.tree_at(lambda p: p.times, splines, start_time + splines.times)
        return select_rows(chosen >= routed, splines, paths)


class _Routed(NamedTuple):
    """Candidates made of turns and legs (no splines); fields as in `Candidates`."""

    generator: Integer
    valid: Flag
    cost: Scalar
    total_turn: Scalar
    speed: Scalar
    routes: Routes


def _routed_candidate(
    generator: int,
    timed: TimedProfile,
    gravity: ScalarLike,
    solution: TurnsAndLegs,
    fits: Flag,
    cost: Scalar,
    profile: Integer,
) -> _Routed:
    valid = timed.within_limits & solution.exists & fits & jnp.isfinite(timed.table.length)
    total_turn = jnp.sum(jnp.abs(solution.angles))
    cost = cost + _BANK_COST * jnp.arctan(greatest_curvature(timed.endpoints, solution) * timed.speed**2 / gravity)
    routes = Routes(timed.endpoints, solution, profile)
    return _Routed(jnp.asarray(generator), valid, total_turn + cost, total_turn, timed.speed, routes)


def routed_candidates(
    task: AircraftTask,
    airspace: Airspace,
    duration: ScalarLike,
    intervals: int,
    candidate_set: CandidateSet,
    speeds: ProfileSpeeds | None = None,  # airspeeds of the profiles; None: computed here
    numbers: Int[Array, " profiles"] | None = None,  # indices in the set of the profiles to generate; None: all
) -> tuple[_Routed, TabulatedProfile]:
    """Generate the detours and turn-and-leg paths with which one aircraft arrives after a duration (s).

    Returns the candidates, stacked, and the generated profiles, stacked. If there are more candidates than
    `candidate_set.max_candidates`, only the cheapest are returned. The field `routes.profile` of a candidate is the
    index of its profile in `candidate_set`, even if `numbers` is given.
    """
    duration = jnp.asarray(duration, dtype=float)
    if speeds is None:
        needs = candidate_set.with_wide_turns, candidate_set.with_matched
        speeds = profile_speeds(task, airspace, duration, intervals, *needs)
    numbers = jnp.arange(len(candidate_set.speeds)) if numbers is None else numbers
    choices = jnp.asarray(candidate_set.speeds)[numbers]
    altitude_detours = jnp.asarray(candidate_set.altitude_detours)[numbers]
    ends = speeds.middle[choices], speeds.final[choices]
    timed = timed_profiles(task, airspace, duration, intervals, altitude_detours, ends)
    costs = jnp.abs(timed.speed / task.speed - 1.0) * 20.0 + jnp.abs(altitude_detours) / 400.0
    of_profile = functools.partial(_profile_candidates, task, airspace, candidate_set)
    if candidate_set.max_candidates is None:
        candidates = map_rows(of_profile, timed, costs, numbers)
    else:
        candidates = _candidates_within_limits(of_profile, timed, costs, numbers)
    flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), candidates)
    if candidate_set.max_candidates is not None and candidate_set.max_candidates < candidate_set.size:
        best = jnp.argsort(jnp.where(flat.valid, flat.cost, jnp.inf))[: candidate_set.max_candidates]
        flat = jax.tree.map(lambda leaf: leaf[best], flat)
    return flat, timed.table


def _profile_candidates(
    task: AircraftTask,
    airspace: Airspace,
    candidate_set: CandidateSet,
    timed: TimedProfile,
    cost: Scalar,  # cost of the profile
    number: Integer,  # index of the profile in the set
) -> _Routed:
    """Generate the detours and turn-and-leg paths of one profile, stacked: detours first."""
    detours = functools.partial(_detours, task, airspace.gravity, candidate_set, timed, (cost, number))
    tables = candidate_set.direct_ranks, candidate_set.detour_kinds, candidate_set.sides
    candidates = jax.vmap(detours)(*map(jnp.asarray, tables))
    candidates = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), candidates)
    if candidate_set.turn_leg_starts:
        turn_leg_candidates = _turn_leg_paths(task, airspace, candidate_set.turn_leg_starts, timed, (cost, number))
        candidates = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), candidates, turn_leg_candidates)
    return candidates


def _candidates_within_limits(
    of_profile: Callable[[TimedProfile, Scalar, Integer], _Routed],
    timed: TimedProfile,  # profiles, stacked
    costs: Float[Array, " profiles"],
    numbers: Int[Array, " profiles"],
) -> _Routed:
    """Generate the candidates of the profiles that are within limits, one profile at a time; (profile, candidate).

    `of_profile` generates the candidates of one profile from the profile, its cost, and its index in the set. The
    candidates of a profile outside the limits are invalid, with the cost `ABSENT`.
    """
    # Often only a fifth of the profiles is within limits.
    of_profile = jax.jit(of_profile)  # traced once, for its shapes and for the loop
    profiles = timed, costs, numbers
    shapes = jax.eval_shape(of_profile, *jax.tree.map(lambda leaf: leaf[0], profiles))
    empty = jax.tree.map(lambda leaf: jnp.zeros((*numbers.shape, *leaf.shape), leaf.dtype), shapes)
    empty = empty._replace(cost=jnp.full_like(empty.cost, ABSENT))
    queue = jnp.argsort(~timed.within_limits, stable=True)

    def add(k: Integer, candidates: _Routed) -> _Routed:
        row = queue[k]
        added = of_profile(*jax.tree.map(lambda leaf: leaf[row], profiles))
        return jax.tree.map(lambda stored, leaf: stored.at[row].set(leaf), candidates, added)

    return jax.lax.fori_loop(0, jnp.sum(timed.within_limits), add, empty)


def _detours(
    task: AircraftTask,
    gravity: Scalar,
    candidate_set: CandidateSet,
    timed: TimedProfile,
    cost_and_profile: tuple[Scalar, Integer],
    word: Integer,
    kind: Integer,
    side: Integer,
) -> _Routed:
    """Generate the detours of one `kind` to one `side` (1 right, -1 left) of a direct path; same length as the profile.

    `word` is the index of the direct path in `timed.direct`; `kind`: see `detour`, or `RACETRACK`. Returns the detour
    with the tightest turns and, if `candidate_set.with_wide_turns`, also with wide turns; stacked. `cost_and_profile`
    are cost and index of the profile. If the task prescribes the opposite side, the detours are invalid.
    """
    endpoints, target_length = timed.endpoints, timed.table.length
    base, wide = jax.tree.map(lambda leaf: leaf[word], (timed.direct, timed.wide_directs))
    shape, sense = detour(jnp.minimum(kind, DETOUR_KINDS - 1), side), side.astype(float)
    solutions = [solve_detour(endpoints, base, shape, target_length)]
    if candidate_set.with_wide_turns:
        solutions.append(widen_detour(endpoints, wide, shape, target_length, solutions[0]))
    if RACETRACK in candidate_set.detour_kinds:
        racetracks = [solve_racetrack(endpoints, base, sense, target_length)]
        if candidate_set.with_wide_turns:
            racetracks.append(widen_racetrack(endpoints, wide, sense, target_length, racetracks[0]))
        solutions = jax.tree.map(lambda a, b: jnp.where(kind == RACETRACK, a, b), racetracks, solutions)
    fits = (task.side == 0) | (task.side * side > 0)
    cost, profile = cost_and_profile
    cost = cost + jnp.where(kind == RACETRACK, _RACETRACK_COST, 0.0) + 0.01 * kind
    candidates = [_routed_candidate(DETOUR, timed, gravity, solution, fits, cost, profile) for solution in solutions]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *candidates)


def _turn_leg_paths(
    task: AircraftTask, airspace: Airspace, starts: int, timed: TimedProfile, cost_and_profile: tuple[Scalar, Integer]
) -> _Routed:
    """Generate turn-and-leg paths as long as the profile, stacked, from `starts` initial guesses.

    If the task prescribes a side, the paths are invalid. `cost_and_profile` are cost and index of the profile.
    """
    schedule = make_radius_schedule(timed.table, timed.endpoints, task.limits, airspace.gravity)
    keep_outs = keep_outs_along_path(timed.table, airspace.keep_outs)
    problem = TurnLegProblem(timed.endpoints, schedule, keep_outs, timed.table.length)
    solutions = solve_turn_leg_paths(problem, make_starts(starts), int(_REFINED_FRACTION * starts))
    cost, profile = cost_and_profile
    cost, fits = cost + _TURN_LEG_COST, task.side == 0
    return jax.vmap(
        lambda solution: _routed_candidate(TURN_LEG_PATH, timed, airspace.gravity, solution, fits, cost, profile)
    )(solutions)


def aircraft_candidates(
    task: AircraftTask,
    airspace: Airspace,
    duration: Scalar,
    intervals: int,
    times: Float[Array, " instants"],
    candidate_set: CandidateSet,
    speeds: ProfileSpeeds | None = None,  # airspeeds of the profiles; None: computed here
    numbers: Int[Array, " profiles"] | None = None,  # indices in the set of the profiles to generate; None: all
) -> Candidates:
    """Generate candidates of one aircraft that arrives after a duration (s), with their tracks at `times` (s)."""
    parts: list[tuple[Any, ...]] = []
    routes = profiles = splines = None
    if candidate_set.speeds:
        routed, profiles = routed_candidates(task, airspace, duration, intervals, candidate_set, speeds, numbers)
        parts.append(_tracked(task, airspace, times, routed, profiles, numbers))
        routes = routed.routes
    if candidate_set.spline_starts:
        found = find_splines(
            task, airspace, duration, intervals, candidate_set.spline_starts, candidate_set.max_splines
        )
        splines = found.paths
        # Sampled anew, because a path shorter than the longest one has shorter intervals than the grid.
        tracks = jax.vmap(lambda path, a: path_track(path, a, task.active, times))(splines, found.accelerations)
        cost = jnp.where(found.valid, _SPLINE_COST + found.total_turn, _INVALID)
        generator = jnp.full(candidate_set.max_splines, SPLINE)
        parts.append((generator, found.valid, cost, found.total_turn, found.speeds, tracks))
    generator, valid, cost, total_turn, speed, tracks = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)
    clearance = jax.vmap(lambda track: clearance_from_keep_outs(track, times, airspace.keep_outs))(tracks)
    penetration = jnp.sum(jnp.maximum(-clearance, 0.0), axis=-1)
    return Candidates(generator, valid, cost, total_turn, speed, tracks, penetration, routes, profiles, splines)


def _tracked(
    task: AircraftTask,
    airspace: Airspace,
    times: Array,
    routed: _Routed,
    profiles: TabulatedProfile,
    numbers: Int[Array, " profiles"] | None,  # indices of the profiles in the candidate set; None: 0, 1, 2, ...
) -> tuple[Any, ...]:
    """Return generator, validity, cost, total turn, speed and tracks (at `times`, s) of detours and turn-and-leg paths.

    A candidate that violates its limits at one of the times is returned as invalid.
    """
    samples = map_rows(lambda profile: sample_profile(profile, times), profiles)

    def track(routes: Routes, speed: Scalar) -> tuple[Track, Flag]:
        row = routes.profile if numbers is None else jnp.argmax(numbers == routes.profile)
        profile, sampled = jax.tree.map(lambda leaf: leaf[row], (profiles, samples))
        conditions = task.limits, airspace.gravity, task.active
        return route_track(routes.endpoints, routes.turns_and_legs, speed, profile, sampled, times, *conditions)

    tracks, within_limits = jax.vmap(track)(routed.routes, routed.speed)
    return routed.generator, routed.valid & within_limits, routed.cost, routed.total_turn, routed.speed, tracks


def fleet_candidates(
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],  # time to each rendezvous, s
    intervals: int,  # number of equal intervals of the paths, and of the sample times up to the last arrival
    candidate_set: CandidateSet,
    speeds: ProfileSpeeds | None = None,  # airspeeds of the profiles, leading axis aircraft; None: computed here
    selected: Bool[Array, " aircraft"] | None = None,  # aircraft that get candidates; None: all
    # number of profiles, from the first of the set on, for which candidates are generated, one profile after another;
    # candidates of the other profiles are absent. None: all profiles, as one batch
    profile_count: Integer | None = None,
) -> Candidates:
    """Generate the candidates of a fleet, one aircraft after another; candidates of unselected aircraft are absent."""
    times = jnp.max(durations) / intervals * jnp.arange(intervals + 1)

    @jax.jit  # traced once, for its shapes and for the loop
    def of_aircraft(task: AircraftTask, duration: Scalar, speeds: ProfileSpeeds | None) -> Candidates:
        generate = functools.partial(
            aircraft_candidates, task, airspace, duration, intervals, times, candidate_set, speeds
        )
        return generate() if profile_count is None else _first_profiles(generate, candidate_set, profile_count)

    rows = tasks, durations, speeds
    if selected is None:
        return jax.lax.map(lambda row: of_aircraft(*row), rows)
    shapes = jax.eval_shape(of_aircraft, *jax.tree.map(lambda leaf: leaf[0], rows))
    queue = jnp.argsort(~selected, stable=True)

    def add(k: Integer, candidates: Candidates) -> Candidates:
        aircraft = queue[k]
        added = of_aircraft(*jax.tree.map(lambda leaf: leaf[aircraft], rows))
        return jax.tree.map(lambda stored, leaf: stored.at[aircraft].set(leaf), candidates, added)

    return jax.lax.fori_loop(0, jnp.sum(selected), add, _absent(shapes, lambda shape: (*durations.shape, *shape)))


def _first_profiles(
    generate: Callable[..., Candidates], candidate_set: CandidateSet, profile_count: Integer
) -> Candidates:
    """Generate the candidates of the first `profile_count` profiles of a set; candidates of later profiles are absent.

    `generate` generates the candidates of one aircraft for the profiles with the indices `numbers`.
    """

    @jax.jit  # traced once, for its shapes and for the loop
    def of_profile(number: Integer) -> Candidates:
        return generate(numbers=number[None])

    def add(number: Integer, candidates: Candidates) -> Candidates:
        def insert(stored: Array, rows: Array) -> Array:
            return jax.lax.dynamic_update_slice_in_dim(stored, rows, number * rows.shape[0], axis=0)

        return jax.tree.map(insert, candidates, of_profile(number))

    profiles, shapes = len(candidate_set.speeds), jax.eval_shape(of_profile, profile_count)
    empty = _absent(shapes, lambda shape: (profiles * shape[0], *shape[1:]))
    return jax.lax.fori_loop(jnp.zeros_like(profile_count), profile_count, add, empty)


def _absent(shapes: Candidates, resize: Callable[[tuple[int, ...]], tuple[int, ...]]) -> Candidates:
    """Return absent candidates: zeros with the cost `ABSENT`; `resize` changes the shapes of the arrays in `shapes`."""
    absent = jax.tree.map(lambda leaf: jnp.zeros(resize(leaf.shape), leaf.dtype), shapes)
    return eqx.tree_at(lambda c: c.cost, absent, jnp.full_like(absent.cost, ABSENT))


def absent_candidates(base: Candidates, candidate_set: CandidateSet) -> Candidates:
    """Return placeholders for the candidates of `candidate_set`, for the fleet of `base`; NumPy arrays.

    The compiled choice requires the argument even if the set is not generated. The cost `ABSENT` prevents the choice.
    """
    routed, profiles, splines = candidate_set.routed_count, len(candidate_set.speeds), candidate_set.max_splines

    def resize(tree: Any, count: int) -> Any:
        return jax.tree.map(lambda leaf: np.zeros((leaf.shape[0], count, *leaf.shape[2:]), leaf.dtype), tree)

    common: Any = resize(_common_fields(base), routed + splines)
    rows, dtype = (base.cost.shape[0], splines, knot_count(base)), base.cost.dtype
    arrays: Any = np.zeros(rows, dtype), np.zeros((*rows, 3, 3), dtype), np.zeros((*rows, 3, 3), dtype)
    routes: Any = (resize(base.routes, routed), resize(base.profiles, profiles)) if routed else (None, None)
    fields: list[Any] = [*common, *routes, TimedPath(*arrays) if splines else None]
    absent = Candidates(*fields)
    return eqx.tree_at(lambda c: c.cost, absent, np.full(absent.cost.shape, ABSENT))


def knot_count(candidates: Candidates) -> int:
    """Return the number of knots of each timed path that `Candidates.paths` makes of a fleet's candidates."""
    return candidates.tracks.positions_n.shape[2] - 1 + PIECES + KINKS


def _common_fields(candidates: Candidates) -> tuple[Any, ...]:
    """Return the first seven fields of `Candidates`, which candidates of every generator have."""
    c = candidates
    return c.generator, c.valid, c.cost, c.total_turn, c.speed, c.tracks, c.penetration


def concatenate_candidates(base: Candidates, extra: Candidates) -> Candidates:
    """Append the candidates `extra` to the candidates of every aircraft in `base`; only `extra` may contain splines."""

    def joined(first: Any, second: Any) -> Any:
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=1), first, second)

    common: Any = joined(_common_fields(base), _common_fields(extra))
    routes: Any = base.routes, base.profiles
    if extra.routes is not None and base.profiles is not None:
        shifted = extra.routes._replace(profile=extra.routes.profile + base.profiles.length.shape[1])
        routes = joined(routes, (shifted, extra.profiles))
    fields: list[Any] = [*common, *routes, extra.splines]
    return Candidates(*fields)
