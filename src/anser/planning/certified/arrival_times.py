"""Arrival times that an aircraft can meet: necessary conditions, reachable intervals, search for the earliest time.

An arrival time is admissible if it meets the necessary conditions: distance and climb are possible in the time, the
rendezvous is outside the keep-outs, and each pair of aircraft can be separated at the first arrival of the pair. An
arrival time is reachable if the aircraft, alone in its airspace, has a path for it. Durations are times from the start
of the plan to the arrival.
"""

from collections.abc import Generator, Iterator, Sequence
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.compiling.options import compiled_by_older_generator, compiled_quickly
from anser.compiling.program import PreparedProgram
from anser.environment.environment import AbstractWind, LayeredWind
from anser.numerics.arrays import as_array, take_rows
from anser.parts.planners import time_to_go
from anser.planning.certified.candidates import aircraft_candidates
from anser.planning.certified.fitted_wind import wind_layers
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalTimes, Intervals
from anser.planning.certified.timed_profiles import (
    ALONE_SPLINES,
    ALONE_STANDARD,
    ALONE_TURN_LEG_PATHS,
    CandidateSet,
    profile_paths,
    speeds_for_mean,
)
from anser.planning.separation import separation_ratio
from anser.shapes import Flag, Integer, Scalar
from anser.spatial.vectors import norm

_STEP_UP, _FIRST_STEP = 1.12, 1.06  # ratio of consecutive times, and of the first tried to the first admissible time
RESOLUTION = 1.01
"""Ratio of the first feasible to the last infeasible arrival time at which the bisection of `earlier_times` stops."""


def first_index(count: int, one_by_one: int = 1) -> Generator[int, bool | None, int | None]:
    """Search a list of `count` rising times for the first feasible time; a generator that asks its caller.

    The generator yields the index of a time, receives whether this time is feasible, and returns the index of the first
    feasible time; None if no tried time is feasible. The search goes index by index up to the index `one_by_one`, then
    in doubled steps up to a feasible time, and back by bisection.
    """
    low, index, step = -1, 0, 1
    while low < count - 1:
        index = min(low + step, count - 1)
        if (yield index):
            break
        low, step = index, 1 if index < one_by_one else 2 * step
    else:
        return None
    high = index
    while high - low > 1:
        middle = (low + high) // 2
        if (yield middle):
            high = middle
        else:
            low = middle
    return high


def earlier_times(admissible: Float[np.ndarray, " n"], latest_time: float) -> Generator[float, bool | None, float]:
    """Search for a feasible arrival time before the feasible `latest_time` (s); a generator that asks its caller.

    The generator yields a time (s), receives whether this time is feasible, and returns the earliest feasible time
    found, s, at most `latest_time`. `admissible` are the rising times (s) to choose from. The search goes upward in
    steps of 12 percent to a feasible time, then by bisection, until the ratio of the feasible to the infeasible time is
    at most `RESOLUTION`.
    """
    if admissible.size == 0 or latest_time <= admissible[0]:
        return latest_time
    # Feasible times may have gaps, hence the steps before the bisection.
    low, high, margin = float(admissible[0]), latest_time, float(np.sqrt(RESOLUTION))
    count = int(np.ceil(np.log(high / low) / np.log(_STEP_UP)))
    steps = np.searchsorted(admissible, low * _FIRST_STEP * _STEP_UP ** np.arange(count))
    ascending_times = np.unique(admissible[np.minimum(steps, admissible.size - 1)])
    for time in ascending_times[ascending_times < high / margin]:
        if (yield float(time)):
            high = float(time)
            break
        low = float(time)
    while high > RESOLUTION * low:
        between = admissible[(admissible > low * margin) & (admissible < high / margin)]
        if between.size == 0:
            break
        middle = float(between[np.argmin(np.abs(np.log(between**2 / (low * high))))])
        if (yield middle):
            high = middle
        else:
            low = middle
    return high


_ALTITUDES = 65  # samples for the greatest wind speed
_WIND_FACTOR = 1.02
_EDGE_M = 1.0  # depth inside a keep-out or a separation up to which the certificate decides
_ALTITUDE_MARGIN_M = 1000.0  # above and below the endpoints: the range of detours in altitude


