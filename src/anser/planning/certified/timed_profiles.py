"""Candidate sets, and profiles of altitude and airspeed that last a required duration."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.environment.environment import AbstractWind
from anser.numerics.arrays import map_rows, zeros_like_result
from anser.parts.paths import polar
from anser.parts.planners import final_air_velocity
from anser.planning.certified.detours import (
    DETOUR_KINDS,
    GENTLE_BANK,
    WIDTHS,
    WORDS,
    DirectPath,
    direct_path,
    reaim,
    widen_direct,
    widen_directs,
)
from anser.planning.certified.profile import (
    CURVATURE_FRACTION,
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
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3

RACETRACK = DETOUR_KINDS
# Choices of the airspeed.
# One change of airspeed:
#   PREFERRED  the mean is the preferred airspeed
#   MATCHED    the direct path takes the required duration
#   SLOWEST    the final airspeed is the least; FASTEST: the greatest
#   SLOWER     the mean is halfway between the preferred airspeed and the mean of SLOWEST; FASTER: of FASTEST
# Two changes: SLOW_FAST, FAST_SLOW; LATE_FAST and LATE_SLOW: first unchanged, then fast or slow
PREFERRED, MATCHED, SLOWEST, FASTEST, SLOWER, FASTER, SLOW_FAST, FAST_SLOW, LATE_FAST, LATE_SLOW = range(10)


class CandidateSet(NamedTuple):
    """Selection of the candidates that are generated for each aircraft: profiles, and detours for each profile.

    Profile k is (`speeds[k]`, `altitude_detours[k]`). Detour k is (`direct_ranks[k]`, `detour_kinds[k]`, `sides[k]`),
    and is generated for each profile.
    """

    speeds: tuple[int, ...]  # choices of the airspeed: `PREFERRED`, ..., `LATE_SLOW`
    altitude_detours: tuple[float, ...]  # greatest additional altitudes, m
    direct_ranks: tuple[int, ...]  # ranks of the direct paths by length; 0: the shortest
    detour_kinds: tuple[int, ...]  # see `detour`; or `RACETRACK`
    sides: tuple[int, ...]  # 1 right, -1 left
    turn_leg_starts: int = 0  # number of initial guesses of the search for turn-and-leg paths, per profile
    # greatest number of detours and turn-and-leg paths per aircraft, the cheapest; None: no limit
    max_candidates: int | None = None
    # whether each detour is also generated with wide turns, see `anser.planning.certified.detours`
    with_wide_turns: bool = False
    rounds: int = 1  # greatest number of rounds in which the fleet chooses its candidates, see `_choose_best_placement`
    # number of initial guesses of the search for splines, and number of splines in the result, per aircraft
    spline_starts: int = 0
    max_splines: int = 0
    # further candidates, slower to generate, for aircraft without a feasible candidate in this set; None: none
    extra: "CandidateSet | None" = None

    @property
    def size(self) -> int:
        """Number of generated detours and turn-and-leg paths per aircraft."""
        return len(self.speeds) * (len(self.direct_ranks) * (1 + self.with_wide_turns) + self.turn_leg_starts)

    @property
    def routed_count(self) -> int:
        """Number of detours and turn-and-leg paths per aircraft after the selection of the cheapest."""
        return self.size if self.max_candidates is None else min(self.size, self.max_candidates)

    def leading_profiles(self, smaller: "CandidateSet") -> int:
        """Return the least n for which the first n profiles of this set include every profile of a smaller set."""
        profiles = list(zip(self.speeds, self.altitude_detours, strict=True))
        return 1 + max(
            profiles.index(profile) for profile in zip(smaller.speeds, smaller.altitude_detours, strict=True)
        )

    @property
    def with_matched(self) -> bool:
        """Whether the set has a profile with the airspeed `MATCHED`, at which the direct path takes the duration."""
        return MATCHED in self.speeds

    def members_of(self, smaller: "CandidateSet") -> Bool[np.ndarray, " candidates"]:
        """Return the mask of this set's candidates that a smaller set contains, too; for two sets of detours only."""
        profiles = set(zip(smaller.speeds, smaller.altitude_detours, strict=True))
        detours = set(zip(smaller.direct_ranks, smaller.detour_kinds, smaller.sides, strict=True))
        has_profile = [pair in profiles for pair in zip(self.speeds, self.altitude_detours, strict=True)]
        has_detour = [row in detours for row in zip(self.direct_ranks, self.detour_kinds, self.sides, strict=True)]
        return np.kron(np.kron(has_profile, has_detour), [True] * (1 + self.with_wide_turns)).astype(bool)


