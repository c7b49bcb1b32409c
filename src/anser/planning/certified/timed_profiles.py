"""Candidate sets and profiles with a given duration.

Tables of the candidates to generate, the motion that a rendezvous prescribes at the arrival, and the profiles with
their radii and direct paths.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from anser.environment.environment import AbstractWind
from anser.parts.paths import polar
from anser.parts.planners import final_air_velocity
from anser.planning.certified.detours import (
    DETOUR_KINDS,
    GENTLE_BANK,
    WIDTHS,
    WORDS,
    Direct,
    direct,
    reaim,
    widen_direct,
    widen_directs,
)
from anser.planning.certified.profile import (
    CURVATURE_KEPT,
    Profile,
    TabulatedProfile,
    last_to_mean_speed,
    make_profile,
    mean_to_last_speed,
    profile_excess,
    tabulate,
    within_profile_limits,
)
from anser.planning.certified.routes import PathEndpoints
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.demand import side_force_max
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

RACETRACK = DETOUR_KINDS
# How the airspeed is chosen. One change to a speed whose mean is: as preferred; such that the direct path takes the
# time. One change, to the least or the greatest; or such that the mean is halfway from there to the preferred one. Two
# changes: slow first, then fast; fast, then slow; as it is, then fast; as it is, then slow.
PREFERRED, MATCHED, SLOWEST, FASTEST, SLOWER, FASTER, SLOW_FAST, FAST_SLOW, LATE_FAST, LATE_SLOW = range(10)


class CandidateSet(NamedTuple):
    """The candidates to look at, as tables.

    Attributes
    ----------
    speeds, altitude_detours
        One row per profile: how the airspeed is chosen, and the detour in altitude, m.
    words, detour_kinds, sides
        One row per detour: rank of the direct path by its length, which kind (`RACETRACK` after the others), side.
    turn_leg_starts
        Turn-and-leg paths are looked for per profile from so many starts.
    kept
        Only so many of these candidates of an aircraft are kept, those with the least cost; None: all.
    widened
        Whether each detour is offered with wide turns too, see `anser.planning.certified.detours`.
    rounds
        The fleet is placed so often at most: again as long as certificates turn candidates down, without these.
    spline_starts, splines_kept
        Splines of each aircraft beside these candidates: looked for from so many starts, so many of them kept.
    extra
        Candidates beside these for some aircraft only, those that find nothing among these; they take long.
    """

    speeds: tuple[int, ...]
    altitude_detours: tuple[float, ...]
    direct_ranks: tuple[int, ...]
    detour_kinds: tuple[int, ...]
    sides: tuple[int, ...]
    turn_leg_starts: int = 0
    max_candidates: int | None = None
    with_wide_turns: bool = False
    rounds: int = 1
    spline_starts: int = 0
    max_splines: int = 0
    extra: "CandidateSet | None" = None

    @property
    def size(self) -> int:
        """Number of detours and turn-and-leg paths."""
        return len(self.speeds) * (len(self.direct_ranks) * (1 + self.with_wide_turns) + self.turn_leg_starts)


def make_candidate_set(
    speeds: Sequence[int],
    altitude_detours: Sequence[float],
    direct_ranks: Sequence[int],
    detour_kinds: Sequence[int],
    turn_leg_starts: int = 0,
    max_candidates: int | None = None,
    with_wide_turns: bool = False,
    rounds: int = 1,
    splines: tuple[int, int] = (0, 0),
) -> CandidateSet:
    """Every combination of profiles and detours, to both sides, with turn-and-leg paths and splines (starts, kept)."""
    profiles = [(speed, detour) for speed in speeds for detour in altitude_detours]
    ways = [(word, kind, side) for word in direct_ranks for kind in detour_kinds for side in (1, -1)]
    speed_column, altitude_column = zip(*profiles, strict=True)
    word_column, kind_column, side_column = zip(*ways, strict=True)
    columns = (speed_column, altitude_column, word_column, kind_column, side_column)
    return CandidateSet(*columns, turn_leg_starts, max_candidates, with_wide_turns, rounds, *splines)


_EVERY_SPEED = tuple(range(10))
_TURN_LEG_PATHS = make_candidate_set(
    _EVERY_SPEED,
    (0.0, 300.0, -300.0, 600.0, -600.0),
    (0, 1),
    (0, 1, 2, 3, 4, RACETRACK),
    turn_leg_starts=40,
    max_candidates=320,
)
_SPLINES = make_candidate_set((PREFERRED,), (0.0,), (0,), (0,), splines=(48, 12))

MINIMAL = make_candidate_set((PREFERRED,), (0.0,), (0,), (0, 1, 2, 3, 4), with_wide_turns=True)
STANDARD = make_candidate_set(
    (PREFERRED, MATCHED), (0.0, 300.0, -300.0), (0,), (0, 1, 2, 3, 4, RACETRACK), with_wide_turns=True, rounds=4
)
WITH_TURN_LEG_PATHS = STANDARD._replace(rounds=8, extra=_TURN_LEG_PATHS)
"""And, for aircraft that need them, every speed, altitude and detour, and turn-and-leg paths."""
WITH_SPLINES = STANDARD._replace(rounds=8, extra=_SPLINES)
"""And, for aircraft that need them, splines."""
ALONE_STANDARD = make_candidate_set((PREFERRED, MATCHED, SLOWEST, FASTEST), (0.0,), (0, 1), (0, 1, 4, RACETRACK))
"""Candidates of an aircraft by itself: detours and speeds, no detour in altitude."""
ALONE_TURN_LEG_PATHS = make_candidate_set(_EVERY_SPEED, (0.0,), (0,), (0, 1), turn_leg_starts=24, max_candidates=48)
ALONE_SPLINES = make_candidate_set((PREFERRED,), (0.0,), (0,), (0,), splines=(32, 4))
"""Before an aircraft is said to have no way at all."""


_LEVEL_MIN = 1.0  # m/s: keeps the horizontal airspeed of a vertical arrival finite; such an arrival is not attainable


class ArrivalMotion(eqx.Module):
    """Motion at the arrival.

    Attributes
    ----------
    climb
        Vertical speed over the ground, up positive, m/s: that of the prescribed path angle, else the goal's.
    heading
        Of the velocity through the air, rad; where it is free, that along the straight line over the ground.
    heading_free
        Whether any heading will do.
    attainable
        Whether what is prescribed can be flown at this airspeed in this wind.
    """

    climb: Scalar
    heading: Scalar
    heading_free: Flag
    attainable: Flag


def arrival_motion(task: AircraftTask, wind: AbstractWind, duration: ScalarLike, speed: ScalarLike) -> ArrivalMotion:
    """Motion at the arrival after a duration (s) at an airspeed (m/s).

    In wind the climb rate of a prescribed path angle depends on the course over the ground. Where no course is
    prescribed with it, it is that of the straight line from here to the rendezvous, as seen from the ground.
    """
    rendezvous = task.rendezvous
    meeting = task.meeting_n(duration)
    line = (meeting - task.position_n) * jnp.array([1.0, 1.0, 0.0])
    blowing = wind.at(jnp.stack([jnp.zeros(()), jnp.zeros(()), meeting[2]]), duration)
    steep = rendezvous.path_angle_prescribed
    windy = jnp.any(blowing[:2] != 0.0)
    asked = eqx.tree_at(
        lambda r: (r.course, r.course_prescribed),
        rendezvous,
        (
            jnp.where(rendezvous.course_prescribed, rendezvous.course, polar(line, jnp.zeros(3)).chi),
            rendezvous.course_prescribed | (steep & windy),
        ),
    )
    # Without a prescribed angle the aircraft climbs as its goal does, which takes part of the airspeed.
    through = task.goal_velocity_n[2] - blowing[2]
    square = speed**2 - through**2
    level = jnp.sqrt(jnp.maximum(square, _LEVEL_MIN**2))
    flat = blowing * jnp.array([1.0, 1.0, 0.0])
    air, attainable = final_air_velocity(asked, line, jnp.where(steep, speed, level), jnp.where(steep, blowing, flat))
    return ArrivalMotion(
        climb=jnp.where(steep, -(air + blowing)[2], -task.goal_velocity_n[2]),
        heading=polar(air, jnp.zeros(3)).chi,
        heading_free=~asked.course_prescribed,
        attainable=attainable & (steep | (square > _LEVEL_MIN**2)),
    )


def climb_acceleration(task: AircraftTask, wind: AbstractWind) -> Scalar:
    """Rate of the first vertical speed over the ground, up positive, m/s^2: the wind's share included."""
    velocity_n = task.air_velocity_n + wind.at(task.position_n, 0.0)
    _, wind_dot_n = jax.jvp(lambda p: wind.at(p, 0.0), (task.position_n,), (velocity_n,))
    return -task.air_acceleration_n[2] - wind_dot_n[2]


