"""Candidates: all paths by which an aircraft can be at its rendezvous at a given time.

From three generators, and their delivery as timed paths.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import select_rows
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
from anser.planning.certified.profile import TabulatedProfile, flown_between
from anser.planning.certified.routes import PathEndpoints, Route, TurnsAndLegs, cis, route
from anser.planning.certified.spline_search import find_splines
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.timed_profiles import RACETRACK, CandidateSet, TimedProfile, timed_profiles
from anser.planning.certified.turn_leg_paths import (
    TurnLegProblem,
    keep_outs_along_path,
    make_radius_schedule,
    make_starts,
    solve_turn_leg_paths,
)
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3

_CLOSE_S = 0.02  # knots closer than this become one: differences of positions keep their digits in the accelerations


def _knots(marks: Float[Array, " marks"], duration: Scalar, intervals: int) -> Float[Array, " knots"]:
    """Equal intervals and the given times (s), in order, none closer than `_CLOSE_S` unless equal."""
    even = duration * jnp.linspace(0.0, 1.0, intervals + 1)
    times = jnp.sort(jnp.concatenate([even, jnp.clip(marks, 0.0, duration)]))
    times = jnp.where(duration - times < _CLOSE_S, duration, times)

    def merge(last: Scalar, time: Scalar) -> tuple[Scalar, Scalar]:
        now = jnp.where(time - last < _CLOSE_S, last, time)
        return now, now

    return jax.lax.scan(merge, jnp.zeros(()), times)[1]


def deliver(start_time: ScalarLike, table: TabulatedProfile, horizontal: Route) -> TimedPath:
    """Path from a time (s) on, with knots at equal intervals and wherever curvature, climb or speed has a kink.

    The table's length is the route's to a part in a million, which the airspeed takes up.
    """
    duration = table.profile.duration
    marks = jax.vmap(table.time_at)(horizontal.marks[1:-1] * (table.length / jnp.maximum(horizontal.length, 1.0)))
    times = _knots(jnp.concatenate([marks, table.profile.kinks]), duration, table.lengths.shape[0] - 1)
    # From knot to knot, where nothing kinks: the table's lengths are a little off where a kink lies within an interval,
    # and in a cell of some hundredths of a second a tenth of a millimetre is an acceleration of 1 m/s^2.
    flown, drifted = jax.vmap(lambda begin, span: flown_between(table.profile, table.wind, begin, span))(
        times[:-1], times[1:] - times[:-1]
    )
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(flown)])
    drifts = jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(drifted, axis=0)])
    # It ends where it was to end: the table's drift has led there.
    astray = (table.drift_n - drifts[-1]) / duration
    scale = horizontal.length / jnp.maximum(lengths[-1], 1.0)

    def one(t: Scalar, length: Scalar, drift: Vector3) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
        (speed, wind), (speed_dot, wind_dot) = jax.jvp(table.rates, (t,), (jnp.ones_like(t),))
        place, heading, curvature = horizontal.at(scale * length)
        drift, wind = drift + t * astray, wind + astray
        now = table.profile.at(t)
        ahead = cis(heading)
        rate, bend = scale * speed * ahead, (scale * speed_dot + 1j * curvature * (scale * speed) ** 2) * ahead
        level = [jnp.stack([jnp.real(x), jnp.imag(x)]) for x in (place, rate, bend)]
        down = (-now.altitude - drift[2], -now.climb - wind[2], -now.climb_dot - wind_dot[2])
        air = jnp.stack([jnp.append(x, z) for x, z in zip(level, down, strict=True)])
        return air, jnp.stack([drift, wind, wind_dot])

    air_n, drift_n = jax.vmap(one)(times, lengths, drifts)
    return TimedPath(start_time + times, air_n, drift_n)


DETOUR, TURN_LEG_PATH, SPLINE = range(3)
_PART_REFINED = 0.4  # of the starts of turn-and-leg paths
_RACETRACK_COST, _TURN_LEG_COST, _SPLINE_COST = 2.0, 3.0, 6.0  # of unusual paths
_BANK_COST = 1.0  # of each radian of the greatest bank angle
_INVALID, _NOT_SEARCHED = 1e6, 1e9


class Routes(NamedTuple):
    """Turns and legs of candidates, which make a path together with a profile.

    Attributes
    ----------
    ends, turns_and_legs
        What each joins, and by what.
    profile
        Index of its profile.
    """

    endpoints: PathEndpoints
    turns_and_legs: TurnsAndLegs
    profile: Count


class Candidates(eqx.Module):
    """What a fleet can choose from: (aircraft, candidate), splines last; of one aircraft: (candidate).

    Attributes
    ----------
    generator
        Where each comes from: `DETOUR`, `TURN_LEG_PATH` or `SPLINE`.
    valid
        Whether it exists within the limits of its aircraft.
    cost
        How little it is preferred.
    turned, speed
        Sum of the sizes of its turns, rad, and its mean airspeed, m/s.
    tracks
        Where it is at the instants of the fleet's clock.
    penetration
        How far it goes into keep-outs, m.
    routes
        Of all but the splines.
    profiles
        Altitude and airspeed by time, by index of the profile: (aircraft, profile).
    splines
        Paths of the splines, from time 0 on; None where none were looked for.
    """

    generator: Int[Array, "*aircraft candidates"]
    valid: Bool[Array, "*aircraft candidates"]
    cost: Float[Array, "*aircraft candidates"]
    total_turn: Float[Array, "*aircraft candidates"]
    speed: Float[Array, "*aircraft candidates"]
    tracks: Track
    penetration: Float[Array, "*aircraft candidates"]
    routes: Routes
    profiles: TabulatedProfile
    splines: TimedPath | None

    def paths(self, start_time: ScalarLike, chosen: Int[Array, " aircraft"]) -> TimedPath:
        """The path of one candidate of each aircraft of a fleet, from a time (s) on."""
        fleet, routed = jnp.arange(chosen.shape[0]), self.routes.profile.shape[1]
        own = jax.tree.map(lambda leaf: leaf[fleet, jnp.minimum(chosen, routed - 1)], self.routes)
        profiles = jax.tree.map(lambda leaf: leaf[fleet, own.profile], self.profiles)
        routes = jax.vmap(route)(own.endpoints, own.turns_and_legs)
        paths = jax.vmap(deliver, in_axes=(None, 0, 0))(start_time, profiles, routes)
        if self.splines is None:
            return paths
        splines = jax.tree.map(lambda leaf: leaf[fleet, jnp.maximum(chosen - routed, 0)], self.splines)
        splines = eqx.tree_at(lambda p: p.times, splines, start_time + splines.times)
        return select_rows(chosen >= routed, splines, paths)


class _Routed(NamedTuple):
    """Candidates of turns and legs; fields as of `Candidates`."""

    generator: Count
    valid: Flag
    cost: Scalar
    total_turn: Scalar
    speed: Scalar
    routes: Routes


def _routed_candidate(
    generator: int,
    timed: TimedProfile,
    gravity: ScalarLike,
    solved: TurnsAndLegs,
    fits: Flag,
    cost: Scalar,
    profile: Count,
) -> _Routed:
    valid = timed.within_limits & solved.exists & fits & jnp.isfinite(timed.table.length)
    turned = jnp.sum(jnp.abs(solved.angles))
    cost = cost + _BANK_COST * jnp.arctan(greatest_curvature(timed.endpoints, solved) * timed.speed**2 / gravity)
    routes = Routes(timed.endpoints, solved, profile)
    return _Routed(jnp.asarray(generator), valid, turned + cost, turned, timed.speed, routes)


def routed_candidates(
    task: AircraftTask, airspace: Airspace, duration: ScalarLike, intervals: int, candidate_set: CandidateSet
) -> tuple[_Routed, TabulatedProfile]:
    """Detours and turn-and-leg paths of one aircraft for a duration (s), and their profiles; stacked."""
    duration = jnp.asarray(duration, dtype=float)
    timed = timed_profiles(task, airspace, duration, intervals, candidate_set)
    numbers = jnp.arange(len(candidate_set.speeds))
    detours = functools.partial(_detours, task, airspace.gravity, candidate_set)
    each_way = jax.vmap(detours, in_axes=(None, None, 0, 0, 0))
    tables = candidate_set.direct_ranks, candidate_set.detour_kinds, candidate_set.sides
    altitude_detours = jnp.asarray(candidate_set.altitude_detours)
    costs = jnp.abs(timed.speed / task.speed - 1.0) * 20.0 + jnp.abs(altitude_detours) / 400.0
    found = jax.vmap(each_way, in_axes=(0, 0, None, None, None))(timed, (costs, numbers), *map(jnp.asarray, tables))
    found = jax.tree.map(lambda leaf: leaf.reshape(leaf.shape[0], -1, *leaf.shape[3:]), found)
    if candidate_set.turn_leg_starts:
        free = jax.vmap(functools.partial(_turn_leg_paths, task, airspace, candidate_set.turn_leg_starts))(
            timed, (costs, numbers)
        )
        found = jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=1), found, free)
    flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), found)
    if candidate_set.max_candidates is not None and candidate_set.max_candidates < candidate_set.size:
        best = jnp.argsort(jnp.where(flat.valid, flat.cost, jnp.inf))[: candidate_set.max_candidates]
        flat = jax.tree.map(lambda leaf: leaf[best], flat)
    return flat, timed.table


def _detours(
    task: AircraftTask,
    gravity: Scalar,
    candidate_set: CandidateSet,
    timed: TimedProfile,
    about: tuple[Scalar, Count],
    word: Count,
    kind: Count,
    side: Count,
) -> _Routed:
    """The direct path of a rank by length, or the detour from it that takes the time; the tightest, the widest."""
    ends, wanted = timed.endpoints, timed.table.length
    base, wide = jax.tree.map(lambda leaf: leaf[word], (timed.direct, timed.wide_directs))
    way, around = detour(jnp.minimum(kind, DETOUR_KINDS - 1), side), side.astype(float)
    solved = [solve_detour(ends, base, way, wanted)]
    if candidate_set.with_wide_turns:
        solved.append(widen_detour(ends, wide, way, wanted, solved[0]))
    if RACETRACK in candidate_set.detour_kinds:
        held = [solve_racetrack(ends, base, around, wanted)]
        if candidate_set.with_wide_turns:
            held.append(widen_racetrack(ends, wide, around, wanted, held[0]))
        solved = jax.tree.map(lambda a, b: jnp.where(kind == RACETRACK, a, b), held, solved)
    fits = (task.side == 0) | (task.side * side > 0)
    cost, profile = about
    cost = cost + jnp.where(kind == RACETRACK, _RACETRACK_COST, 0.0) + 0.01 * kind
    each = [_routed_candidate(DETOUR, timed, gravity, one, fits, cost, profile) for one in solved]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)


def _turn_leg_paths(
    task: AircraftTask, airspace: Airspace, starts: int, timed: TimedProfile, about: tuple[Scalar, Count]
) -> _Routed:
    """Turn-and-leg paths that take the time; they bend to any side, so only where either will do."""
    schedule = make_radius_schedule(timed.table, timed.endpoints, task.limits, airspace.gravity)
    keep_outs = keep_outs_along_path(timed.table, airspace.keep_outs)
    problem = TurnLegProblem(timed.endpoints, schedule, keep_outs, timed.table.length)
    solved = solve_turn_leg_paths(problem, make_starts(starts), int(_PART_REFINED * starts))
    cost, profile = about
    cost, fits = cost + _TURN_LEG_COST, task.side == 0
    return jax.vmap(lambda one: _routed_candidate(TURN_LEG_PATH, timed, airspace.gravity, one, fits, cost, profile))(
        solved
    )


def _aircraft_candidates(
    airspace: Airspace,
    intervals: int,
    times: Float[Array, " instants"],
    candidate_set: CandidateSet,
    task: AircraftTask,
    duration: Scalar,
) -> Candidates:
    """The candidates of one aircraft."""
    found, profiles = routed_candidates(task, airspace, duration, intervals, candidate_set)
    samples = jax.vmap(lambda profile: sample_profile(profile, times))(profiles)

    def tracked(one: Routes, speed: Scalar) -> tuple[Track, Flag]:
        profile, sampled = jax.tree.map(lambda leaf: leaf[one.profile], (profiles, samples))
        about = task.limits, airspace.gravity, task.active
        return route_track(one.endpoints, one.turns_and_legs, speed, profile, sampled, times, *about)

    tracks, within_limits = jax.vmap(tracked)(found.routes, found.speed)
    common = (found.generator, found.valid & within_limits, found.cost, found.total_turn, found.speed, tracks)
    paths = None
    if candidate_set.spline_starts:
        starts, kept = candidate_set.spline_starts, candidate_set.max_splines
        splines = find_splines(task, airspace, duration, intervals, starts, kept)
        paths = splines.paths
        # A path that ends before the last one has shorter intervals than the grid.
        own = jax.vmap(lambda path, a: path_track(path, a, task.active, times))(paths, splines.accelerations)
        cost = jnp.where(splines.valid, _SPLINE_COST + splines.total_turn, _INVALID)
        more = (jnp.full(kept, SPLINE), splines.valid, cost, splines.total_turn, splines.speeds, own)
        common = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), common, more)
    generator, valid, cost, turned, speed, tracks = common
    clearance = jax.vmap(lambda one: clearance_from_keep_outs(one, times, airspace.keep_outs))(tracks)
    penetration = jnp.sum(jnp.maximum(-clearance, 0.0), axis=-1)
    return Candidates(generator, valid, cost, turned, speed, tracks, penetration, found.routes, profiles, paths)


def fleet_candidates(
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    intervals: int,
    instants: int,
    candidate_set: CandidateSet,
    extra_for: Bool[Array, " aircraft"] | None = None,
) -> Candidates:
    """All candidates of a fleet, with their tracks on one grid of instants up to the last arrival.

    Parameters
    ----------
    durations
        Time to each rendezvous, s.
    intervals, instants
        Even intervals of the paths and of the grid.
    extra_for
        Aircraft for which `candidate_set.extra` is looked at too; None: all that are active.
    """
    times = jnp.max(durations) / instants * jnp.arange(instants + 1)

    def one_of(some: CandidateSet) -> Callable[[AircraftTask, Scalar], Candidates]:
        return functools.partial(_aircraft_candidates, airspace, intervals, times, some)

    found = jax.vmap(one_of(candidate_set))(tasks, durations)
    if candidate_set.extra is None:
        return found
    wanted = tasks.active > 0.0 if extra_for is None else extra_for
    return _concatenate_candidates(
        found, _candidates_for_selected(jax.jit(one_of(candidate_set.extra)), tasks, durations, wanted)
    )


def _candidates_for_selected(
    one: Callable[[AircraftTask, Scalar], Candidates],
    tasks: AircraftTask,
    durations: Float[Array, " aircraft"],
    wanted: Bool[Array, " aircraft"],
) -> Candidates:
    """Candidates of some aircraft, one after the other, so that the others cost nothing; they have none."""
    first = jax.tree.map(lambda leaf: leaf[0], (tasks, durations))
    fleet = wanted.shape[0]
    empty = jax.tree.map(lambda leaf: jnp.zeros((fleet, *leaf.shape), leaf.dtype), jax.eval_shape(one, *first))
    # What was not looked for is no path: it is not chosen even where nothing is valid.
    empty = eqx.tree_at(lambda o: o.cost, empty, jnp.full_like(empty.cost, _NOT_SEARCHED))
    queue = jnp.argsort(~wanted, stable=True)

    def add(k: Count, found: Candidates) -> Candidates:
        own = one(*jax.tree.map(lambda leaf: leaf[queue[k]], (tasks, durations)))
        return jax.tree.map(lambda all_, leaf: all_.at[queue[k]].set(leaf), found, own)

    return jax.lax.fori_loop(0, jnp.sum(wanted), add, empty)


def _concatenate_candidates(first: Candidates, extra: Candidates) -> Candidates:
    """Two sets of candidates of each aircraft as one; there are splines in the second only."""
    later = eqx.tree_at(lambda c: c.routes.profile, extra, extra.routes.profile + first.profiles.length.shape[1])
    routed = eqx.tree_at(lambda c: c.splines, later, None)
    both = jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=1), first, routed)
    return eqx.tree_at(lambda c: c.splines, both, extra.splines, is_leaf=lambda leaf: leaf is None)