def make_candidate_set(
    speeds: Sequence[int],
    altitude_detours: Sequence[float],
    direct_ranks: Sequence[int],
    detour_kinds: Sequence[int],
    turn_leg_starts: int = 0,
    max_candidates: int | None = None,
    with_wide_turns: bool = False,
    rounds: int = 1,
) -> CandidateSet:
    """Build a candidate set of all combinations.

    Profiles are pairs (airspeed, altitude detour); detours are triples (rank of direct path, kind of detour, side).
    """
    profiles = [(speed, detour) for speed in speeds for detour in altitude_detours]
    detours = [(word, kind, side) for word in direct_ranks for kind in detour_kinds for side in (1, -1)]
    speed_column, altitude_column = zip(*profiles, strict=True)
    word_column, kind_column, side_column = zip(*detours, strict=True)
    columns = (speed_column, altitude_column, word_column, kind_column, side_column)
    return CandidateSet(*columns, turn_leg_starts, max_candidates, with_wide_turns, rounds)


_EVERY_SPEED = tuple(range(10))
_TURN_LEG_PATHS = make_candidate_set(
    _EVERY_SPEED,
    (0.0, 300.0, -300.0, 600.0, -600.0),
    (0, 1),
    (0, 1, 2, 3, 4, RACETRACK),
    turn_leg_starts=40,
    max_candidates=320,
)
_SPLINES = CandidateSet((), (), (), (), (), spline_starts=48, max_splines=12)
EXTRA_SETS = (_TURN_LEG_PATHS, _SPLINES)
"""Candidate sets for aircraft without a feasible standard candidate: turn-and-leg paths; splines."""

MINIMAL = make_candidate_set((PREFERRED,), (0.0,), (0,), (0, 1, 2, 3, 4), with_wide_turns=True)
STANDARD = make_candidate_set(
    (PREFERRED, MATCHED), (0.0, 300.0, -300.0), (0,), (0, 1, 2, 3, 4, RACETRACK), with_wide_turns=True, rounds=4
)
WITH_TURN_LEG_PATHS = STANDARD._replace(rounds=8, extra=_TURN_LEG_PATHS)
"""`STANDARD`, and all airspeeds and detours with turn-and-leg paths for aircraft without a feasible candidate."""
WITH_SPLINES = STANDARD._replace(rounds=8, extra=_SPLINES)
"""`STANDARD`, and splines for aircraft without a feasible candidate."""
ALONE_STANDARD = make_candidate_set((PREFERRED, MATCHED, SLOWEST, FASTEST), (0.0,), (0, 1), (0, 1, 4, RACETRACK))
"""First candidates in the test of arrival times of an aircraft alone: horizontal detours at several airspeeds."""
ALONE_TURN_LEG_PATHS = make_candidate_set(_EVERY_SPEED, (0.0,), (0,), (0, 1), turn_leg_starts=24, max_candidates=48)
ALONE_SPLINES = CandidateSet((), (), (), (), (), spline_starts=32, max_splines=4)
"""Last candidates in the test of arrival times of an aircraft alone, before a time counts as unreachable."""


_LEVEL_MIN = 1.0  # m/s: keeps the horizontal airspeed of a vertical arrival finite; such an arrival is not attainable


class ArrivalMotion(eqx.Module):
    """Vertical speed over the ground and heading through the air at the arrival."""

    climb: Scalar  # vertical speed over the ground, up positive, m/s
    heading: Scalar  # rad
    heading_free: Flag  # whether no heading is prescribed; `heading` is then that of the line to the rendezvous
    attainable: Flag  # whether the prescribed motion can be flown at this airspeed in this wind