_SPEED_ROUNDS = 4
_EXACT_ROUNDS, _LENGTH_TOLERANCE = 4, 3e-7  # until a profile is as long as its direct path, to a part of the length
_SPEED_FACTOR_MAX, _SPEED_FACTOR_MIN = (
    1.01,
    0.999,
)  # times the preferred airspeed: so much it gives way for a direct path of wide turns
_GAIN, _LOSS = 0.8, 1.6  # m/s^2
_RATE_KEPT = 0.6  # part of the acceleration along the path that a change of airspeed may take


def _plane(vector_n: Vector3) -> Array:
    return vector_n[0] + 1j * vector_n[1]


def curvature_limits(task: AircraftTask, gravity: ScalarLike, profile: Profile) -> tuple[Scalar, Scalar]:
    """Greatest curvature (1/m) of a path flown by a profile, and its greatest rate along the path (1/m^2).

    One curvature for the whole path: that of the greatest airspeed, the steepest climb and the strongest push-over.
    """
    limits = task.limits
    speed = profile.speed_max
    climb, climb_dot = profile.climb_bounds
    slowest = profile.speed_min
    cosine = jnp.sqrt(1.0 - jnp.minimum(climb / jnp.maximum(slowest, 1.0), 0.9) ** 2)
    lift_least = cosine * gravity - climb_dot
    side = side_force_max(lift_least, gravity + climb_dot, limits, gravity)
    curvature = CURVATURE_KEPT * side / speed**2
    ramp_s = jnp.arctan(curvature * speed**2 / gravity) / task.roll_rate_max
    if limits.bank_rate_max is not None:
        # The tangent of the bank angle rises steadily: the angle does fastest while the wings are level.
        ramp_s = jnp.maximum(ramp_s, CURVATURE_KEPT * side / (jnp.maximum(lift_least, 1.0) * limits.bank_rate_max))
    return curvature, curvature / (speed * ramp_s)


