"""Samples of planned paths.

Demands on each aircraft, their extremes, and the closest approaches to other aircraft and to keep-outs. Between two
samples a path is the cubic with the positions and velocities of both ends. At half a second that is within a
millimetre of paths of aircraft: the error is the fourth derivative times the interval to the fourth over 384.
"""

from collections.abc import Mapping
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from anser.compiling.options import compiled, compiled_quickly
from anser.numerics.arrays import as_array, pad_to_multiple, unstack_rows
from anser.parts.paths import PathPoint, polar
from anser.parts.planners import IdleDeceleration
from anser.planning.demand import demand
from anser.planning.limits import CERTIFIED_LIMITS, PathLimits
from anser.planning.separation import separation_ratio
from anser.results.plan_record import ClosestApproach, PlanExtremes, PlanSamples
from anser.scenario.schema_airspace import KeepOut
from anser.shapes import Scalar, ScalarLike, Vector3

_PAIRS_MAX = 64  # pairs that are looked at between the samples: the nearest ones at the samples
_PARTS = 16  # of an interval between two samples, each of which is halved so often that only rounding is left
_HALVINGS = 30


FLEET_MULTIPLE, _TIMES_MULTIPLE, _VOLUMES_MULTIPLE = (
    4,
    512,
    2,
)  # sizes to whose multiples all are filled up: other numbers seldom compile


class SampledMotion(eqx.Module):
    """Positions (m) and velocities (m/s) over the ground, NED, (time, aircraft, axis); NaN after an arrival."""

    times: Float[Array, " time"]
    positions_n: Float[Array, "time aircraft 3"]
    velocities_n: Float[Array, "time aircraft 3"]


def sampled_motion(times_s: np.ndarray, history: Mapping[str, np.ndarray]) -> SampledMotion:
    """Motion of a fleet from a history as `sample_paths` makes it; the wind is horizontal."""
    places = np.stack([history["north"], history["east"], -history["altitude"]], axis=-1)
    speeds = np.stack([history["velocity_north"], history["velocity_east"], -history["climb_rate"]], axis=-1)
    return SampledMotion(*map(as_array, (times_s, places, speeds)))


def _padded(motion: SampledMotion) -> SampledMotion:
    """With instants and aircraft of which nothing is known."""
    count, fleet = motion.positions_n.shape[:2]
    more, others = -count % _TIMES_MULTIPLE, -fleet % FLEET_MULTIPLE
    known = np.asarray(motion.times)
    times = np.concatenate([known, known[-1] + 1.0 + np.arange(more)])
    states = (
        np.pad(np.asarray(state), ((0, more), (0, others), (0, 0)), constant_values=np.nan)
        for state in (motion.positions_n, motion.velocities_n)
    )
    return SampledMotion(*map(as_array, (times, *states)))


def _interpolate(
    times: Float[Array, " time"], places: Float[Array, "time 3"], speeds: Float[Array, "time 3"], instant: Scalar
) -> Float[Array, "3"]:
    """Place on the cubic about an instant, NaN where an end of it is."""
    k = jnp.clip(jnp.searchsorted(times, instant, side="right") - 1, 0, times.shape[0] - 2)
    step = times[k + 1] - times[k]
    u = (instant - times[k]) / step
    way = places[k + 1] - places[k]
    c2 = 3.0 * way - step * (2.0 * speeds[k] + speeds[k + 1])
    c3 = step * (speeds[k] + speeds[k + 1]) - 2.0 * way
    inside = places[k] + u * (step * speeds[k] + u * (c2 + u * c3))
    # At a sample the next one does not count: it may lie after the arrival.
    return jnp.where(u == 0.0, places[k], inside)


def _fine_times(times: Float[Array, " time"]) -> Float[Array, " fine"]:
    inner = times[:-1, None] + (times[1:] - times[:-1])[:, None] * (jnp.arange(_PARTS) / _PARTS)[None, :]
    return jnp.concatenate([inner.ravel(), times[-1:]])


