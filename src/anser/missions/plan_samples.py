"""Samples of planned paths: motion, required bank and load factor, greatest and least values, closest approaches.

Between two samples a path is a cubic Hermite polynomial. The error is at most fourth derivative * interval^4 / 384:
below 1 mm on aircraft paths with samples every 0.5 s.
"""

import functools
from collections.abc import Mapping
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from anser.compiling.options import compiled, compiled_by_older_generator
from anser.numerics.arrays import as_array, pad_to_multiple, unstack_rows
from anser.parts.paths import PathPoint, polar
from anser.parts.planners import IdleDeceleration
from anser.planning.demand import demand
from anser.planning.limits import CERTIFIED_LIMITS, PathLimits
from anser.planning.separation import keep_out_room, separation_ratio
from anser.results.plan_record import ClosestApproach, PlanExtremes, PlanSamples
from anser.scenario.schema_airspace import KeepOut
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_hypot

_PAIRS_MAX = 64  # pairs examined between the samples: the pairs nearest at the samples
_SUBINTERVALS = 16  # parts of an interval between two samples; halved _HALVINGS times, down to rounding errors
_HALVINGS = 30


# arrays are padded to multiples of these sizes, which limits the number of compilations
FLEET_MULTIPLE, _TIMES_MULTIPLE, _VOLUMES_MULTIPLE = 4, 512, 2


class SampledMotion(eqx.Module):
    """Motion of a fleet over the ground at sample times, (time, aircraft, NED axis); NaN after each arrival."""

    times: Float[Array, " time"]  # sample times, s
    # positions, m, and velocities, m/s
    positions_n: Float[Array, "time aircraft 3"]
    velocities_n: Float[Array, "time aircraft 3"]


def sampled_motion(times_s: np.ndarray, history: Mapping[str, np.ndarray]) -> SampledMotion:
    """Return the motion of a fleet over the ground at `times_s` (s), from the result of `sample_paths`."""
    positions = np.stack([history["north"], history["east"], -history["altitude"]], axis=-1)
    velocities = np.stack([history[f"velocity_{axis}"] for axis in ("north", "east", "down")], axis=-1)
    return SampledMotion(*map(as_array, (times_s, positions, velocities)))


def _pad(motion: SampledMotion) -> SampledMotion:
    """Pad samples and aircraft to multiples of fixed sizes; padded motion is NaN."""
    sample_count, fleet_size = motion.positions_n.shape[:2]
    padding, fleet_padding = -sample_count % _TIMES_MULTIPLE, -fleet_size % FLEET_MULTIPLE
    sample_times = np.asarray(motion.times)
    times = np.concatenate([sample_times, sample_times[-1] + 1.0 + np.arange(padding)])
    states = (
        np.pad(np.asarray(state), ((0, padding), (0, fleet_padding), (0, 0)), constant_values=np.nan)
        for state in (motion.positions_n, motion.velocities_n)
    )
    return SampledMotion(*map(as_array, (times, *states)))


def _interpolate(
    times: Float[Array, " time"], positions: Float[Array, "time 3"], velocities: Float[Array, "time 3"], instant: Scalar
) -> Float[Array, "3"]:
    """Return the position at `instant` (s) on the cubic between two samples; NaN if one of the samples is NaN."""
    k = jnp.clip(jnp.searchsorted(times, instant, side="right") - 1, 0, times.shape[0] - 2)
    step = times[k + 1] - times[k]
    states = positions[k], positions[k + 1], velocities[k], velocities[k + 1]
    return _cubic(step, *states, (instant - times[k]) / step)


def _cubic(
    step: Array, position: Array, next_position: Array, velocity: Array, next_velocity: Array, u: Array
) -> Float[Array, "*batch 3"]:
    """Return the position (m) at the fraction `u` of an interval of `step` (s), on the cubic Hermite polynomial."""
    displacement = next_position - position
    c2 = 3.0 * displacement - step * (2.0 * velocity + next_velocity)
    c3 = step * (velocity + next_velocity) - 2.0 * displacement
    interpolated = position + u * (step * velocity + u * (c2 + u * c3))
    # Exactly at a sample the next sample is ignored: it may be after the arrival.
    return jnp.where(u == 0.0, position, interpolated)


def _fine_times(times: Float[Array, " time"]) -> Float[Array, " fine"]:
    inner = times[:-1, None] + (times[1:] - times[:-1])[:, None] * (jnp.arange(_SUBINTERVALS) / _SUBINTERVALS)[None, :]
    return jnp.concatenate([inner.ravel(), times[-1:]])


