"""Profiles of an aircraft that take a given time, with the radii and the direct paths that go with each."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from anser.planning.certified.arrival_motion import ArrivalMotion, arrival_motion, climb_acceleration
from anser.planning.certified.candidate_sets import (
    FAST_SLOW,
    FASTER,
    FASTEST,
    LATE_FAST,
    LATE_SLOW,
    MATCHED,
    PREFERRED,
    SLOW_FAST,
    SLOWER,
    SLOWEST,
    CandidateSet,
)
from anser.planning.certified.detours import WORDS, Direct, aimed_again, direct
from anser.planning.certified.profile import (
    CURVATURE_KEPT,
    Profile,
    TabulatedProfile,
    kept,
    last_to_mean_speed,
    make_profile,
    mean_to_last_speed,
    profile_excess,
    tabulate,
)
from anser.planning.certified.route import PathEnds
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.wide_turns import GENTLE_BANK, WIDTHS, widened, widened_directs
from anser.planning.demand import greatest_side
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

_SPEED_ROUNDS = 4
_EXACT_ROUNDS, _EXACT = 4, 3e-7  # until a profile is as long as its direct path, to a part of the length
_FASTER, _SLOWER = 1.01, 0.999  # times the preferred airspeed: so much it gives way for a direct path of wide turns
_GAIN, _LOSS = 0.8, 1.6  # m/s^2
_RATE_KEPT = 0.6  # part of the acceleration along the path that a change of airspeed may take


def _plane(vector_n: Vector3) -> Array:
    return vector_n[0] + 1j * vector_n[1]


def curvature_limits(task: AircraftTask, gravity: ScalarLike, profile: Profile) -> tuple[Scalar, Scalar]:
    """Greatest curvature (1/m) of a path flown by a profile, and its greatest rate along the path (1/m^2).

    One curvature for the whole path: that of the greatest airspeed, the steepest climb and the strongest push-over.
    """
    limits = task.limits
    speed = profile.speed_most
    climb, climb_dot = profile.climb_bounds
    slowest = profile.speed_least
    cosine = jnp.sqrt(1.0 - jnp.minimum(climb / jnp.maximum(slowest, 1.0), 0.9) ** 2)
    lift_least = cosine * gravity - climb_dot
    side = greatest_side(lift_least, gravity + climb_dot, limits, gravity)
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


def steady_after(task: AircraftTask, duration: ScalarLike, mean: ScalarLike) -> tuple[Scalar, Scalar]:
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


def _ends(task: AircraftTask, airspace: Airspace, table: TabulatedProfile, arrival: ArrivalMotion) -> PathEnds:
    """What the horizontal path joins in the frame that drifts with the air, at a tabulated profile."""
    duration, profile = table.profile.duration, table.profile
    velocity, acceleration = task.air_velocity_n, task.air_acceleration_n
    end = task.meeting_n(duration) - table.drift_n
    level = jnp.maximum(jnp.sum(velocity[:2] ** 2), 1.0)
    curvature = (velocity[0] * acceleration[1] - velocity[1] * acceleration[0]) / level**1.5
    curvature_max, sharpness = curvature_limits(task, airspace.gravity, profile)
    gentle = jnp.tan(GENTLE_BANK) * airspace.gravity / profile.speed_most**2
    return PathEnds(
        start=_plane(task.position_n),
        heading=jnp.arctan2(velocity[1], velocity[0]),
        curvature=curvature,
        end=_plane(end),
        end_heading=arrival.heading,
        end_free=arrival.heading_free,
        curvature_max=curvature_max,
        sharpness=sharpness,
        scale_most=jnp.maximum(curvature_max / gentle, 1.0),
    )


def directs(ends: PathEnds) -> Direct:
    """The four direct paths, the shortest first."""
    found = jax.vmap(lambda word: direct(ends, word))(jnp.asarray(WORDS))
    order = jnp.argsort(found.length)
    return jax.tree.map(lambda leaf: leaf[order], found)


class TimedProfile(eqx.Module):
    """A profile with what follows from it alone."""

    table: TabulatedProfile
    ends: PathEnds
    direct: Direct
    """Four, the shortest first."""
    wide: Direct
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
    ends = _ends(task, airspace, table, arrival)
    excess = profile_excess(table, task.limits, airspace.gravity)
    words = directs(ends)
    wide = jax.vmap(widened_directs, in_axes=(None, 0))(ends, words)
    return TimedProfile(table, ends, words, wide, profile.speed_mean, kept(excess) & arrival.attainable)


def _exactly_matched(
    task: AircraftTask, airspace: Airspace, timed: TimedProfile, mean: Scalar, widened_too: bool
) -> tuple[Scalar, Flag]:
    """The mean airspeed (m/s) at which the shortest direct path takes the time, and whether that is so.

    Of a profile of nearly that speed. The path is the one with the widest turns that is not longer by more than
    `_FASTER`.
    """
    duration, intervals = timed.table.profile.duration, timed.table.lengths.shape[0] - 1
    words, wide = jax.tree.map(lambda leaf: leaf[0], (timed.direct, timed.wide))
    fits = wide.exists & (wide.length <= _FASTER * timed.table.length) & widened_too
    width = jnp.where(jnp.any(fits), jnp.array(WIDTHS)[jnp.argmax(fits)], 0.0)

    def longer_by(mean: Scalar) -> Scalar:
        """By what part of it the direct path is longer than the profile's."""
        profile, arrival = _profile(task, airspace, duration, steady_after(task, duration, mean), 0.0)
        table = tabulate(profile, airspace.wind, intervals)
        ends = _ends(task, airspace, table, arrival)
        return widened(ends, aimed_again(ends, words, jnp.ones(2)), width).length / table.length - 1.0

    def closer(_: object, carry: tuple[Scalar, Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        before, now, off_before, off = carry
        gap = off - off_before
        found = jnp.where(gap == 0.0, now, now - off * (now - before) / jnp.where(gap == 0.0, 1.0, gap))
        found = jnp.clip(found, 0.9 * mean, 1.1 * mean)
        return now, found, off, longer_by(found)

    off = longer_by(mean)
    first = jnp.clip(mean * (1.0 + off), 0.9 * mean, 1.1 * mean)
    _, found, _, left = jax.lax.fori_loop(0, _EXACT_ROUNDS, closer, (mean, first, off, longer_by(first)))
    return found, jnp.abs(left) <= _EXACT


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
        speeds = steady_after(task, duration, mean)
        timed = timed_profile(task, airspace, duration, intervals, jnp.zeros(()), speeds)
        wanted = jnp.where(timed.direct.exists[0], timed.direct.length[0], timed.table.length)
        # The radii grow with the speed: left to itself a path that is too long would be flown ever faster.
        return jnp.clip(mean * wanted / jnp.maximum(timed.table.length, 1.0), slowest, fastest)

    def exactly(mean: Scalar, otherwise: Scalar) -> Scalar:
        """A mean airspeed (m/s) at which the direct path takes the time, if it is near one, or else another."""
        begun = timed_profile(task, airspace, duration, intervals, jnp.zeros(()), steady_after(task, duration, mean))
        found, met = _exactly_matched(task, airspace, begun, mean, candidate_set.widened)
        near = (found <= jnp.minimum(_FASTER * mean, high)) & (found >= jnp.maximum(_SLOWER * mean, low))
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
    speeds = {kind: steady_after(task, duration, mean) for kind, mean in means.items()} | {
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