def _distance(apart: Float[Array, "*batch 3"], asked: Float[Array, "2"]) -> Float[Array, "*batch"]:
    """Distance in space where no separation is asked, else the horizontal one that would be as much of it."""
    level = jnp.sqrt(apart[..., 0] ** 2 + apart[..., 1] ** 2)
    height = jnp.abs(apart[..., 2])
    as_much = asked[0] * separation_ratio(level, height, asked[0], asked[1])
    return jnp.where(asked[0] > 0.0, as_much, jnp.sqrt(level**2 + height**2))


@compiled
def _distances_at_samples(
    positions: Float[Array, "time aircraft 3"], asked: Float[Array, "2"]
) -> tuple[Float[Array, " time"], Int[Array, " time"], Float[Array, "aircraft aircraft"]]:
    """Least distance of two at each instant, who they are (as one number), and the least of each pair."""
    fleet = positions.shape[1]
    first = jnp.triu(jnp.ones((fleet, fleet), dtype=bool), 1)

    def look(least: Array, place: Float[Array, "aircraft 3"]) -> tuple[Array, tuple[Array, Array]]:
        apart = _distance(place[:, None, :] - place[None, :, :], asked)
        apart = jnp.where(first & jnp.isfinite(apart), apart, jnp.inf)
        who = jnp.argmin(apart)
        return jnp.minimum(least, apart), (apart.ravel()[who], who)

    # Instant by instant: memory stays quadratic in the fleet.
    least, (distance, who) = lax.scan(look, jnp.full((fleet, fleet), jnp.inf), positions)
    return distance, who, least