def _fine_positions(
    times: Float[Array, " time"], positions: Float[Array, "time 3"], velocities: Float[Array, "time 3"]
) -> Float[Array, "fine 3"]:
    """Return one aircraft's positions at `_fine_times`, m, on the cubics between the samples."""
    states = positions[:-1], positions[1:], velocities[:-1], velocities[1:]
    step, states = (times[1:] - times[:-1])[:, None, None], (state[:, None] for state in states)
    inner = _cubic(step, *states, (jnp.arange(_SUBINTERVALS) / _SUBINTERVALS)[None, :, None])
    return jnp.concatenate([inner.reshape(-1, 3), positions[-1:]])


def _distance(difference: Float[Array, "*batch 3"], separation: Float[Array, "2"]) -> Float[Array, "*batch"]:
    """Return the distance, m, between two aircraft whose positions differ by `difference` (NED, m).

    `separation` is the required horizontal and vertical separation, m. If `separation[0]` is 0, the result is the
    distance in space; if not, the result is separation[0] * (ratio of distance to required separation).
    """
    level = jnp.sqrt(difference[..., 0] ** 2 + difference[..., 1] ** 2)
    height = jnp.abs(difference[..., 2])
    scaled = separation[0] * separation_ratio(level, height, separation[0], separation[1])
    return jnp.where(separation[0] > 0.0, scaled, jnp.sqrt(level**2 + height**2))


@compiled
def _distances_at_samples(
    positions: Float[Array, "time aircraft 3"], separation: Float[Array, "2"]
) -> tuple[Float[Array, " time"], Int[Array, " time"], Float[Array, "aircraft aircraft"]]:
    """Return the least distance in the fleet at each sample, m, the nearest pair, and each pair's least distance, m.

    Distances are those of `_distance`; infinite if no pair is flying. The nearest pair is an index into the flattened
    (aircraft, aircraft) matrix. The third result is such a matrix, infinite on and below the diagonal.
    """
    fleet_size = positions.shape[1]
    is_pair = jnp.triu(jnp.ones((fleet_size, fleet_size), dtype=bool), 1)

    def step(minima: Array, position: Float[Array, "aircraft 3"]) -> tuple[Array, tuple[Array, Array]]:
        distances = _distance(position[:, None, :] - position[None, :, :], separation)
        distances = jnp.where(is_pair & jnp.isfinite(distances), distances, jnp.inf)
        pair_indices = jnp.argmin(distances)
        return jnp.minimum(minima, distances), (distances.ravel()[pair_indices], pair_indices)

    # One instant at a time: memory stays quadratic in the fleet size.
    minima, (distance, pair_indices) = lax.scan(step, jnp.full((fleet_size, fleet_size), jnp.inf), positions)
    return distance, pair_indices, minima