def _strongest_wind(tasks: AircraftTask, airspace: Airspace) -> tuple[float, float]:
    """Return the greatest wind speed and the greatest vertical wind speed, m/s, at the altitudes of the flight.

    The altitudes range from 1000 m below the lowest to 1000 m above the highest start or initial rendezvous. If a goal
    climbs, the range extends up to the highest layer of the wind; if a goal descends, down to the lowest layer.
    """
    altitudes = -np.append(np.asarray(tasks.rendezvous_n)[:, 2], np.asarray(tasks.position_n)[:, 2])
    low, high = np.min(altitudes) - _ALTITUDE_MARGIN_M, np.max(altitudes) + _ALTITUDE_MARGIN_M
    layers = wind_layers(airspace.wind)
    if isinstance(layers, LayeredWind):
        goal_down_rates = np.asarray(tasks.goal_velocity_n)[np.asarray(tasks.active) > 0.0, 2]
        low = min(low, float(layers.altitudes[0])) if np.any(goal_down_rates > 0.0) else low
        high = max(high, float(layers.altitudes[-1])) if np.any(goal_down_rates < 0.0) else high
    heights = np.linspace(low, high, _ALTITUDES)
    if isinstance(layers, LayeredWind):  # linear between its altitudes
        heights = np.append(heights, np.clip(np.asarray(layers.altitudes), low, high))
    whole, vertical = _greatest_wind(airspace.wind, as_array(heights))
    return _WIND_FACTOR * float(whole), _WIND_FACTOR * float(vertical)


@compiled_quickly
def _greatest_wind(wind: AbstractWind, heights: Float[Array, " n"]) -> tuple[Scalar, Scalar]:
    winds = jax.vmap(lambda h: wind.at(jnp.stack([0.0 * h, 0.0 * h, -h]), 0.0))(heights)
    return jnp.max(jnp.linalg.norm(winds, axis=1)), jnp.max(jnp.abs(winds[:, 2]))


@compiled_quickly
def straight_times(tasks: AircraftTask, airspace: Airspace) -> Float[Array, " aircraft"]:
    """Compute each aircraft's flight time, s, straight to its moving rendezvous at the preferred mean airspeed.

    The wind is taken halfway between the start and the initial rendezvous. If the rendezvous outruns the aircraft, the
    time is the initial distance over the airspeed.
    """

    def straight_time(task: AircraftTask) -> Scalar:
        line = task.rendezvous_n - task.position_n
        wind_n = airspace.wind.at(task.position_n + 0.5 * line, 0.0)
        time, exists = time_to_go(line, task.goal_velocity_n - wind_n, task.speed)
        return jnp.where(exists, time, norm(line) / task.speed)

    return jax.vmap(straight_time)(tasks)


def climb_times_min(tasks: AircraftTask, airspace: Airspace) -> Float[np.ndarray, " aircraft"]:
    """Return a lower bound, s, of each aircraft's time from its start altitude to the altitude of its rendezvous.

    The bound holds for any path, in the strongest vertical wind. It is zero for a rendezvous at the start altitude, and
    infinite if the rendezvous moves away too fast.
    """
    rate = np.asarray(tasks.limits.climb_rate_max) + _strongest_wind(tasks, airspace)[1]
    fall = (np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n))[:, 2]
    closing = rate - np.sign(fall) * np.asarray(tasks.goal_velocity_n)[:, 2]
    return np.where(closing > 0.0, np.abs(fall) / np.maximum(closing, 1e-9), np.where(fall == 0.0, 0.0, np.inf))