def speed_rates(task: AircraftTask) -> tuple[Scalar, Scalar]:
    """Greatest rates at which a profile gains and loses airspeed, m/s^2: the rest is left to climb and descent."""
    limits = task.limits
    return jnp.minimum(_GAIN, _RATE_KEPT * limits.acceleration_max), jnp.minimum(
        _LOSS, _RATE_KEPT * limits.deceleration_max
    )


def _speed_0(task: AircraftTask) -> Scalar:
    return jnp.sqrt(jnp.sum(task.air_velocity_n**2))


def speeds_for_mean(task: AircraftTask, duration: ScalarLike, mean: ScalarLike) -> tuple[Scalar, Scalar]:
    """The airspeed in the middle and the last one, equal, that make a mean airspeed (m/s)."""
    last = mean_to_last_speed(mean, _speed_0(task), duration, speed_rates(task))
    return last, last


def _profile(
    task: AircraftTask, airspace: Airspace, duration: Scalar, speeds: tuple[Scalar, Scalar], altitude_detour: ScalarLike
) -> tuple[Profile, ArrivalMotion]:
    begin = task.position_n
    end_down = task.meeting_n(duration)[2]
    wind_0 = airspace.wind.at(begin, 0.0)
    arrival = arrival_motion(task, airspace.wind, duration, speeds[1])
    speed_0 = _speed_0(task)
    speed_dot = jnp.sum(task.air_velocity_n * task.air_acceleration_n) / jnp.maximum(speed_0, 1.0)
    profile = make_profile(
        duration,
        (-begin[2], -end_down),
        (-task.air_velocity_n[2] - wind_0[2], arrival.climb),
        climb_acceleration(task, airspace.wind),
        altitude_detour,
        (speed_0, *speeds),
        speed_dot,
        speed_rates(task),
    )
    return profile, arrival