def arrival_motion(task: AircraftTask, wind: AbstractWind, duration: ScalarLike, speed: ScalarLike) -> ArrivalMotion:
    """Compute vertical speed and heading at the arrival after a duration (s) at an airspeed (m/s).

    If no path angle is prescribed, the aircraft climbs as its goal. In wind the climb rate of a prescribed path angle
    depends on the course: the prescribed course, or the course of the straight line to the rendezvous.
    """
    rendezvous = task.rendezvous
    meeting = task.meeting_n(duration)
    line = (meeting - task.position_n) * jnp.array([1.0, 1.0, 0.0])
    wind_n = wind.at(jnp.stack([jnp.zeros(()), jnp.zeros(()), meeting[2]]), duration)
    angle_prescribed = rendezvous.path_angle_prescribed
    windy = jnp.any(wind_n[:2] != 0.0)
    rendezvous_with_course = dataclasses.replace(
        rendezvous,
        course=jnp.where(rendezvous.course_prescribed, rendezvous.course, polar(line, jnp.zeros(3)).chi),
        course_prescribed=rendezvous.course_prescribed | (angle_prescribed & windy),
    )
    # If no angle is prescribed, the level airspeed follows from the airspeed and the goal's climb rate.
    air_descent = task.goal_velocity_n[2] - wind_n[2]
    square = speed**2 - air_descent**2
    level = jnp.sqrt(jnp.maximum(square, _LEVEL_MIN**2))
    level_wind = wind_n * jnp.array([1.0, 1.0, 0.0])
    air, attainable = final_air_velocity(
        rendezvous_with_course,
        line,
        jnp.where(angle_prescribed, speed, level),
        jnp.where(angle_prescribed, wind_n, level_wind),
    )
    return ArrivalMotion(
        climb=jnp.where(angle_prescribed, -(air + wind_n)[2], -task.goal_velocity_n[2]),
        heading=polar(air, jnp.zeros(3)).chi,
        heading_free=~rendezvous_with_course.course_prescribed,
        attainable=attainable & (angle_prescribed | (square > _LEVEL_MIN**2)),
    )


def climb_acceleration(task: AircraftTask, wind: AbstractWind) -> Scalar:
    """Return the initial vertical acceleration over the ground, up positive, m/s^2."""
    # including the change of the vertical wind along the path
    velocity_n = task.air_velocity_n + wind.at(task.position_n, 0.0)
    _, wind_dot_n = jax.jvp(lambda p: wind.at(p, 0.0), (task.position_n,), (velocity_n,))
    return -task.air_acceleration_n[2] - wind_dot_n[2]


_SPEED_ROUNDS = 4
_EXACT_ROUNDS, _LENGTH_TOLERANCE = 6, 3e-7  # relative difference of a profile's and its direct path's length
# Greatest and least ratio of the mean airspeed at the solution to its approximation; the greatest also limits by how
# much wide turns make a direct path longer.
_SPEED_FACTOR_MAX, _SPEED_FACTOR_MIN = 1.01, 0.999
_GAIN, _LOSS = 0.8, 1.6  # m/s^2
_RATE_FRACTION = 0.6  # fraction of the acceleration along the path available for a change of airspeed
_RATE_MIN = 0.01  # m/s^2, least rate: spreads a change of airspeed over the whole flight


def _plane(vector_n: Vector3) -> Array:
    return vector_n[0] + 1j * vector_n[1]


def curvature_limits(task: AircraftTask, gravity: ScalarLike, profile: Profile) -> tuple[Scalar, Scalar]:
    """Return the greatest curvature, 1/m, and its greatest rate along the path, 1/m^2, of a path with a profile.

    Both apply to the whole path: they follow from bank angle, load factor and bank rate at the greatest airspeed, in
    the steepest climb and with the strongest vertical acceleration of the profile.
    """
    limits = task.limits
    speed = profile.speed_max
    climb, climb_dot = profile.climb_bounds
    slowest = profile.speed_min
    cosine = jnp.sqrt(1.0 - jnp.minimum(climb / jnp.maximum(slowest, 1.0), 0.9) ** 2)
    lift_least = cosine * gravity - climb_dot
    side = side_force_max(lift_least, gravity + climb_dot, limits, gravity)
    curvature = CURVATURE_FRACTION * side / speed**2
    ramp_s = jnp.arctan(curvature * speed**2 / gravity) / task.roll_rate_max
    if limits.bank_rate_max is not None:
        # The tangent of the bank angle rises linearly, so that the angle rises fastest with level wings.
        ramp_s = jnp.maximum(ramp_s, CURVATURE_FRACTION * side / (jnp.maximum(lift_least, 1.0) * limits.bank_rate_max))
    return curvature, curvature / (speed * ramp_s)


def speed_rates(task: AircraftTask) -> tuple[Scalar, Scalar]:
    """Return the rates of gain and loss of airspeed in profiles, m/s^2.

    The rates use a part of the limits of acceleration along the path; the remaining part is for climb and descent.
    If the acceleration limit is negative, the rate of gain is `_RATE_MIN`.
    """
    limits = task.limits
    gain = jnp.minimum(_GAIN, _RATE_FRACTION * limits.acceleration_max)
    gain = jnp.where(limits.acceleration_max > 0.0, gain, _RATE_MIN)
    return gain, jnp.minimum(_LOSS, _RATE_FRACTION * limits.deceleration_max)