def may_arrive(
    tasks: AircraftTask, airspace: Airspace, aircraft: Int[np.ndarray, " pairs"], durations: Float[np.ndarray, " pairs"]
) -> Bool[np.ndarray, " pairs"]:
    """Return whether an arrival of aircraft `aircraft[k]` after `durations[k]` (s) meets the necessary conditions.

    At the greatest airspeed and climb rate, in the strongest wind, the aircraft must reach the rendezvous, which must
    then be outside the keep-outs. `aircraft` are indices into the tasks.
    """
    limits, t = tasks.limits, durations[:, None]
    line = (np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n))[aircraft] + t * np.asarray(
        tasks.goal_velocity_n
    )[aircraft]
    wind, vertical_wind = _strongest_wind(tasks, airspace)
    reachable_in_time = (
        np.linalg.norm(line[:, :2], axis=1) <= (np.asarray(limits.speed_max)[aircraft] + wind) * durations
    )
    climbable_in_time = np.abs(line[:, 2]) <= (np.asarray(limits.climb_rate_max)[aircraft] + vertical_wind) * durations
    arrival_positions, volumes = np.asarray(tasks.position_n)[aircraft] + line, airspace.keep_outs
    moved = np.asarray(volumes.position_n)[None] + t[:, :, None] * np.asarray(volumes.velocity_n)[None]
    outside = np.linalg.norm(arrival_positions[:, None, :2] - moved, axis=2) >= np.asarray(volumes.radius) - _EDGE_M
    height = -arrival_positions[:, 2:]
    above = height >= np.asarray(volumes.top) - _EDGE_M
    below = height <= np.asarray(volumes.bottom) + _EDGE_M
    return reachable_in_time & climbable_in_time & np.all(outside | above | below, axis=1)


def arrival_distances_max(
    tasks: AircraftTask, airspace: Airspace, durations: Float[np.ndarray, "n aircraft"]
) -> tuple[Float[np.ndarray, "n aircraft aircraft"], Float[np.ndarray, "n aircraft aircraft"]]:
    """Return upper bounds, m, of the distances of each pair of aircraft when the first of the pair arrives.

    The bounds hold for any paths. Each row of `durations` is a set of arrival times, s after the start, one per
    aircraft. Returns the horizontal and the vertical distances, (set, aircraft, aircraft); infinite on the diagonal and
    for inactive aircraft.
    """
    # The second aircraft is away from its rendezvous by at most the distance that it flies until its own arrival.
    limits, (wind, vertical_wind) = tasks.limits, _strongest_wind(tasks, airspace)
    rendezvous = np.asarray(tasks.rendezvous_n)
    arrival_positions = rendezvous + durations[:, :, None] * np.asarray(tasks.goal_velocity_n)
    separations = arrival_positions[:, :, None] - arrival_positions[:, None, :]
    time_between = durations[:, :, None] - durations[:, None, :]

    def covered(rate: Float[np.ndarray, " aircraft"], wind: float) -> Float[np.ndarray, "n aircraft aircraft"]:
        # The clipped rate keeps the product zero for equal times, even for an infinite limit.
        rate_with_wind = np.minimum(rate, 1e9) + wind
        return np.where(time_between > 0.0, rate_with_wind[:, None], rate_with_wind[None, :]) * np.abs(time_between)

    active = np.asarray(tasks.active) > 0.0
    ignored = np.eye(active.size, dtype=bool) | ~active[:, None] | ~active[None, :]
    horizontal = np.linalg.norm(separations[..., :2], axis=-1) + covered(np.asarray(limits.speed_max), wind)
    vertical = np.abs(separations[..., 2]) + covered(np.asarray(limits.climb_rate_max), vertical_wind)
    return np.where(ignored, np.inf, horizontal), np.where(ignored, np.inf, vertical)


def arrival_conflicts(
    tasks: AircraftTask, airspace: Airspace, durations: Float[np.ndarray, "n aircraft"]
) -> Bool[np.ndarray, "n aircraft aircraft"]:
    """Return the mask (set, aircraft, aircraft) of pairs that violate the separation whatever their paths are.

    Each pair is compared when its first aircraft arrives. Each row of `durations` is a set of arrival times, s after
    the start, one per aircraft.
    """
    horizontal, vertical = float(airspace.separation.horizontal), float(airspace.separation.vertical)
    level, height = arrival_distances_max(tasks, airspace, durations)
    return separation_ratio(level + _EDGE_M, height + _EDGE_M, horizontal, vertical) < 1.0


_PLAIN_ROUNDS, _ROUNDS_MAX = 8, 32  # rounds of the iteration for the time of a direct path
_CHANGE_MAX = 1e-6  # of the time in the last round, as a ratio
_GAIN_MIN, _GAIN_MAX = 0.5, 20.0  # of an accelerated step over that of the plain iteration
_STRETCH = 3.0  # greatest change of the time, as a factor, in one round of the fixed-point iteration
_BATCH_SIZE = 32  # pairs of aircraft and time per call
_WINDOW_SAMPLES = 12  # grid points per window
_GRID_NEIGHBOURS = 3  # distance in grid steps from a reachable time within which costlier candidates are tried
_GROUND_SPEED_FACTOR = 1.4  # closing speed over airspeed of the grid's first time; more with a stronger tail wind
COARSE_INTERVALS = 128
"""Number of intervals between the knots of a path in the test of `reachable`, which is coarser than a certificate."""


