"""When each aircraft can be at its rendezvous: the arrival times that its limits and the closed volumes allow."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.planning.certified.candidates import (
    FASTEST,
    MATCHED,
    PREFERRED,
    RACETRACK,
    SLOWEST,
    Choices,
    make_choices,
    timed_profile,
)
from anser.planning.certified.placement import make_options
from anser.planning.certified.request import Airspace, Traveller
from anser.shapes import Scalar

ROUNDS = 8
_STRETCH = 3.0  # of the time, at most, in one round of the fixed point
_HELPED = 1.4  # wind behind and a goal that comes nearer: no aircraft is faster than so many times its airspeed

ALONE = make_choices((PREFERRED, MATCHED, SLOWEST, FASTEST), (0.0,), (0, 1), (0, 1, 4, RACETRACK))
"""Candidates of an aircraft by itself: all ways round and every kind of speed, no detour in altitude."""


@functools.partial(jax.jit, static_argnames="ticks", compiler_options={"xla_cpu_use_fusion_emitters": False})
def direct_times(
    travellers: Traveller, airspace: Airspace, speeds: Float[Array, " aircraft"], ticks: int
) -> tuple[Float[Array, " aircraft"], Bool[Array, " aircraft"]]:
    """Time of the shortest direct path at a mean airspeed (m/s), s, and whether it was found.

    A fixed point: the goal moves on, and the air drifts, while the aircraft is on its way.
    """

    def one(traveller: Traveller, speed: Scalar) -> tuple[Scalar, Array]:
        line = traveller.goal_position_n + traveller.rendezvous.stand_off_n - traveller.position_n
        first = jnp.maximum(jnp.sqrt(jnp.sum(line**2)) / speed, 5.0)

        def once(_: object, carry: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            duration, _ = carry
            timed = timed_profile(traveller, airspace, duration, ticks, jnp.zeros(()), speed)
            wanted = jnp.where(timed.direct.exists[0], timed.direct.length[0], timed.table.length)
            found = duration * wanted / jnp.maximum(timed.table.length, 1.0)
            return jnp.clip(found, duration / _STRETCH, duration * _STRETCH), jnp.abs(found / duration - 1.0)

        duration, change = jax.lax.fori_loop(0, ROUNDS, once, (first, jnp.asarray(jnp.inf)))
        return duration, change < 1e-6

    return jax.vmap(one)(travellers, speeds)


@functools.partial(
    jax.jit, static_argnames=("ticks", "choices"), compiler_options={"xla_cpu_use_fusion_emitters": False}
)
def _reachable_at(
    travellers: Traveller, airspace: Airspace, durations: Float[Array, " aircraft"], ticks: int, choices: Choices
) -> Bool[Array, " aircraft"]:
    options = make_options(travellers, airspace, durations, ticks, ticks, choices)
    return jnp.any(options.candidates.valid & (options.closed <= 0.0), axis=1)


def reachable(
    travellers: Traveller,
    airspace: Airspace,
    durations: Float[np.ndarray, "aircraft times"],
    ticks: int,
    choices: Choices,
) -> Bool[np.ndarray, "aircraft times"]:
    """Whether each aircraft, alone in its airspace, can arrive after each of some durations (s)."""
    # One compiled program for any number of times.
    found = [_reachable_at(travellers, airspace, jnp.asarray(row), ticks, choices) for row in durations.T]
    return np.stack([np.asarray(row) for row in found], axis=1)


def arrival_sets(
    travellers: Traveller, airspace: Airspace, latest_s: float, ticks: int, count: int = 40, rounds: int = 6
) -> list[list[tuple[float, float]]]:
    """For each aircraft the arrival times (s after the start) up to a latest that are open to it, as intervals.

    A grid, geometric from the earliest conceivable time on; each edge is then refined by bisection to a
    `2**rounds`-th of the grid's spacing. Gaps and islands narrower than the grid can be missed.
    """
    line = travellers.goal_position_n + travellers.rendezvous.stand_off_n - travellers.position_n
    distance = np.linalg.norm(np.asarray(line), axis=1)
    low = np.clip(distance / (_HELPED * np.asarray(travellers.limits.speed_max)), 2.0, 0.9 * latest_s)
    grid = low[:, None] * (latest_s / low)[:, None] ** np.linspace(0.0, 1.0, count)[None, :]
    inside = reachable(travellers, airspace, grid, ticks, ALONE)
    refined: list[list[tuple[float, float]]] = []
    changes = inside[:, 1:] != inside[:, :-1]
    most = int(np.max(np.sum(changes, axis=1), initial=0))
    where = [np.flatnonzero(row) for row in changes]
    lows, highs = np.ones((grid.shape[0], most)), np.full((grid.shape[0], most), 2.0)
    for k, edges in enumerate(where):
        lows[k, : edges.size], highs[k, : edges.size] = grid[k, edges], grid[k, edges + 1]
    lows, highs = np.where(lows == 1.0, low[:, None], lows), np.where(highs == 2.0, low[:, None], highs)
    for _ in range(rounds if most else 0):
        middle = 0.5 * (lows + highs)
        good = reachable(travellers, airspace, middle, ticks, ALONE)
        for k, edges in enumerate(where):
            opening = inside[k, edges + 1]  # from outside to inside
            n = edges.size
            lower = good[k, :n] != opening
            lows[k, :n] = np.where(lower, middle[k, :n], lows[k, :n])
            highs[k, :n] = np.where(lower, highs[k, :n], middle[k, :n])
    for k, edges in enumerate(where):
        # The end of each edge that lies inside.
        at = [float(highs[k, n] if inside[k, e + 1] else lows[k, n]) for n, e in enumerate(edges)]
        bounds = ([float(grid[k, 0])] if inside[k, 0] else []) + at + ([float("inf")] if inside[k, -1] else [])
        refined.append(list(zip(bounds[::2], bounds[1::2], strict=True)))
    return refined
