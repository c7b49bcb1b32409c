"""When each aircraft can be at its rendezvous: the arrival times that its limits and the keep-outs allow."""

from collections.abc import Sequence
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.compiling import compiled_by_older_generator
from anser.numerics import as_array, rows_at
from anser.planning.certified.candidate_sets import ALONE_SPLINES, ALONE_STANDARD, ALONE_TURN_LEG_PATHS, CandidateSet
from anser.planning.certified.candidates import fleet_candidates
from anser.planning.certified.necessary_conditions import may_arrive
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.timed_profile import steady_after, timed_profile
from anser.shapes import Count, Scalar

ROUNDS = 8
_STRETCH = 3.0  # of the time, at most, in one round of the fixed point
_AT_ONCE = 32  # aircraft and times looked at in one call, at most
_IN_WINDOW = 12  # times looked at in a window
_NEAR = 3  # steps of the grid from a time that is open, within which all is tried
_OVER_GROUND = 1.4  # wind behind and a goal that comes nearer: no aircraft is faster than so many times its airspeed
COARSE_INTERVALS = 128
"""Intervals of the paths that tell which times are open: they only say where to look."""


@compiled_by_older_generator(static_argnames=("intervals",))
def direct_times(
    tasks: AircraftTask, airspace: Airspace, speeds: Float[Array, " aircraft"], intervals: int
) -> tuple[Float[Array, " aircraft"], Bool[Array, " aircraft"]]:
    """Time of the shortest direct path at a mean airspeed (m/s), s, and whether it was found.

    A fixed point: the goal moves on, and the air drifts, while the aircraft is on its way.
    """

    def one(task: AircraftTask, speed: Scalar) -> tuple[Scalar, Array]:
        line = task.rendezvous_n - task.position_n
        first = jnp.maximum(jnp.sqrt(jnp.sum(line**2)) / speed, 5.0)

        def once(_: object, carry: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            duration, _ = carry
            speeds = steady_after(task, duration, speed)
            timed = timed_profile(task, airspace, duration, intervals, jnp.zeros(()), speeds)
            wanted = jnp.where(timed.direct.exists[0], timed.direct.length[0], timed.table.length)
            found = duration * wanted / jnp.maximum(timed.table.length, 1.0)
            return jnp.clip(found, duration / _STRETCH, duration * _STRETCH), jnp.abs(found / duration - 1.0)

        duration, change = jax.lax.fori_loop(0, ROUNDS, once, (first, jnp.asarray(jnp.inf)))
        return duration, change < 1e-6

    return jax.vmap(one)(tasks, speeds)


@compiled_by_older_generator(static_argnames=("intervals", "candidate_set"))
def _reachable_at(
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " n"],
    count: Count,
    intervals: int,
    candidate_set: CandidateSet,
) -> Bool[Array, " n"]:
    """Whether each of the aircraft of the first `count` tasks, alone, can take its duration (s); no for the others."""

    def look(k: Count, found: Bool[Array, " n"]) -> Bool[Array, " n"]:
        # One after the other: batched they take as long, and batches that are not full take longer.
        one = jax.tree.map(lambda leaf: leaf[k][None], tasks)
        options = fleet_candidates(one, airspace, durations[k][None], intervals, intervals, candidate_set)
        return found.at[k].set(jnp.any(options.valid & (options.penetration <= 0.0)))

    return jax.lax.fori_loop(0, count, look, jnp.zeros(durations.shape, dtype=bool))


def reachable(
    tasks: AircraftTask,
    airspace: Airspace,
    who: Int[np.ndarray, " pairs"],
    durations: Float[np.ndarray, " pairs"],
    intervals: int = COARSE_INTERVALS,
    levels: Sequence[CandidateSet] = (ALONE_STANDARD, ALONE_TURN_LEG_PATHS),
) -> Bool[np.ndarray, " pairs"]:
    """Whether aircraft `who`, alone in its airspace, can arrive after a duration (s); any number of such questions."""
    found = np.zeros(who.size, dtype=bool)
    admissible = may_arrive(tasks, airspace, who, durations)
    for candidate_set in levels:
        left = np.flatnonzero(admissible & ~found)
        for begin in range(0, left.size, _AT_ONCE):
            # Filled up to one size: one compiled program for all.
            some, filled = left[begin : begin + _AT_ONCE], np.resize(left[begin : begin + _AT_ONCE], _AT_ONCE)
            asked = rows_at(tasks, who[filled])
            count, times = as_array(some.size, np.int32), as_array(durations[filled])
            found[some] = np.asarray(_reachable_at(asked, airspace, times, count, intervals, candidate_set))[
                : some.size
            ]
    return found