@compiled_by_older_generator(("intervals",), "arrival times")
def direct_times(
    tasks: AircraftTask, airspace: Airspace, speeds: Float[Array, " aircraft"], intervals: int
) -> tuple[Float[Array, " aircraft"], Bool[Array, " aircraft"]]:
    """Compute the flight time (s) of each aircraft's shortest direct path at its mean airspeed `speeds` (m/s).

    The time is found by iteration. The second result is the mask of the aircraft for which a direct path exists and the
    last step of the iteration is less than a millionth of the time. `intervals` is the number of intervals of the
    tabulated profile.
    """

    # A fixed-point iteration, because the goal moves and the air drifts during the flight; from the ninth round on, the
    # secant method extrapolates the steps, which shrink slowly against strong wind.
    def solve_task(task: AircraftTask, speed: Scalar) -> tuple[Scalar, Array]:
        line = task.rendezvous_n - task.position_n
        initial_duration = jnp.maximum(jnp.sqrt(jnp.sum(line**2)) / speed, 5.0)

        def iterate(carry: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
            count, duration, previous_duration, previous_step, _ = carry
            speeds = speeds_for_mean(task, duration, speed)
            paths = profile_paths(task, airspace, duration, intervals, 0.0, speeds)
            exists = paths.directs.exists[0]
            required_length = jnp.where(exists, paths.directs.length[0], paths.table.length)
            next_duration = duration * required_length / jnp.maximum(paths.table.length, 1.0)
            change = jnp.where(exists, jnp.abs(next_duration / duration - 1.0), jnp.inf)
            step = next_duration - duration
            decrease = previous_step - step
            gain = (duration - previous_duration) / jnp.where(decrease == 0.0, 1.0, decrease)
            extrapolated = duration + jnp.clip(gain, _GAIN_MIN, _GAIN_MAX) * step
            next_duration = jnp.where(count < _PLAIN_ROUNDS, next_duration, extrapolated)
            next_duration = jnp.clip(next_duration, duration / _STRETCH, duration * _STRETCH)
            return count + 1, next_duration, duration, step, change

        def is_unfinished(carry: tuple[Scalar, ...]) -> Flag:
            count, change = carry[0], carry[-1]
            may_improve = (change >= _CHANGE_MAX) & (change < jnp.inf) & (count < _ROUNDS_MAX)
            return (count < _PLAIN_ROUNDS) | may_improve

        unknown = jnp.asarray(jnp.inf)
        start = (jnp.asarray(0), initial_duration, initial_duration, unknown, unknown)
        _, duration, _, _, change = jax.lax.while_loop(is_unfinished, iterate, start)
        return duration, change < _CHANGE_MAX

    return jax.lax.map(lambda row: solve_task(*row), (tasks, speeds))


@compiled_by_older_generator(("intervals", "candidate_set"), "reachable arrivals")
def _reachable_at(
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " n"],
    count: Integer,
    intervals: int,
    candidate_set: CandidateSet,
) -> Bool[Array, " n"]:
    """Return whether each aircraft, alone in the airspace, has a candidate path of exactly its duration (s).

    A candidate path counts if it is valid and outside all keep-outs. Rows from `count` on are padding: False.
    """

    def check_reachable(k: Integer, reached: Bool[Array, " n"]) -> Bool[Array, " n"]:
        # Sequential: a batch would take as long, and a partly filled batch longer.
        task, times = jax.tree.map(lambda leaf: leaf[k], tasks), durations[k] / intervals * jnp.arange(intervals + 1)
        options = aircraft_candidates(task, airspace, durations[k], intervals, times, candidate_set)
        return reached.at[k].set(jnp.any(options.valid & (options.penetration <= 0.0)))

    return jax.lax.fori_loop(0, count, check_reachable, jnp.zeros(durations.shape, dtype=bool))