def _path_endpoints(
    task: AircraftTask, airspace: Airspace, table: TabulatedProfile, arrival: ArrivalMotion
) -> PathEndpoints:
    """What the horizontal path joins in the frame that drifts with the air, at a tabulated profile."""
    duration, profile = table.profile.duration, table.profile
    velocity, acceleration = task.air_velocity_n, task.air_acceleration_n
    end = task.meeting_n(duration) - table.drift_n
    level = jnp.maximum(jnp.sum(velocity[:2] ** 2), 1.0)
    curvature = (velocity[0] * acceleration[1] - velocity[1] * acceleration[0]) / level**1.5
    curvature_max, sharpness = curvature_limits(task, airspace.gravity, profile)
    gentle = jnp.tan(GENTLE_BANK) * airspace.gravity / profile.speed_max**2
    return PathEndpoints(
        start=_plane(task.position_n),
        heading=jnp.arctan2(velocity[1], velocity[0]),
        curvature=curvature,
        end=_plane(end),
        end_heading=arrival.heading,
        end_free=arrival.heading_free,
        curvature_max=curvature_max,
        sharpness=sharpness,
        scale_max=jnp.maximum(curvature_max / gentle, 1.0),
    )


def direct_paths(endpoints: PathEndpoints) -> Direct:
    """The four direct paths, the shortest first."""
    found = jax.vmap(lambda word: direct(endpoints, word))(jnp.asarray(WORDS))
    order = jnp.argsort(found.length)
    return jax.tree.map(lambda leaf: leaf[order], found)


class TimedProfile(eqx.Module):
    """A profile with what follows from it alone."""

    table: TabulatedProfile
    endpoints: PathEndpoints
    direct: Direct
    """Four, the shortest first."""
    wide_directs: Direct
    """The same with wider turns: (word, width)."""
    speed: Scalar
    within_limits: Flag


def timed_profile(
    task: AircraftTask,
    airspace: Airspace,
    duration: Scalar,
    intervals: int,
    altitude_detour: Scalar,
    speeds: tuple[Scalar, Scalar],
) -> TimedProfile:
    """Profile of given airspeeds in the middle and at the end, with its direct paths at the radii that go with them."""
    profile, arrival = _profile(task, airspace, duration, speeds, altitude_detour)
    table = tabulate(profile, airspace.wind, intervals)
    ends = _path_endpoints(task, airspace, table, arrival)
    excess = profile_excess(table, task.limits, airspace.gravity)
    words = direct_paths(ends)
    wide = jax.vmap(widen_directs, in_axes=(None, 0))(ends, words)
    return TimedProfile(
        table, ends, words, wide, profile.speed_mean, within_profile_limits(excess) & arrival.attainable
    )