def _open_times(
    tasks: AircraftTask,
    airspace: Airspace,
    fleet: Int[np.ndarray, " active"],
    grid: Float[np.ndarray, "active n"],
    splines_for: Literal["none", "unreached", "all"],
) -> Bool[np.ndarray, "active n"]:
    """Which times of a grid are open: standard candidates everywhere, others near the times found so far, ever farther.

    Splines are looked for too for "all" aircraft, or for the "unreached" only, which have no time yet.
    """
    who = np.repeat(fleet, grid.shape[1]).reshape(grid.shape)
    inside = reachable(tasks, airspace, who.ravel(), grid.ravel(), levels=(ALONE_STANDARD,)).reshape(grid.shape)
    ruled_out = ~may_arrive(tasks, airspace, who.ravel(), grid.ravel()).reshape(grid.shape)
    for candidate_set in (ALONE_TURN_LEG_PATHS,) if splines_for == "none" else (ALONE_TURN_LEG_PATHS, ALONE_SPLINES):
        tried = np.zeros(grid.shape, dtype=bool)
        while True:
            # On the far side of times that are ruled out there may be others.
            known = inside | ruled_out
            near = np.stack([np.convolve(row, np.ones(2 * _NEAR + 1), "same") > 0.5 for row in known])
            near |= ~inside.any(axis=1, keepdims=True)
            if candidate_set is ALONE_SPLINES and splines_for == "unreached":
                near &= ~inside.any(axis=1, keepdims=True)
            asked = near & ~inside & ~tried
            if not asked.any():
                break
            tried |= asked
            inside[asked] = reachable(tasks, airspace, who[asked], grid[asked], levels=(candidate_set,))
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
    """For each aircraft the arrival times (s after the start) up to a latest that are open to it, as intervals.

    A grid, geometric from the earliest conceivable time on or even within each one's window; each edge is then refined
    by bisection to a `2**rounds`-th of the grid's spacing. Gaps and islands narrower than the grid can be missed.
    With splines, these are tried too where nothing else will do; in windows they are anyway, for an aircraft that
    has no time at all.
    """
    if windows_s is not None:
        low = windows_s[:, 0]
        grid = low[:, None] + (windows_s[:, 1] - low)[:, None] * np.linspace(0.0, 1.0, _IN_WINDOW)[None, :]
    else:
        distance = np.linalg.norm(np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n), axis=1)
        low = np.clip(distance / (_OVER_GROUND * np.asarray(tasks.limits.speed_max)), 2.0, 0.9 * latest_s)
        grid = low[:, None] * (latest_s / low)[:, None] ** np.linspace(0.0, 1.0, count)[None, :]
    fleet = np.flatnonzero(np.asarray(tasks.active) > 0.0)
    inside = np.zeros(grid.shape, dtype=bool)
    splines_for = "all" if with_splines else "none" if windows_s is None else "unreached"
    inside[fleet] = _open_times(tasks, airspace, fleet, grid[fleet], splines_for)
    row, edge = np.nonzero(inside[:, 1:] != inside[:, :-1])
    low, high, opening = grid[row, edge], grid[row, edge + 1], inside[row, edge + 1]
    levels = (ALONE_STANDARD, ALONE_TURN_LEG_PATHS, *([ALONE_SPLINES] if with_splines else []))
    for _ in range(rounds if row.size else 0):
        middle = 0.5 * (low + high)
        lower = reachable(tasks, airspace, row, middle, levels=levels) != opening
        low, high = np.where(lower, middle, low), np.where(lower, high, middle)
    at = np.where(opening, high, low)  # the end of each edge that lies inside
    refined: list[list[tuple[float, float]]] = []
    for k in range(grid.shape[0]):
        end = float("inf") if windows_s is None else float(grid[k, -1])
        own = [float(x) for x in at[row == k]]
        bounds = ([float(grid[k, 0])] if inside[k, 0] else []) + own + ([end] if inside[k, -1] else [])
        refined.append(list(zip(bounds[::2], bounds[1::2], strict=True)))
    return refined