def _speed_0(task: AircraftTask) -> Scalar:
    return jnp.sqrt(jnp.sum(task.air_velocity_n**2))


def speeds_for_mean(task: AircraftTask, duration: ScalarLike, mean: ScalarLike) -> tuple[Scalar, Scalar]:
    """Return middle and final airspeed, m/s, both equal, of a profile with a duration (s) and a mean airspeed (m/s)."""
    final_speed = mean_to_last_speed(mean, _speed_0(task), duration, speed_rates(task))
    return final_speed, final_speed


def _profile(
    task: AircraftTask, airspace: Airspace, duration: Scalar, speeds: tuple[Scalar, Scalar], altitude_detour: ScalarLike
) -> tuple[Profile, ArrivalMotion]:
    """Make the profile with a duration (s) and the middle and final airspeeds `speeds` (m/s); also return the arrival.

    `altitude_detour` is the greatest additional altitude, m.
    """
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
    """Return start, end and turn limits of the horizontal path of a profile, in the frame that drifts with the air."""
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


def direct_paths(endpoints: PathEndpoints) -> DirectPath:
    """Return the shortest direct path of each of the four words (senses of the turns), stacked, the shortest first."""
    paths = jax.vmap(lambda word: direct_path(endpoints, word))(jnp.asarray(WORDS))
    order = jnp.argsort(paths.length)
    return jax.tree.map(lambda leaf: leaf[order], paths)


class TimedProfile(eqx.Module):
    """A profile of altitude and airspeed, with the direct paths that the turn radii at its airspeed allow."""

    table: TabulatedProfile  # profile with length and drift
    endpoints: PathEndpoints  # start, end and turn limits of its horizontal path
    direct: DirectPath  # four direct paths, with the turns right or left as in `WORDS`; the shortest first
    wide_directs: DirectPath  # direct paths with wider turns: (rank of the direct path, width)
    speed: Scalar  # mean airspeed, m/s
    within_limits: Flag  # whether the profile keeps its limits and the prescribed motion at the arrival can be flown


class ProfilePaths(NamedTuple):
    """A profile of altitude and airspeed, and the horizontal direct paths (turn, straight line, turn) that fit it."""

    table: TabulatedProfile  # profile with length and drift
    arrival: ArrivalMotion  # motion at the arrival
    endpoints: PathEndpoints  # start, end and turn limits of the direct paths
    directs: DirectPath  # four direct paths, with the turns right or left as in `WORDS`; the shortest first


def profile_paths(
    task: AircraftTask,
    airspace: Airspace,
    duration: Scalar,
    intervals: int,
    altitude_detour: ScalarLike,
    speeds: tuple[Scalar, Scalar],
) -> ProfilePaths:
    """Make the profile with the middle and final airspeeds `speeds` (m/s), and its direct paths.

    `duration` in s; `altitude_detour` is the greatest additional altitude, m. The profile is tabulated in `intervals`
    equal time intervals.
    """
    profile, arrival = _profile(task, airspace, duration, speeds, altitude_detour)
    table = tabulate(profile, airspace.wind, intervals)
    endpoints = _path_endpoints(task, airspace, table, arrival)
    return ProfilePaths(table, arrival, endpoints, direct_paths(endpoints))


def timed_profile(
    task: AircraftTask,
    airspace: Airspace,
    duration: Scalar,
    intervals: int,
    altitude_detour: Scalar,
    speeds: tuple[Scalar, Scalar],
) -> TimedProfile:
    """Make the profile with the middle and final airspeeds `speeds` (m/s), with direct paths, and check its limits.

    `duration` in s; `altitude_detour` is the greatest additional altitude, m.
    """
    table, arrival, endpoints, directs = profile_paths(task, airspace, duration, intervals, altitude_detour, speeds)
    excess = profile_excess(table, task.limits, airspace.gravity)
    wide_directs = jax.vmap(widen_directs, in_axes=(None, 0))(endpoints, directs)
    within_limits = within_profile_limits(excess) & arrival.attainable
    return TimedProfile(table, endpoints, directs, wide_directs, table.profile.speed_mean, within_limits)


class _NearbyPath(NamedTuple):
    """Shortest direct path, with the tightest turns, at a mean airspeed near the result of a search."""

    shortest: DirectPath
    width: Scalar  # width to which the turns can be widened, see `widen_direct`; 0: not at all


