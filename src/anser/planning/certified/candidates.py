"""All the ways in which one aircraft can be at its rendezvous at a given time."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.planning.certified.conflicts import Track, track_slack
from anser.planning.certified.detours import (
    ANGLE_MAX,
    FIRST,
    FIXED,
    HEADINGS,
    SECOND,
    SHAPES,
    WORDS,
    Detour,
    Direct,
    Solved,
    direct,
    resolve,
    solve_detour,
    solve_racetrack,
)
from anser.planning.certified.profile import (
    Profile,
    ProfileLimits,
    Timetable,
    kept,
    last_to_mean_speed,
    make_profile,
    profile_excess,
    tabulate,
)
from anser.planning.certified.request import Airspace, Traveller
from anser.planning.certified.route import Ends, Route
from anser.planning.certified.smooth_turn import cis
from anser.planning.rendezvous import final_air_velocity
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3

RACETRACK = SHAPES
_CURVATURE_KEPT = 0.98  # of what bank and load factor allow: the certificate's bounds and the fit take the rest
_SPEED_ROUNDS = 4
# How the mean airspeed is chosen: as preferred; so that the direct path takes the time; as slowly, as fast as may be.
PREFERRED, MATCHED, SLOWEST, FASTEST = range(4)


class Choices(NamedTuple):
    """The candidates to look at, as tables.

    Attributes
    ----------
    speeds, heights
        One row per profile: how the mean airspeed is chosen, and the detour in altitude, m.
    words, shapes, sides
        One row per shape: rank of the direct path by its length, which detour (`RACETRACK` after the others), side.
    """

    speeds: tuple[int, ...]
    heights: tuple[float, ...]
    words: tuple[int, ...]
    shapes: tuple[int, ...]
    sides: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of candidates."""
        return len(self.speeds) * len(self.words)


def make_choices(
    speeds: Sequence[int], heights: Sequence[float], words: Sequence[int], shapes: Sequence[int]
) -> Choices:
    """Every combination of them, to both sides."""
    profiles = [(speed, height) for speed in speeds for height in heights]
    ways = [(word, shape, side) for word in words for shape in shapes for side in (1, -1)]
    return Choices(
        tuple(p[0] for p in profiles),
        tuple(p[1] for p in profiles),
        tuple(w[0] for w in ways),
        tuple(w[1] for w in ways),
        tuple(w[2] for w in ways),
    )


FEW = make_choices((PREFERRED,), (0.0,), (0,), (0, 1, 2, 3, 4))
MANY = make_choices((PREFERRED, MATCHED), (0.0, 300.0, -300.0), (0,), (0, 1, 2, 3, 4, RACETRACK))
ALL = make_choices(
    (PREFERRED, MATCHED, SLOWEST, FASTEST), (0.0, 300.0, -300.0, 600.0, -600.0), (0, 1), (0, 1, 2, 3, 4, RACETRACK)
)


class Candidate(eqx.Module):
    """One way to be there in time; stacked, all of them.

    Attributes
    ----------
    profile
        Altitude and airspeed by time.
    ends, solved
        Its horizontal shape.
    valid
        Whether it exists within the limits of its aircraft.
    cost
        How little it is liked.
    speed
        Mean airspeed, m/s.
    """

    profile: Profile
    ends: Ends
    solved: Solved
    valid: Flag
    cost: Scalar
    speed: Scalar


def _plane(vector_n: Vector3) -> Array:
    return vector_n[0] + 1j * vector_n[1]


def curvature_limits(traveller: Traveller, gravity: ScalarLike, profile: Profile) -> tuple[Scalar, Scalar]:
    """Greatest curvature (1/m) of a path flown by a profile, and its greatest rate along the path (1/m^2).

    One curvature for the whole path: that of the greatest airspeed, the steepest climb and the strongest push-over.
    """
    limits = traveller.limits
    speed = jnp.maximum(profile.speed_0, profile.speed_1)
    climb, push = profile.steepest
    slowest = jnp.minimum(profile.speed_0, profile.speed_1)
    cosine = jnp.sqrt(1.0 - jnp.minimum(climb / jnp.maximum(slowest, 1.0), 0.9) ** 2)
    lift = jnp.maximum(cosine * gravity - push, _LEAST_PUSH)
    by_bank = lift * jnp.tan(limits.bank_max)
    total = jnp.minimum(limits.load_factor_max, 1e3) * gravity
    by_load = jnp.sqrt(jnp.maximum(total**2 - (gravity + push) ** 2, _LEAST_PUSH**2))
    curvature = _CURVATURE_KEPT * jnp.minimum(by_bank, by_load) / speed**2
    ramp_s = jnp.arctan(curvature * speed**2 / gravity) / traveller.roll_rate_max
    return curvature, curvature / (speed * ramp_s)


_LEAST_PUSH = 0.1  # m/s^2: an aircraft whose limits allow no turn still has finite radii