def reachable(
    tasks: AircraftTask,
    airspace: Airspace,
    aircraft: Int[np.ndarray, " pairs"],
    durations: Float[np.ndarray, " pairs"],
    intervals: int = COARSE_INTERVALS,
    levels: Sequence[CandidateSet] = (ALONE_STANDARD, ALONE_TURN_LEG_PATHS),
) -> Bool[np.ndarray, " pairs"]:
    """Return whether aircraft `aircraft[k]`, alone in the airspace, has a path that arrives after `durations[k]` (s).

    `aircraft` are indices into the tasks; `levels` are the candidate sets to try, the cheapest first; `intervals` is
    the number of equal intervals between the knots of a path.
    """
    reached = np.zeros(aircraft.size, dtype=bool)
    admissible = may_arrive(tasks, airspace, aircraft, durations)
    for candidate_set in levels:
        remaining = np.flatnonzero(admissible & ~reached)
        for begin in range(0, remaining.size, _BATCH_SIZE):
            # Padded to one size, so that one compiled program serves every batch.
            batch = remaining[begin : begin + _BATCH_SIZE]
            padded = np.resize(remaining[begin : begin + _BATCH_SIZE], _BATCH_SIZE)
            batch_tasks = take_rows(tasks, aircraft[padded])
            count, times = as_array(batch.size, np.int32), as_array(durations[padded])
            reached[batch] = np.asarray(_reachable_at(batch_tasks, airspace, times, count, intervals, candidate_set))[
                : batch.size
            ]
    return reached


def prepare_reachable(tasks: AircraftTask, airspace: Airspace) -> Iterator[PreparedProgram]:
    """Yield the compiled programs that `reachable` calls with its default arguments, one at a time."""
    batch_tasks, times = take_rows(tasks, np.zeros(_BATCH_SIZE, dtype=int)), as_array(np.zeros(_BATCH_SIZE))
    for candidate_set in (ALONE_STANDARD, ALONE_TURN_LEG_PATHS):
        count = as_array(1, np.int32)
        yield _reachable_at.prepare(batch_tasks, airspace, times, count, COARSE_INTERVALS, candidate_set)


def _open_times(
    tasks: AircraftTask,
    airspace: Airspace,
    fleet: Int[np.ndarray, " active"],
    grid: Float[np.ndarray, "active n"],
    splines_for: Literal["none", "unreached", "all"],
) -> Bool[np.ndarray, "active n"]:
    """Return the mask of the reachable times of `grid`, (aircraft, time), s; `fleet` has the indices of the aircraft.

    Every time is tested with the cheap candidates, `ALONE_STANDARD`. Turn-and-leg paths, then splines, are tried for
    the remaining times within three grid steps of a reachable or an inadmissible time, and for all times of an aircraft
    without a reachable time. `splines_for` selects the aircraft for which splines are tried; "unreached" are the
    aircraft without a reachable time after the other candidates.
    """
    aircraft = np.repeat(fleet, grid.shape[1]).reshape(grid.shape)
    inside = reachable(tasks, airspace, aircraft.ravel(), grid.ravel(), levels=(ALONE_STANDARD,)).reshape(grid.shape)
    ruled_out = ~may_arrive(tasks, airspace, aircraft.ravel(), grid.ravel()).reshape(grid.shape)
    for candidate_set in (ALONE_TURN_LEG_PATHS,) if splines_for == "none" else (ALONE_TURN_LEG_PATHS, ALONE_SPLINES):
        tried = np.zeros(grid.shape, dtype=bool)
        while True:
            # Inadmissible times count as decided, so that the search continues beyond them.
            decided = inside | ruled_out
            neighbours = np.stack(
                [np.convolve(flags, np.ones(2 * _GRID_NEIGHBOURS + 1), "same") > 0.5 for flags in decided]
            )
            neighbours |= ~inside.any(axis=1, keepdims=True)
            if candidate_set is ALONE_SPLINES and splines_for == "unreached":
                neighbours &= ~inside.any(axis=1, keepdims=True)
            queries = neighbours & ~inside & ~tried
            if not queries.any():
                break
            tried |= queries
            inside[queries] = reachable(tasks, airspace, aircraft[queries], grid[queries], levels=(candidate_set,))
    return inside