def _match_direct_length(
    task: AircraftTask, airspace: Airspace, timed: TimedProfile, mean: Scalar, widened_too: bool
) -> tuple[Scalar, Flag]:
    """The mean airspeed (m/s) at which the shortest direct path takes the time, and whether that is so.

    Of a profile of nearly that speed. The path is the one with the widest turns that is not longer by more than
    `_FASTER`.
    """
    duration, intervals = timed.table.profile.duration, timed.table.lengths.shape[0] - 1
    words, wide = jax.tree.map(lambda leaf: leaf[0], (timed.direct, timed.wide_directs))
    fits = wide.exists & (wide.length <= _SPEED_FACTOR_MAX * timed.table.length) & widened_too
    width = jnp.where(jnp.any(fits), jnp.array(WIDTHS)[jnp.argmax(fits)], 0.0)

    def longer_by(mean: Scalar) -> Scalar:
        """By what part of it the direct path is longer than the profile's."""
        profile, arrival = _profile(task, airspace, duration, speeds_for_mean(task, duration, mean), 0.0)
        table = tabulate(profile, airspace.wind, intervals)
        ends = _path_endpoints(task, airspace, table, arrival)
        return widen_direct(ends, reaim(ends, words, jnp.ones(2)), width).length / table.length - 1.0

    def closer(_: object, carry: tuple[Scalar, Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        before, now, off_before, off = carry
        gap = off - off_before
        found = jnp.where(gap == 0.0, now, now - off * (now - before) / jnp.where(gap == 0.0, 1.0, gap))
        found = jnp.clip(found, 0.9 * mean, 1.1 * mean)
        return now, found, off, longer_by(found)

    off = longer_by(mean)
    first = jnp.clip(mean * (1.0 + off), 0.9 * mean, 1.1 * mean)
    _, found, _, left = jax.lax.fori_loop(0, _EXACT_ROUNDS, closer, (mean, first, off, longer_by(first)))
    return found, jnp.abs(left) <= _LENGTH_TOLERANCE


def timed_profiles(
    task: AircraftTask, airspace: Airspace, duration: Scalar, intervals: int, candidate_set: CandidateSet
) -> TimedProfile:
    """All profiles of a candidate set, stacked."""
    kinds = tuple(dict.fromkeys(candidate_set.speeds))
    limits, preferred = task.limits, task.speed
    low, high = 1.002 * limits.speed_min, 0.998 * limits.speed_max
    speed_0, rates = _speed_0(task), speed_rates(task)

    slowest, fastest = (last_to_mean_speed(last, speed_0, duration, rates) for last in (low, high))
    now = jnp.clip(speed_0, low, high)
    wished = jnp.clip(preferred, low, high)

    def closer(_: object, mean: Scalar) -> Scalar:
        speeds = speeds_for_mean(task, duration, mean)
        timed = timed_profile(task, airspace, duration, intervals, jnp.zeros(()), speeds)
        wanted = jnp.where(timed.direct.exists[0], timed.direct.length[0], timed.table.length)
        # The radii grow with the speed: left to itself a path that is too long would be flown ever faster.
        return jnp.clip(mean * wanted / jnp.maximum(timed.table.length, 1.0), slowest, fastest)

    def exactly(mean: Scalar, otherwise: Scalar) -> Scalar:
        """A mean airspeed (m/s) at which the direct path takes the time, if it is near one, or else another."""
        begun = timed_profile(task, airspace, duration, intervals, jnp.zeros(()), speeds_for_mean(task, duration, mean))
        found, met = _match_direct_length(task, airspace, begun, mean, candidate_set.with_wide_turns)
        near = (found <= jnp.minimum(_SPEED_FACTOR_MAX * mean, high)) & (
            found >= jnp.maximum(_SPEED_FACTOR_MIN * mean, low)
        )
        return jnp.where(met & near, found, otherwise)

    matched = preferred
    if MATCHED in kinds:
        nearly = jax.lax.fori_loop(0, _SPEED_ROUNDS, closer, preferred)
        # Slightly faster: a path longer than the direct one by less than this is a detour, a shorter one is none.
        matched = exactly(nearly, (1.0 + 2e-4) * nearly)
    means = {
        PREFERRED: exactly(wished, wished),
        MATCHED: matched,
        SLOWER: 0.5 * (wished + slowest),
        FASTER: 0.5 * (wished + fastest),
    }
    speeds = {kind: speeds_for_mean(task, duration, mean) for kind, mean in means.items()} | {
        SLOWEST: (low, low),
        FASTEST: (high, high),
        SLOW_FAST: (low, high),
        FAST_SLOW: (high, low),
        LATE_FAST: (now, high),
        LATE_SLOW: (now, low),
    }
    altitude_detours = jnp.asarray(candidate_set.altitude_detours)
    middle, last = (jnp.stack([speeds[kind][k] for kind in candidate_set.speeds]) for k in range(2))
    one = functools.partial(timed_profile, task, airspace, duration, intervals)
    return jax.vmap(lambda detour, *two: one(detour, two))(altitude_detours, middle, last)