def _profile(
    traveller: Traveller, airspace: Airspace, duration: Scalar, mean_speed: Scalar, height: ScalarLike
) -> Profile:
    rendezvous = traveller.rendezvous
    begin = traveller.position_n
    end_down = traveller.goal_position_n[2] + traveller.goal_velocity_n[2] * duration + rendezvous.stand_off_n[2]
    wind_0 = airspace.wind.at(begin, 0.0)
    at_end = jnp.stack([jnp.zeros(()), jnp.zeros(()), end_down])
    wind_1 = airspace.wind.at(at_end, duration)
    arrival = final_air_velocity(rendezvous, jnp.array([1.0, 0.0, 0.0]), mean_speed, wind_1)[0] + wind_1
    level_off = jnp.where(rendezvous.path_angle_prescribed, -arrival[2], -traveller.goal_velocity_n[2])
    speed_0 = jnp.sqrt(jnp.sum(traveller.air_velocity_n**2))
    speed_dot = jnp.sum(traveller.air_velocity_n * traveller.air_acceleration_n) / jnp.maximum(speed_0, 1.0)
    return make_profile(
        duration,
        (-begin[2], -end_down),
        (-traveller.air_velocity_n[2] - wind_0[2], level_off),
        -traveller.air_acceleration_n[2],
        height,
        speed_0,
        speed_dot,
        mean_speed,
    )


def _ends(traveller: Traveller, airspace: Airspace, table: Timetable) -> Ends:
    """What the horizontal path joins in the frame that drifts with the air, at a timetable."""
    duration, profile = table.profile.duration, table.profile
    velocity, acceleration = traveller.air_velocity_n, traveller.air_acceleration_n
    rendezvous = traveller.rendezvous
    end = traveller.goal_position_n + traveller.goal_velocity_n * duration + rendezvous.stand_off_n - table.drift_n
    level = jnp.maximum(jnp.sum(velocity[:2] ** 2), 1.0)
    curvature = (velocity[0] * acceleration[1] - velocity[1] * acceleration[0]) / level**1.5
    curvature_max, sharpness = curvature_limits(traveller, airspace.gravity, profile)
    arrived = jnp.stack([jnp.zeros(()), jnp.zeros(()), -profile.at(duration).altitude])
    wind = airspace.wind.at(arrived, duration)
    line = jnp.stack([jnp.real(_plane(end - traveller.position_n)), jnp.imag(_plane(end - traveller.position_n)), 0.0])
    final, _ = final_air_velocity(rendezvous, line, profile.speed_1, wind)
    return Ends(
        start=_plane(traveller.position_n),
        heading=jnp.arctan2(velocity[1], velocity[0]),
        curvature=curvature,
        end=_plane(end),
        end_heading=jnp.arctan2(final[1], final[0]),
        end_free=~rendezvous.course_prescribed,
        curvature_max=curvature_max,
        sharpness=sharpness,
    )


def directs(ends: Ends) -> Direct:
    """The four direct paths, the shortest first."""
    found = jax.vmap(lambda word: direct(ends, word))(jnp.asarray(WORDS))
    order = jnp.argsort(found.length)
    return jax.tree.map(lambda leaf: leaf[order], found)


class TimedProfile(eqx.Module):
    """A profile with what follows from it alone."""

    table: Timetable
    ends: Ends
    direct: Direct
    """Four, the shortest first."""
    speed: Scalar
    good: Flag


def timed_profile(
    traveller: Traveller, airspace: Airspace, duration: Scalar, ticks: int, height: Scalar, mean: Scalar
) -> TimedProfile:
    """Profile of a mean airspeed, with its direct paths at the radii that go with that airspeed."""
    table = tabulate(_profile(traveller, airspace, duration, mean, height), airspace.wind, ticks)
    ends = _ends(traveller, airspace, table)
    excess = profile_excess(table, _profile_limits(traveller), airspace.gravity)
    return TimedProfile(table, ends, directs(ends), mean, kept(excess))


def _profiles(traveller: Traveller, airspace: Airspace, duration: Scalar, ticks: int, choices: Choices) -> TimedProfile:
    """All profiles of a table of choices, stacked."""
    kinds = tuple(dict.fromkeys(choices.speeds))
    limits, preferred = traveller.limits, traveller.speed
    low, high = 1.002 * limits.speed_min, 0.998 * limits.speed_max
    speed_0 = jnp.sqrt(jnp.sum(traveller.air_velocity_n**2))

    slowest, fastest = (last_to_mean_speed(last, speed_0, duration) for last in (low, high))

    def closer(_: object, mean: Scalar) -> Scalar:
        now = timed_profile(traveller, airspace, duration, ticks, jnp.zeros(()), mean)
        wanted = jnp.where(now.direct.exists[0], now.direct.length[0], now.table.length)
        # The radii grow with the speed: left to itself a path that is too long would be flown ever faster.
        return jnp.clip(mean * wanted / jnp.maximum(now.table.length, 1.0), slowest, fastest)

    matched = preferred
    if MATCHED in kinds:
        # A hair faster: a path that is longer than the direct one by less than this is a detour, a shorter one is none.
        matched = (1.0 + 2e-4) * jax.lax.fori_loop(0, _SPEED_ROUNDS, closer, preferred)
    means = {PREFERRED: jnp.clip(preferred, low, high), MATCHED: matched, SLOWEST: slowest, FASTEST: fastest}
    heights = jnp.asarray(choices.heights)
    each = jnp.stack([means[kind] for kind in choices.speeds])
    return jax.vmap(lambda height, mean: timed_profile(traveller, airspace, duration, ticks, height, mean))(
        heights, each
    )