def _approach_direct_length(
    task: AircraftTask,
    airspace: Airspace,
    duration: Scalar,
    intervals: int,
    mean: Scalar,  # initial mean airspeed, m/s
    bounds: tuple[Scalar, Scalar],  # least and greatest mean airspeed, m/s
    rounds: ScalarLike,  # number of changes of the airspeed
    with_wide_turns: Flag | bool,  # whether the path may have wide turns
) -> tuple[Scalar, _NearbyPath]:
    """Approach the mean airspeed at which the shortest direct path takes the duration (s), by fixed-point iteration.

    Returns this airspeed, m/s, and the direct path at this airspeed. The width of the path is the greatest of `WIDTHS`
    for which the widened path is at most `_SPEED_FACTOR_MAX` times as long as the profile.
    """

    def evaluate(mean: Scalar) -> tuple[Scalar, _NearbyPath]:
        speeds = speeds_for_mean(task, duration, mean)
        paths = profile_paths(task, airspace, duration, intervals, 0.0, speeds)
        shortest, length = jax.tree.map(lambda leaf: leaf[0], paths.directs), paths.table.length
        wide = widen_directs(paths.endpoints, shortest)
        direct_length = jnp.where(shortest.exists, shortest.length, length)
        fits = wide.exists & (wide.length <= _SPEED_FACTOR_MAX * length) & with_wide_turns
        width = jnp.where(jnp.any(fits), jnp.array(WIDTHS)[jnp.argmax(fits)], 0.0)
        # Clipped, because radii grow with airspeed: for a path that is too long the iteration would diverge.
        following = jnp.clip(mean * direct_length / jnp.maximum(length, 1.0), *bounds)
        return following, _NearbyPath(shortest, width)

    evaluate = jax.jit(evaluate)  # traced once, for its shapes and for the loop

    def iterate(k: Integer, carry: tuple[Scalar, _NearbyPath]) -> tuple[Scalar, _NearbyPath]:
        following, nearby = evaluate(carry[0])
        return jnp.where(k < rounds, following, carry[0]), nearby

    empty = zeros_like_result(evaluate, mean)[1]
    return jax.lax.fori_loop(0, rounds + 1, iterate, (mean, empty))