@compiled_quickly
def _closest_approaches(
    motion: SampledMotion, pairs: Int[Array, "pairs 2"], asked: Float[Array, "2"]
) -> tuple[Float[Array, " pairs"], Float[Array, " pairs"], Float[Array, "pairs 3"]]:
    """Least distance of each pair until one arrives, when, and what then lies between them (NED, m)."""
    fine = _fine_times(motion.times)

    def one(pair: Int[Array, "2"]) -> tuple[Scalar, Scalar, Float[Array, "3"]]:
        apart = motion.positions_n[:, pair[1]] - motion.positions_n[:, pair[0]]
        rate = motion.velocities_n[:, pair[1]] - motion.velocities_n[:, pair[0]]

        def at(time: Scalar) -> tuple[Scalar, Float[Array, "3"]]:
            between = _interpolate(motion.times, apart, rate, time)
            found = _distance(between, asked)
            return jnp.where(jnp.isfinite(found), found, jnp.inf), between

        k = jnp.argmin(jax.vmap(lambda time: at(time)[0])(fine))
        low, middle, high = (fine[jnp.clip(k + step, 0, fine.shape[0] - 1)] for step in (-1, 0, 1))

        def narrower(_: int, ends: tuple[Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar]:
            left, best, right = ends
            tried = jnp.stack([left, 0.5 * (left + best), best, 0.5 * (best + right), right])
            j = jnp.argmin(jax.vmap(lambda time: at(time)[0])(tried))
            return tried[jnp.maximum(j - 1, 0)], tried[j], tried[jnp.minimum(j + 1, 4)]

        _, when, _ = lax.fori_loop(0, _HALVINGS, narrower, (low, middle, high))
        value, between = at(when)
        return value, when, between

    return lax.map(one, pairs)


def nearest_pairs(motion: SampledMotion, separation_m: tuple[float, float] | None) -> ClosestApproach:
    """The two aircraft of a fleet that are nearest to each other, at the samples and at all; until one arrives.

    Parameters
    ----------
    motion
        Of the fleet.
    separation_m
        How distance is measured: None in space; else in the plane, or, where the second is not 0, in altitude scaled
        by the first over the second, whichever is more: what is asked is kept where that is at least the first.

    Notes
    -----
    The least of all is sought among the 64 pairs that are nearest at the samples.
    """
    count, fleet = motion.positions_n.shape[:2]
    if fleet < 2:
        nothing = np.full(count, np.nan)
        return ClosestApproach(nothing, np.full((count, 2), -1), np.nan, (-1, -1), np.nan, np.nan, np.nan)
    measure, filled = as_array(separation_m or (0.0, 0.0)), _padded(motion)
    distance, who, least = (np.asarray(x) for x in _distances_at_samples(filled.positions_n, measure))
    distance, who = distance[:count], who[:count]
    together = np.isfinite(distance)
    pairs = np.stack(np.triu_indices(len(least), 1), axis=1)
    candidates = pairs[np.argsort(least[tuple(pairs.T)], kind="stable")[:_PAIRS_MAX]]
    found, when, apart = (np.asarray(x) for x in _closest_approaches(filled, as_array(candidates, None), measure))
    best = int(np.argmin(found))
    pair = np.stack(np.unravel_index(who, least.shape), axis=1)
    one, other = (int(k) for k in candidates[best])
    met = bool(np.isfinite(found[best]))
    return ClosestApproach(
        distance_m=np.where(together, distance, np.nan),
        pair=np.where(together[:, None], pair, -1),
        minimum_m=float(found[best]) if met else np.nan,
        minimum_pair=(one, other) if met else (-1, -1),
        minimum_time_s=float(when[best]) if met else np.nan,
        horizontal_m=float(np.hypot(apart[best, 0], apart[best, 1])) if met else np.nan,
        vertical_m=float(abs(apart[best, 2])) if met else np.nan,
    )


@compiled
def _keep_out_margins(
    motion: SampledMotion, volumes: Float[Array, "volumes 7"]
) -> tuple[Float[Array, "aircraft volumes"], Float[Array, "aircraft volumes"]]:
    fine = _fine_times(motion.times)

    def one(track: tuple[Float[Array, "time 3"], Float[Array, "time 3"]]) -> tuple[Array, Array]:
        positions = jax.vmap(lambda time: _interpolate(motion.times, *track, time))(fine)

        def room(volume: Float[Array, "7"]) -> tuple[Scalar, Scalar]:
            away = positions[:, :2] - volume[None, 0:2] - fine[:, None] * volume[None, 2:4]
            beside = jnp.sqrt(jnp.sum(away**2, axis=1)) - volume[4]
            altitude = -positions[:, 2]
            out = jnp.maximum(beside, jnp.maximum(volume[5] - altitude, altitude - volume[6]))
            k = jnp.argmin(jnp.where(jnp.isfinite(out), out, jnp.inf))
            return out[k], fine[k]

        return jax.vmap(room)(volumes)

    return lax.map(one, (jnp.swapaxes(motion.positions_n, 0, 1), jnp.swapaxes(motion.velocities_n, 0, 1)))


def keep_out_margins(motion: SampledMotion, keep_outs: tuple[KeepOut, ...]) -> tuple[np.ndarray, np.ndarray]:
    """How far each aircraft stays out of each volume at least, m, negative inside; and when, s; (aircraft, volume).

    Looked for at sixteen instants between two samples.
    """
    if not keep_outs:
        none = np.zeros((motion.positions_n.shape[1], 0))
        return none, none
    rows = [
        (one.north_m, one.east_m, *one.velocity_m_s()[:2], one.radius_m, one.bottom_m, one.top_m) for one in keep_outs
    ]
    found = _keep_out_margins(_padded(motion), pad_to_multiple(as_array(rows), _VOLUMES_MULTIPLE))
    rooms, when = (np.asarray(one)[: motion.positions_n.shape[1], : len(rows)] for one in found)
    return rooms, when


SAMPLE_STEP_S = 0.5
"""Between two instants of the record."""
_FINE = 1024  # instants of a path at which its extremes are looked for: every fifth of a second or less of most
_BLOCK = 256
_SAME_TIME_S = 1e-6


class PlannedPath(Protocol):
    """A path in time, of either planner: NED, SI units."""

    def at(self, time: ScalarLike) -> PathPoint:
        """Motion over the ground."""
        ...

    def air_velocity_n(self, time: ScalarLike) -> Vector3:
        """Velocity relative to the air, m/s."""
        ...


def sample_times(start_s: float, arrival_times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Even instants from the start to the last arrival, and every arrival; and which are even ones."""
    arrivals = np.unique(arrival_times)
    count = int(np.ceil((arrivals[-1] - start_s) / SAMPLE_STEP_S))
    even = start_s + SAMPLE_STEP_S * np.arange(max(count, 1))
    # An arrival at an even instant stands for it.
    nearest = np.abs(even[:, None] - arrivals[None, :])
    times = np.union1d(even[nearest.min(axis=1) > _SAME_TIME_S], arrivals)
    phase = (times - start_s) / SAMPLE_STEP_S
    return times, np.abs(phase - np.round(phase)) * SAMPLE_STEP_S <= _SAME_TIME_S


def motion_and_demand(path: PlannedPath, time: ScalarLike, gravity: ScalarLike) -> dict[str, Scalar]:
    """What the path of one aircraft asks at a time (s), by key of `anser.variables`; SI units and radians.

    Notes
    -----
    Bank angle and load factor are those of coordinated flight along the path: the part of the specific force across
    the velocity relative to the air (theory section 6).
    """
    point, air = path.at(time), path.air_velocity_n(time)
    position, ground, acceleration = point.position_n, point.velocity_n, point.acceleration_n
    over, through = polar(ground, acceleration), polar(air, acceleration)
    asked = demand(air, acceleration, gravity)
    return {
        "north": position[0],
        "east": position[1],
        "altitude": -position[2],
        "velocity_north": ground[0],
        "velocity_east": ground[1],
        "airspeed": through.V,
        "ground_speed": over.V,
        "course": through.chi,
        "ground_course": over.chi,
        "path_angle": through.gamma,
        "climb_rate": -air[2],
        "bank": asked.bank,
        "load_factor": asked.normal / gravity,
        "thrust_surplus": asked.along,
    }


@compiled_quickly
def _sample_demands(
    paths: PlannedPath, times: Float[Array, "aircraft block"], gravity: Scalar
) -> dict[str, Float[Array, "aircraft block"]]:
    def one(path: PlannedPath, instants: Float[Array, " block"]) -> dict[str, Scalar]:
        return jax.vmap(lambda time: motion_and_demand(path, time, gravity))(instants)

    return eqx.filter_vmap(one, in_axes=(eqx.if_array(0), 0))(paths, times)


def _sample_demands_in_blocks(paths: PlannedPath, times: np.ndarray, gravity: ScalarLike) -> dict[str, np.ndarray]:
    """What each path asks at its own times, (aircraft, time): fleets and blocks of few sizes, which seldom compile."""
    fleet, count = times.shape
    filled = np.pad(times, ((0, -fleet % FLEET_MULTIPLE), (0, -count % _BLOCK)), mode="edge")
    paths, weight = pad_to_multiple(paths, FLEET_MULTIPLE), as_array(gravity)
    blocks = [
        _sample_demands(paths, as_array(block), weight) for block in np.split(filled, filled.shape[1] // _BLOCK, axis=1)
    ]
    found = {key: np.concatenate([np.asarray(one[key]) for one in blocks], axis=1) for key in blocks[0]}
    return {key: values[:fleet, :count] for key, values in found.items()}


def sample_paths(
    paths: PlannedPath, arrival_times: np.ndarray, times_s: np.ndarray, gravity: ScalarLike
) -> dict[str, np.ndarray]:
    """What the paths of a fleet ask, by key of `anser.variables`; (time, aircraft), NaN after the arrival.

    Parameters
    ----------
    paths
        Stacked, leading axis aircraft.
    arrival_times
        (aircraft,), s.
    times_s
        (time,), s.
    gravity
        m/s^2.
    """
    arrivals = np.asarray(arrival_times)[:, None]
    found = _sample_demands_in_blocks(paths, np.minimum(np.asarray(times_s)[None, :], arrivals), gravity)
    under_way = np.asarray(times_s)[None, :] <= arrivals
    return {key: np.where(under_way, values, np.nan).T for key, values in found.items()}


def sample_extremes(
    paths: PlannedPath,
    start_s: float,
    arrival_times: np.ndarray,
    gravity: ScalarLike,
    limits: PathLimits | None = None,
) -> PlanExtremes:
    """Least and greatest of each path, from its start to its arrival; arguments as of `sample_paths`.

    With limits, the accelerations are those that ask as much of each aircraft at its start; else the paths' own.
    """
    duration = np.asarray(arrival_times) - start_s
    asked = _sample_demands_in_blocks(
        paths, start_s + duration[:, None] * np.linspace(0.0, 1.0, _FINE)[None, :], gravity
    )
    speed = asked["airspeed"]
    mean = np.trapezoid(speed, axis=1) / (_FINE - 1)
    values = {limit.key: limit.extreme(asked[limit.variable], 1) for limit in CERTIFIED_LIMITS}
    if limits is not None and limits.idle is not None:
        own = unstack_rows((limits.idle, limits.deceleration_max))
        rows = zip(own, asked["thrust_surplus"], speed, asked["load_factor"], strict=True)
        found = np.array([_along_at_start(*one, *row) for one, *row in rows])
        values |= {"thrust_surplus_max": found[:, 0], "thrust_deficit_max": found[:, 1]}
    return PlanExtremes(length=mean * duration, speed_mean=mean, values=values)


def _along_at_start(
    idle: IdleDeceleration, deceleration: ScalarLike, along: np.ndarray, speed: np.ndarray, load_factor: np.ndarray
) -> tuple[Any, Any]:
    """The greatest acceleration and deceleration of a path as `PathBounds.along_at_start` has them, m/s^2."""
    gained = along + deceleration * idle.rise(speed, load_factor)
    return np.max(gained), np.max(-along / idle.share(speed, load_factor))


def sample_plan(
    paths: PlannedPath,
    start_s: float,
    arrival_times: np.ndarray,
    gravity: ScalarLike,
    goal_positions_n: np.ndarray,
    times: tuple[np.ndarray, np.ndarray],
    separation_m: tuple[float, float] | None,
    keep_outs: tuple[KeepOut, ...],
    limits: PathLimits | None = None,
) -> PlanSamples:
    """Everything that is recorded of a plan.

    Parameters
    ----------
    paths
        Stacked, leading axis aircraft.
    start_s, arrival_times
        When all start and each arrives, s.
    gravity
        m/s^2.
    goals_n
        The aircraft's goals, (time, aircraft, NED axis), m.
    times
        As `sample_times` gives them.
    separation_m, keep_outs
        What a scenario asks for.
    limits
        As of `sample_extremes`.
    """
    history = sample_paths(paths, arrival_times, times[0], gravity)
    motion = sampled_motion(times[0], history)
    rooms, when = keep_out_margins(motion, keep_outs)
    under_way = times[0][:, None] <= np.asarray(arrival_times)[None, :]
    return PlanSamples(
        time_s=times[0],
        is_regular=times[1],
        arrival_times_s=np.asarray(arrival_times, dtype=float),
        history=history,
        goal_positions_n=np.where(under_way[:, :, None], goal_positions_n, np.nan),
        extremes=sample_extremes(paths, start_s, arrival_times, gravity, limits),
        closest_by_distance=nearest_pairs(motion, None),
        closest_by_separation=None if separation_m is None else nearest_pairs(motion, separation_m),
        keep_out_margin_m=rooms,
        keep_out_margin_time_s=when,
    )