def _profile_limits(traveller: Traveller) -> ProfileLimits:
    limits = traveller.limits
    return ProfileLimits(
        limits.speed_min,
        limits.speed_max,
        limits.climb_rate_max,
        limits.altitude_min,
        limits.altitude_max,
        limits.acceleration_max,
        limits.deceleration_max,
    )


def candidates(
    traveller: Traveller, airspace: Airspace, duration: ScalarLike, ticks: int, choices: Choices
) -> tuple[Candidate, Timetable]:
    """Every candidate of one aircraft for a duration (s), and the timetables of the profiles, stacked by profile.

    Candidate k has profile k // ways, with `ways` the number of shapes per profile.
    """
    duration = jnp.asarray(duration, dtype=float)
    timed = _profiles(traveller, airspace, duration, ticks, choices)
    words, shapes, sides = (jnp.asarray(x) for x in (choices.words, choices.shapes, choices.sides))
    heights = jnp.asarray(choices.heights)

    def one(timed: TimedProfile, height: Scalar, word: Count, shape: Count, side: Count) -> Candidate:
        base = jax.tree.map(lambda leaf: leaf[word], timed.direct)
        wanted = timed.table.length
        bend = jnp.minimum(shape, SHAPES - 1)
        way = Detour(
            side * jnp.asarray(HEADINGS)[bend],
            jnp.asarray(FIRST)[bend],
            jnp.asarray(SECOND)[bend],
            jnp.asarray(FIXED)[bend],
            jnp.asarray(ANGLE_MAX)[bend],
        )
        bent = solve_detour(timed.ends, base, way, wanted)
        solved = bent
        if RACETRACK in choices.shapes:
            held = solve_racetrack(timed.ends, base, side.astype(float), wanted)
            solved = jax.tree.map(lambda a, b: jnp.where(shape == RACETRACK, a, b), held, bent)
        fits = (traveller.side == 0) | (traveller.side * side > 0)
        valid = timed.good & solved.exists & fits & jnp.isfinite(wanted)
        detour = jnp.abs(timed.speed / traveller.speed - 1.0) * 20.0 + jnp.abs(height) / 400.0
        cost = jnp.sum(jnp.abs(solved.angles)) + detour + jnp.where(shape == RACETRACK, 2.0, 0.0) + 0.01 * shape
        return Candidate(timed.table.profile, timed.ends, solved, valid, cost, timed.speed)

    each_way = jax.vmap(one, in_axes=(None, None, 0, 0, 0))
    found = jax.vmap(each_way, in_axes=(0, 0, None, None, None))(timed, heights, words, shapes, sides)
    flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), found)
    return flat, timed.table


def track(
    candidate: Candidate,
    table: Timetable,
    airspace: Airspace,
    times: Float[Array, " instants"],
    active: ScalarLike = 1.0,
) -> Track:
    """Where a candidate is at times (s after its start, equally spaced)."""
    shape: Route = resolve(candidate.ends, candidate.solved)
    profile = candidate.profile
    scale = shape.length / jnp.maximum(table.length, 1.0)
    step = times[1] - times[0]

    def one(t: Scalar) -> tuple[Vector3, Scalar]:
        inside = jnp.clip(t, 0.0, profile.duration)
        beyond = t - inside
        speed, wind = table.rates(inside)
        place, heading, curvature = shape.at(scale * table.length_at(inside))
        drift = table.drift_at(inside)
        now = profile.at(inside)
        ahead = cis(heading)
        level = place + beyond * speed * ahead + drift[0] + 1j * drift[1] + beyond * (wind[0] + 1j * wind[1])
        down = -now.altitude - beyond * now.climb
        push = jnp.sqrt((curvature * speed**2) ** 2 + now.climb_dot**2 + now.speed_dot**2)
        return jnp.stack([jnp.real(level), jnp.imag(level), down]), push

    positions, pushes = jax.vmap(one)(times)
    # Between the instants a ramp may have raised it.
    rising = 0.25 * step * candidate.ends.sharpness * candidate.speed**3
    bound = jnp.minimum(
        jnp.maximum(pushes[1:], pushes[:-1]) + rising, candidate.ends.curvature_max * profile.speed_1**2 + 2.0
    )
    counted = active * jnp.where(times[:-1] < profile.duration - 1e-6, 1.0, 0.0)
    return Track(positions, track_slack(bound, step), counted)