def arrival_sets(
    tasks: AircraftTask,
    airspace: Airspace,
    latest_s: float,
    windows_s: Float[np.ndarray, "aircraft 2"] | None = None,
    with_splines: bool = False,
    count: int = 40,
    rounds: int = 6,
) -> list[list[tuple[float, float]]]:
    """Return each aircraft's intervals (first, last) of reachable arrival times, s after the start.

    Arrival times are tested on a grid: `count` times in geometric steps up to `latest_s`, or 12 uniform times in each
    aircraft's window (`windows_s`: earliest and latest time, s). The test can miss intervals, and gaps between
    intervals, that are narrower than a grid step. Every edge of an interval is refined by `rounds` bisections. Without
    windows, the last interval ends at infinity if `latest_s` is reachable. An inactive aircraft has no intervals.

    If `with_splines` is True, splines are tried where the other generators of paths fail. If False, splines are tried
    only in windows, for an aircraft without any reachable time.
    """
    if windows_s is not None:
        low = windows_s[:, 0]
        grid = low[:, None] + (windows_s[:, 1] - low)[:, None] * np.linspace(0.0, 1.0, _WINDOW_SAMPLES)[None, :]
    else:
        distance = np.linalg.norm(np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n), axis=1)
        speed_max, goal_speed = np.asarray(tasks.limits.speed_max), np.linalg.norm(tasks.goal_velocity_n, axis=1)
        wind_max, _ = _strongest_wind(tasks, airspace)
        closing = np.maximum(_GROUND_SPEED_FACTOR * speed_max, speed_max + wind_max + goal_speed)
        low = np.clip(distance / closing, 2.0, 0.9 * latest_s)
        grid = low[:, None] * (latest_s / low)[:, None] ** np.linspace(0.0, 1.0, count)[None, :]
    fleet = np.flatnonzero(np.asarray(tasks.active) > 0.0)
    inside = np.zeros(grid.shape, dtype=bool)
    splines_for = "all" if with_splines else "none" if windows_s is None else "unreached"
    inside[fleet] = _open_times(tasks, airspace, fleet, grid[fleet], splines_for)
    aircraft, edge = np.nonzero(inside[:, 1:] != inside[:, :-1])
    low, high, opening = grid[aircraft, edge], grid[aircraft, edge + 1], inside[aircraft, edge + 1]
    levels = (ALONE_STANDARD, ALONE_TURN_LEG_PATHS, *([ALONE_SPLINES] if with_splines else []))
    for _ in range(rounds if aircraft.size else 0):
        middle = 0.5 * (low + high)
        lower = reachable(tasks, airspace, aircraft, middle, levels=levels) != opening
        low, high = np.where(lower, middle, low), np.where(lower, high, middle)
    edge_times = np.where(opening, high, low)  # the reachable side of each edge
    refined: list[list[tuple[float, float]]] = []
    for k in range(grid.shape[0]):
        end = float("inf") if windows_s is None else float(grid[k, -1])
        edges = [float(x) for x in edge_times[aircraft == k]]
        bounds = ([float(grid[k, 0])] if inside[k, 0] else []) + edges + ([end] if inside[k, -1] else [])
        refined.append(list(zip(bounds[::2], bounds[1::2], strict=True)))
    return refined


def common_times(arrivals: Sequence[Intervals], offsets_s: ArrivalTimes) -> Intervals:
    """Return the intervals of times T, s after the start, for which each aircraft can arrive at T plus its offset (s).

    `arrivals` has the reachable intervals of each aircraft.
    """
    common: Intervals = [(0.0, float("inf"))]
    for intervals, offset in zip(arrivals, offsets_s, strict=True):
        first_arrivals = [(a - offset, b - offset) for a, b in intervals]
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in first_arrivals if max(a, c) <= min(b, d)]
    return common


def sample_interval(low: float, high: float) -> list[float]:
    """Return 11 times, s, from `low` to `high` (s) or to 2.5 `low` + 10 s, whichever is earlier; densest near `low`.

    An interval of length 0 gives `low` alone.
    """
    if not high > low:
        return [low]
    top = min(high, 2.5 * low + 10.0)
    return [low + (top - low) * u for u in (0.0, 0.002, 0.01, 0.03, 0.07, 0.14, 0.25, 0.4, 0.6, 0.8, 1.0)]