@compiled_by_older_generator(None)
def _closest_approaches(
    motion: SampledMotion, pairs: Int[Array, "pairs 2"], separation: Float[Array, "2"]
) -> tuple[Float[Array, " pairs"], Float[Array, " pairs"], Float[Array, "pairs 3"]]:
    """Compute the smallest distance of each pair of aircraft until the first arrival of the two, also between samples.

    Returns distances (m, see `_distance`; infinite if undefined), times (s), and the positions of the second aircraft
    relative to the first at these times (NED, m).
    """
    fine = _fine_times(motion.times)

    def closest_approach(pair: Int[Array, "2"]) -> tuple[Scalar, Scalar, Float[Array, "3"]]:
        difference = motion.positions_n[:, pair[1]] - motion.positions_n[:, pair[0]]
        rate = motion.velocities_n[:, pair[1]] - motion.velocities_n[:, pair[0]]

        def distance_at(time: Scalar) -> tuple[Scalar, Float[Array, "3"]]:
            difference_then = _interpolate(motion.times, difference, rate, time)
            distance = _distance(difference_then, separation)
            return jnp.where(jnp.isfinite(distance), distance, jnp.inf), difference_then

        distances = _distance(_fine_positions(motion.times, difference, rate), separation)
        k = jnp.argmin(jnp.where(jnp.isfinite(distances), distances, jnp.inf))
        low, middle, high = (fine[jnp.clip(k + step, 0, fine.shape[0] - 1)] for step in (-1, 0, 1))

        def bisect(_: int, bracket: tuple[Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar]:
            lower, best, upper = bracket
            candidates = jnp.stack([lower, 0.5 * (lower + best), best, 0.5 * (best + upper), upper])
            j = jnp.argmin(jax.vmap(lambda time: distance_at(time)[0])(candidates))
            return candidates[jnp.maximum(j - 1, 0)], candidates[j], candidates[jnp.minimum(j + 1, 4)]

        _, closest_time, _ = lax.fori_loop(0, _HALVINGS, bisect, (low, middle, high))
        distance, difference_then = distance_at(closest_time)
        return distance, closest_time, difference_then

    return lax.map(closest_approach, pairs)


def nearest_pairs(
    motion: SampledMotion,
    # required horizontal and vertical separation, m; distances are then separation_m[0] times the ratio of distance to
    # required separation (see `separation_ratio`). None: distances in space
    separation_m: tuple[float, float] | None,
) -> ClosestApproach:
    """Find the nearest pair of aircraft at every sample, and the closest approach of the whole plan.

    A pair counts until the first arrival of the two. Between the samples, only the 64 pairs that are nearest at the
    samples are examined. If there is no pair, distances and times are NaN, and indices are -1.
    """
    count, fleet = motion.positions_n.shape[:2]
    if fleet < 2:
        undefined = np.full(count, np.nan)
        return ClosestApproach(undefined, np.full((count, 2), -1), np.nan, (-1, -1), np.nan, np.nan, np.nan)
    measure, padded = as_array(separation_m or (0.0, 0.0)), _pad(motion)
    distance, pair_indices, minima = (np.asarray(x) for x in _distances_at_samples(padded.positions_n, measure))
    distance, pair_indices = distance[:count], pair_indices[:count]
    is_defined = np.isfinite(distance)
    pairs = np.stack(np.triu_indices(len(minima), 1), axis=1)
    candidates = pairs[np.argsort(minima[tuple(pairs.T)], kind="stable")[:_PAIRS_MAX]]
    distances, times, differences = (
        np.asarray(x) for x in _closest_approaches(padded, as_array(candidates, None), measure)
    )
    best = int(np.argmin(distances))
    pair = np.stack(np.unravel_index(pair_indices, minima.shape), axis=1)
    aircraft_a, aircraft_b = (int(k) for k in candidates[best])
    is_finite = bool(np.isfinite(distances[best]))
    return ClosestApproach(
        distance_m=np.where(is_defined, distance, np.nan),
        pair=np.where(is_defined[:, None], pair, -1),
        minimum_m=float(distances[best]) if is_finite else np.nan,
        minimum_pair=(aircraft_a, aircraft_b) if is_finite else (-1, -1),
        minimum_time_s=float(times[best]) if is_finite else np.nan,
        horizontal_m=float(np.hypot(differences[best, 0], differences[best, 1])) if is_finite else np.nan,
        vertical_m=float(abs(differences[best, 2])) if is_finite else np.nan,
    )


@compiled
def _keep_out_margins(
    motion: SampledMotion, volumes: Float[Array, "volumes 7"]
) -> tuple[Float[Array, "aircraft volumes"], Float[Array, "aircraft volumes"]]:
    fine = _fine_times(motion.times)

    def aircraft_margins(track: tuple[Float[Array, "time 3"], Float[Array, "time 3"]]) -> tuple[Array, Array]:
        positions = _fine_positions(motion.times, *track)

        def margin(volume: Float[Array, "7"]) -> tuple[Scalar, Scalar]:
            offset = positions[:, :2] - volume[None, 0:2] - fine[:, None] * volume[None, 2:4]
            margins = keep_out_room(jnp.sqrt(jnp.sum(offset**2, axis=1)), -positions[:, 2], *volume[4:])
            k = jnp.argmin(jnp.where(jnp.isfinite(margins), margins, jnp.inf))
            return margins[k], fine[k]

        return jax.vmap(margin)(volumes)

    return lax.map(aircraft_margins, (jnp.swapaxes(motion.positions_n, 0, 1), jnp.swapaxes(motion.velocities_n, 0, 1)))


def keep_out_margins(motion: SampledMotion, keep_outs: tuple[KeepOut, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return each aircraft's least distance from each keep-out, m, and its time, s; both (aircraft, keep-out).

    The distance (`keep_out_room`) is negative inside, and is evaluated at sixteen times per sampling interval.
    """
    if not keep_outs:
        empty = np.zeros((motion.positions_n.shape[1], 0))
        return empty, empty
    table = [
        (
            keep_out.north_m,
            keep_out.east_m,
            *keep_out.velocity_m_s()[:2],
            keep_out.radius_m,
            keep_out.bottom_m,
            keep_out.top_m,
        )
        for keep_out in keep_outs
    ]
    margins_and_times = _keep_out_margins(_pad(motion), pad_to_multiple(as_array(table), _VOLUMES_MULTIPLE))
    margins, times = (np.asarray(values)[: motion.positions_n.shape[1], : len(table)] for values in margins_and_times)
    return margins, times


SAMPLE_STEP_S = 0.5
"""Time between two samples of a recorded plan, s."""
_EXTREME_SAMPLES = 1024  # samples per path for its extremes: for most paths at least five a second
_BLOCK = 256
_SAME_TIME_S = 1e-6


class PlannedPath(Protocol):
    """Interface of a planned path, by which the paths of every planner are sampled; NED, SI units."""

    def at(self, time: ScalarLike) -> PathPoint:
        """Return position, velocity and acceleration over the ground at a time (s); NED, m, m/s, m/s^2."""
        ...

    def air_velocity_n(self, time: ScalarLike) -> Vector3:
        """Return the velocity relative to the air at a time (s), NED, m/s."""
        ...


def sample_times(start_s: float, arrival_times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the sample times from the start to the last arrival, s, and the mask of the regular times among them.

    Regular times are multiples of `SAMPLE_STEP_S` after the start; every arrival time is a sample time too.
    """
    arrivals = np.unique(arrival_times)
    count = int(np.ceil((arrivals[-1] - start_s) / SAMPLE_STEP_S))
    regular = start_s + SAMPLE_STEP_S * np.arange(max(count, 1))
    # An arrival at a regular sample time replaces this time.
    nearest = np.abs(regular[:, None] - arrivals[None, :])
    times = np.union1d(regular[nearest.min(axis=1) > _SAME_TIME_S], arrivals)
    phase = (times - start_s) / SAMPLE_STEP_S
    return times, np.abs(phase - np.round(phase)) * SAMPLE_STEP_S <= _SAME_TIME_S


def motion_and_demand(path: PlannedPath, time: ScalarLike, gravity: ScalarLike) -> dict[str, Scalar]:
    """Return the motion on a path at a time (s), and the required bank, load factors and thrust surplus, by key.

    The keys are those of `anser.variables`; SI units, rad. Bank angle and load factor hold for coordinated flight along
    the path (theory section 6).
    """
    path_point, air_velocity = path.at(time), path.air_velocity_n(time)
    position, ground_velocity, acceleration = path_point.position_n, path_point.velocity_n, path_point.acceleration_n
    over_ground, through_air = polar(ground_velocity, acceleration), polar(air_velocity, acceleration)
    path_demand = demand(air_velocity, acceleration, gravity)
    return {
        "north": position[0],
        "east": position[1],
        "altitude": -position[2],
        "velocity_north": ground_velocity[0],
        "velocity_east": ground_velocity[1],
        "velocity_down": ground_velocity[2],
        "airspeed": through_air.V,
        "ground_speed": safe_hypot(ground_velocity[0], ground_velocity[1]),
        "course": through_air.chi,
        "ground_course": over_ground.chi,
        "path_angle": through_air.gamma,
        "climb_rate": -air_velocity[2],
        "bank": path_demand.bank,
        "load_factor": path_demand.normal / gravity,
        "vertical_load_factor": path_demand.lift / gravity,
        "thrust_surplus": path_demand.along,
    }


@compiled_by_older_generator(None)
def _sample_demands(
    paths: PlannedPath, times: Float[Array, "aircraft block"], gravity: Scalar
) -> dict[str, Float[Array, "aircraft block"]]:
    def sample(path: PlannedPath, instants: Float[Array, " block"]) -> dict[str, Scalar]:
        return jax.vmap(lambda time: motion_and_demand(path, time, gravity))(instants)

    return eqx.filter_vmap(sample, in_axes=(eqx.if_array(0), 0))(paths, times)


def _sample_demands_in_blocks(paths: PlannedPath, times: np.ndarray, gravity: ScalarLike) -> dict[str, np.ndarray]:
    """Return the results of `motion_and_demand` for each path at its own `times` (s), (aircraft, time), by key."""
    fleet_size, count = times.shape
    padded_times = np.pad(times, ((0, -fleet_size % FLEET_MULTIPLE), (0, -count % _BLOCK)), mode="edge")
    paths, gravity_array = pad_to_multiple(paths, FLEET_MULTIPLE), as_array(gravity)
    blocks = [
        _sample_demands(paths, as_array(block), gravity_array)
        for block in np.split(padded_times, padded_times.shape[1] // _BLOCK, axis=1)
    ]
    sampled = {key: np.concatenate([np.asarray(values[key]) for values in blocks], axis=1) for key in blocks[0]}
    return {key: values[:fleet_size, :count] for key, values in sampled.items()}


def sample_paths(
    paths: PlannedPath,  # stacked, leading axis aircraft
    arrival_times: np.ndarray,  # (aircraft,), s
    times_s: np.ndarray,  # (time,), s
    gravity: ScalarLike,  # m/s^2
) -> dict[str, np.ndarray]:
    """Return the results of `motion_and_demand` on a fleet's paths by key, (time, aircraft); NaN after each arrival."""
    arrivals = np.asarray(arrival_times)[:, None]
    sampled = _sample_demands_in_blocks(paths, np.minimum(np.asarray(times_s)[None, :], arrivals), gravity)
    is_flying = np.asarray(times_s)[None, :] <= arrivals
    return {key: np.where(is_flying, values, np.nan).T for key, values in sampled.items()}


def sample_extremes(
    paths: PlannedPath,
    start_s: float,
    arrival_times: np.ndarray,
    gravity: ScalarLike,
    limits: PathLimits | None = None,
) -> PlanExtremes:
    """Compute the greatest or least values of the limited quantities, at 1024 equidistant times up to each arrival.

    Nothing is proven between these times. If `limits.idle` is set, the accelerations along the path are converted to
    level flight at the start airspeed, see `_along_at_start`.
    """
    duration = np.asarray(arrival_times) - start_s
    sampled = _sample_demands_in_blocks(
        paths, start_s + duration[:, None] * np.linspace(0.0, 1.0, _EXTREME_SAMPLES)[None, :], gravity
    )
    speed = sampled["airspeed"]
    mean = np.trapezoid(speed, axis=1) / (_EXTREME_SAMPLES - 1)
    values = {limit.key: limit.extreme(sampled[limit.variable], 1) for limit in CERTIFIED_LIMITS}
    if limits is not None and limits.idle is not None:
        idle_and_deceleration = unstack_rows((limits.idle, limits.deceleration_max))
        samples_by_aircraft = zip(
            idle_and_deceleration, sampled["thrust_surplus"], speed, sampled["load_factor"], strict=True
        )
        accelerations = np.array(
            [
                _along_at_start(*aircraft_values, *aircraft_samples)
                for aircraft_values, *aircraft_samples in samples_by_aircraft
            ]
        )
        values |= {"thrust_surplus_max": accelerations[:, 0], "thrust_deficit_max": accelerations[:, 1]}
    return PlanExtremes(length=mean * duration, speed_mean=mean, values=values)


def _along_at_start(
    idle: IdleDeceleration, deceleration: ScalarLike, along_path: np.ndarray, speed: np.ndarray, load_factor: np.ndarray
) -> tuple[Any, Any]:
    """Return a path's greatest acceleration and deceleration, m/s^2, converted to level flight at the start airspeed.

    `along_path`, `speed` and `load_factor` are samples of the path: acceleration along the path (m/s^2), airspeed (m/s)
    and load factor. `deceleration` is the limit at the start (m/s^2), and `idle` its relative change. A converted value
    keeps the limit at the start if and only if all samples keep the limits at their own airspeed and load factor.
    """
    accelerations = along_path + deceleration * idle.rise(speed, load_factor)
    return np.max(accelerations), np.max(-along_path / idle.share(speed, load_factor))


def sample_plan(
    paths: PlannedPath,  # stacked, leading axis aircraft
    # common start time, and arrival time of each aircraft, s
    start_s: float,
    arrival_times: np.ndarray,
    gravity: ScalarLike,  # m/s^2
    goal_positions_n: np.ndarray,  # positions of the goals, (time, aircraft, NED axis), m
    times: tuple[np.ndarray, np.ndarray],  # result of `sample_times`
    # requirements of the scenario
    separation_m: tuple[float, float] | None,
    keep_outs: tuple[KeepOut, ...],
    limits: PathLimits | None = None,  # as in `sample_extremes`
) -> PlanSamples:
    """Sample a plan: motion, required bank and load factor, greatest and least values, and closest approaches.

    Nothing is proven between the samples.
    """
    history = sample_paths(paths, arrival_times, times[0], gravity)
    motion = sampled_motion(times[0], history)
    margins, margin_times = keep_out_margins(motion, keep_outs)
    is_flying = times[0][:, None] <= np.asarray(arrival_times)[None, :]
    return PlanSamples(
        time_s=times[0],
        is_regular=times[1],
        arrival_times_s=np.asarray(arrival_times, dtype=float),
        history=history,
        goal_positions_n=np.where(is_flying[:, :, None], goal_positions_n, np.nan),
        extremes=sample_extremes(paths, start_s, arrival_times, gravity, limits),
        find_closest_by_distance=functools.partial(nearest_pairs, motion, None),
        closest_by_separation=None if separation_m is None else nearest_pairs(motion, separation_m),
        keep_out_margin_m=margins,
        keep_out_margin_time_s=margin_times,
    )