def _match_direct_length(
    task: AircraftTask, airspace: Airspace, duration: Scalar, intervals: int, mean: Scalar, nearby: _NearbyPath
) -> tuple[Scalar, Flag]:
    """Return the mean airspeed, m/s, at which the direct path takes the duration (s), and whether the search converged.

    The secant method starts at the mean airspeed `mean`, and stays within 10 percent of it; `nearby` is the direct path
    at a nearby airspeed.
    """

    def mismatch_at(mean: Scalar) -> Scalar:
        """Return the length of the direct path over the length of the profile, minus 1, at a mean airspeed (m/s)."""
        profile, arrival = _profile(task, airspace, duration, speeds_for_mean(task, duration, mean), 0.0)
        table = tabulate(profile, airspace.wind, intervals)
        endpoints = _path_endpoints(task, airspace, table, arrival)
        aimed = reaim(endpoints, nearby.shortest, jnp.ones(2))
        return widen_direct(endpoints, aimed, nearby.width).length / table.length - 1.0

    def evaluate_and_step(k: Integer, carry: tuple[Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar]:
        """Do one secant step for the mean airspeed (m/s) at which the mismatch of length is zero."""
        previous, current, previous_mismatch = carry
        mismatch = mismatch_at(current)
        gap = mismatch - previous_mismatch
        secant = jnp.where(
            gap == 0.0, current, current - mismatch * (current - previous) / jnp.where(gap == 0.0, 1.0, gap)
        )
        following = jnp.where(k == 0, mean * (1.0 + mismatch), secant)
        return current, jnp.clip(following, 0.9 * mean, 1.1 * mean), mismatch

    matched_mean, _, final_mismatch = jax.lax.fori_loop(
        0, _EXACT_ROUNDS, evaluate_and_step, (mean, mean, jnp.zeros(()))
    )
    return matched_mean, jnp.abs(final_mismatch) <= _LENGTH_TOLERANCE


class ProfileSpeeds(NamedTuple):
    """Middle and final airspeeds, m/s, of an aircraft's profiles for each choice from `PREFERRED` to `LATE_SLOW`."""

    middle: Float[Array, "*aircraft choices"]
    final: Float[Array, "*aircraft choices"]


def profile_speeds(
    task: AircraftTask,
    airspace: Airspace,
    duration: Scalar,
    intervals: int,
    with_wide_turns: Flag | bool,  # whether the direct path may have wide turns
    with_matched: Flag | bool,  # whether the choice `MATCHED` is needed; its airspeed is arbitrary otherwise
) -> ProfileSpeeds:
    """Find, for each choice of the airspeed, the airspeeds with which one aircraft arrives after a duration (s)."""
    limits, preferred = task.limits, task.speed
    speed_max = jnp.where(jnp.isinf(limits.speed_max), 2.0 * preferred, limits.speed_max)
    low, high = 1.002 * limits.speed_min, 0.998 * speed_max
    speed_0, rates = _speed_0(task), speed_rates(task)

    slowest, fastest = (last_to_mean_speed(final_speeds, speed_0, duration, rates) for final_speeds in (low, high))
    current_speed = jnp.clip(speed_0, low, high)
    preferred_speed = jnp.clip(preferred, low, high)

    def match(mean: Scalar, bounds: tuple[Scalar, Scalar], rounds: Integer, fallback_factor: Scalar) -> Scalar:
        """Return the mean airspeed, m/s, at which the direct path takes the duration.

        An approximation starts at `mean` (m/s), takes a number of rounds and stays within `bounds` (m/s). If the exact
        solution is not close to the approximation, the result is the approximation times `fallback_factor`.
        """
        where = task, airspace, duration, intervals
        mean, nearby = _approach_direct_length(*where, mean, bounds, rounds, with_wide_turns)
        matched_mean, converged = _match_direct_length(*where, mean, nearby)
        is_near = (matched_mean <= jnp.minimum(_SPEED_FACTOR_MAX * mean, high)) & (
            matched_mean >= jnp.maximum(_SPEED_FACTOR_MIN * mean, low)
        )
        return jnp.where(converged & is_near, matched_mean, fallback_factor * mean)

    # The preferred airspeed does not change in the approximation. The fallback of the matched airspeed is slightly
    # faster than the approximation, so that a detour slightly longer than the direct path exists.
    choices = (
        (preferred_speed, (preferred_speed, preferred_speed), 0, 1.0),
        (preferred, (slowest, fastest), _SPEED_ROUNDS, 1.0 + 2e-4),
    )
    stacked = jax.tree.map(lambda *values: jnp.stack([jnp.asarray(value) for value in values]), *choices)

    def match_next(k: Integer, means: Float[Array, "2"]) -> Float[Array, "2"]:
        return means.at[k].set(match(*jax.tree.map(lambda values: values[k], stacked)))

    matched = jax.lax.fori_loop(0, jnp.where(with_matched, 2, 1), match_next, stacked[0])
    means = {
        PREFERRED: matched[0],
        MATCHED: matched[1],
        SLOWER: 0.5 * (preferred_speed + slowest),
        FASTER: 0.5 * (preferred_speed + fastest),
    }
    speeds = {choice: speeds_for_mean(task, duration, mean) for choice, mean in means.items()} | {
        SLOWEST: (low, low),
        FASTEST: (high, high),
        SLOW_FAST: (low, high),
        FAST_SLOW: (high, low),
        LATE_FAST: (current_speed, high),
        LATE_SLOW: (current_speed, low),
    }
    return ProfileSpeeds(*(jnp.stack([speeds[choice][k] for choice in range(len(speeds))]) for k in range(2)))


def fleet_speeds(
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    intervals: int,
    # whether direct paths may have wide turns, and whether the choice `MATCHED` is needed
    with_wide_turns: Flag,
    with_matched: Flag,
) -> ProfileSpeeds:
    """Return the airspeeds of all choices for each aircraft and its duration (s) from start to arrival."""

    def speeds_of(row: tuple[AircraftTask, Scalar]) -> ProfileSpeeds:
        return profile_speeds(row[0], airspace, row[1], intervals, with_wide_turns, with_matched)

    return jax.lax.map(speeds_of, (tasks, durations))


def timed_profiles(
    task: AircraftTask,
    airspace: Airspace,
    duration: Scalar,
    intervals: int,
    altitude_detours: Float[Array, " profiles"],  # greatest additional altitudes, m
    speeds: tuple[Float[Array, " profiles"], Float[Array, " profiles"]],  # middle and final airspeeds, m/s
) -> TimedProfile:
    """Make one profile with a duration (s) for each altitude detour and its pair of airspeeds, stacked."""
    profile_for = functools.partial(timed_profile, task, airspace, duration, intervals)
    return map_rows(profile_for, altitude_detours, speeds)
