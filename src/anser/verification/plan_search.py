"""Second search for any feasible plan, and proofs that there is none: what may refute a refusal of the planner."""

import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from anser.verification.plan_bounds import PossibleTimes, arrival_offsets, possible_times
from anser.verification.plan_check import dense_check
from anser.verification.plan_data import Paths, PlanCase
from anser.verification.plan_fleet import Member, choose_members, part_members, solve_single
from anser.verification.plan_guesses import guess_path
from anser.verification.plan_spline import SplineFlight

__all__ = ["SearchResult", "second_search"]

_STAMP = 0.5
"""Time between the instants at which separation and keep-outs are looked at during the search, s."""
_LATE = 3.0
"""Without a time set by the rule, arrivals up to so many times the earliest possible, and _LATE_EXTRA_S, are tried."""
_LATE_EXTRA_S = 120.0
_COARSE = 0.02
"""Step of the first check, s: what fails here need not be looked at every millisecond."""
_POOL = 3
"""Single paths wanted per aircraft before they are put together."""
_POOL_MOST = 10
"""A pool that is full gives one up, drawn by lot, for a new one."""
_TRIES = 8
"""Starts per aircraft and round."""
_LONE_ROUNDS = 30
"""Where times are fixed, rounds of _TRIES starts without a path for one aircraft alone after which none is expected."""
_TRIES_OPEN = 4
"""The same where another arrival time may do: better to try that."""


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search."""

    status: str
    """"found", "proved" (impossible) or "not found"."""
    paths: Paths | None
    """A plan that passed `dense_check`; None without one."""
    arrival_times: Float[np.ndarray, " aircraft"] | None
    """s."""
    reasons: tuple[str, ...]
    """Of "proved": what rules every plan out; of "not found": how far the search came."""
    seconds: float
    """How long it took: processor time of the calling thread, so that a busy machine searches as far."""


@dataclass
class _Progress:
    """How far a search came."""

    rounds: int = 0
    lone: Counter[int] = field(default_factory=Counter)
    """By aircraft: rounds that found no path for it even alone."""
    joined: int = 0
    """Fleets that were put together but could not be parted."""
    farthest: tuple[int, float, float] = (-1, 0.0, 0.0)
    """Most aircraft with a path alone in one round; less what the next one violated; the fleet's time then, s."""


def second_search(
    case: PlanCase,
    seconds: float,
    times: Float[np.ndarray, " aircraft"] | None = None,
    horizon: float = 3600.0,
    seed: int = 0,
) -> SearchResult:
    """Look for any plan that keeps everything that was asked.

    Parameters
    ----------
    case
        What was asked.
    seconds
        When to give up: processor time of the calling thread.
    times
        Arrival times to keep, s: for a refusal of these very times. Without them whatever the rule allows, which for
        "together" is any common time.
    horizon
        Last arrival of the first aircraft that proofs consider, s, where the rule sets no time.
    seed
        Of the random starts.

    Notes
    -----
    After the proofs of `plan_bounds`: paths are cubic splines in time (`plan_spline`), made to keep the limits of one
    aircraft by damped Gauss-Newton steps on what is violated, from random polylines. A few per aircraft make a pool;
    members that conflict least are chosen together and parted by the same steps on all unknowns of the fleet at once.
    A plan counts only once `dense_check` passes it. That none was found proves nothing, the less so as the search is
    not independent of the planner: the free motions of `anser.planning.certified` vary the same splines from the same
    kinds of starts with the same weights, in code of their own.
    """
    begin = time.thread_time()
    bounds = possible_times(case, times, horizon)
    if bounds.reasons:
        return SearchResult("proved", None, None, bounds.reasons, time.thread_time() - begin)
    rng = np.random.default_rng([7, seed])
    progress = _Progress()
    deadline = begin + seconds
    pools: dict[tuple[float, ...], list[list[Member]]] = {}
    fixed = times is not None or case.rule.name in ("at", "times")
    while time.thread_time() < deadline and not (fixed and max(progress.lone.values(), default=0) >= _LONE_ROUNDS):
        arrivals = _draw_times(case, times, bounds, progress, rng)
        progress.rounds += 1
        uncoupled = case.rule.name == "windows" and times is None
        pool = pools.setdefault(() if uncoupled else tuple(arrivals), [[] for _ in range(case.size)])
        found = _round(case, arrivals, pool, rng, deadline, progress)
        if found is not None:
            return SearchResult("found", *found, (), time.thread_time() - begin)
    words = [f"{progress.rounds} rounds, {progress.joined} fleets put together but not parted"]
    words += [f"aircraft {who}: no path even alone in {count} rounds" for who, count in sorted(progress.lone.items())]
    return SearchResult("not found", None, None, tuple(words), time.thread_time() - begin)


def _draw_times(
    case: PlanCase,
    times: Float[np.ndarray, " aircraft"] | None,
    bounds: PossibleTimes,
    progress: _Progress,
    rng: np.random.Generator,
) -> Float[np.ndarray, " aircraft"]:
    """Arrival times of a round, s."""
    if times is not None:
        return times
    if case.rule.name in ("at", "times"):
        return case.rule.times
    offsets = arrival_offsets(case)
    if offsets is None:
        early, late = case.rule.windows.T
        shares = [bounds.centres[own] for own in bounds.possible]
        share = np.array([rng.choice(own) if progress.rounds else own[own.size // 2] for own in shares])
        return early + share * (late - early)
    open_times = bounds.centres[bounds.possible[0]]
    first = open_times[0] - case.starts.time
    if progress.rounds == 0:
        wanted = case.starts.time + 1.4 * first + 0.25 * _LATE_EXTRA_S
    elif progress.rounds % 2 == 0:
        wanted = progress.farthest[2] + rng.choice([0.2, 1.0]) * rng.normal(0.0, 0.05 * first + 2.0)
    else:
        factor = 1.0 + (_LATE - 1.0) * rng.random() ** 1.5
        wanted = case.starts.time + factor * first + _LATE_EXTRA_S * rng.random() ** 2
    return open_times[np.argmin(np.abs(open_times - wanted))] + offsets


def _round(
    case: PlanCase,
    arrivals: Float[np.ndarray, " aircraft"],
    pool: list[list[Member]],
    rng: np.random.Generator,
    deadline: float,
    progress: _Progress,
) -> tuple[Paths, Float[np.ndarray, " aircraft"]] | None:
    """Fill the pools and put a fleet together; the plan if it passes."""
    stamps = case.starts.time + _STAMP * np.arange(int((arrivals.max() + 61.0 - case.starts.time) / _STAMP))
    offsets = arrival_offsets(case)
    offset = 0.0 if offsets is None else float(offsets[0])
    hardest = sorted(range(case.size), key=lambda who: (len(pool[who]), -progress.lone[who]))
    for rank, who in enumerate(hardest):
        known = [m.flight for m in pool[who] if m.flight.arrival == arrivals[who]]
        flight = known[0] if known else SplineFlight(case, who, float(arrivals[who]), stamps)
        if len(pool[who]) == _POOL_MOST:
            pool[who].pop(int(rng.integers(_POOL_MOST)))
        wanted = max(len(pool[who]) + 1, _POOL)
        least = np.inf
        for _ in range(_TRIES if offsets is None else _TRIES_OPEN):
            if len(pool[who]) >= wanted:
                break
            if time.thread_time() > deadline:
                return None
            x, violated = solve_single(flight, guess_path(flight, rng))
            least = min(least, violated)
            if x is not None:
                pool[who].append(Member(flight, x))
        if not pool[who]:
            progress.lone[who] += 1
            progress.farthest = max(progress.farthest, (rank, -least, float(arrivals[0] - offset)))
            return None
    progress.farthest = max(progress.farthest, (case.size, 0.0, float(arrivals[0] - offset)))
    for members in choose_members(case, pool, rng):
        if time.thread_time() > deadline:
            return None
        plan = _finish(case, members, deadline)
        if plan is not None:
            return plan
        progress.joined += 1
    return None


def _finish(
    case: PlanCase, members: list[Member], deadline: float
) -> tuple[Paths, Float[np.ndarray, " aircraft"]] | None:
    """Part a fleet and check it densely, up to three times more with closer samples where they were too coarse."""
    for _ in range(4):
        parted = part_members(case, members, deadline)
        if parted is None:
            return None
        paths, arrivals = _deliver(parted)
        report = dense_check(paths, case, arrivals, _COARSE)
        if report.passes:
            report = dense_check(paths, case, arrivals)
        if report.passes:
            return paths, arrivals
        excess = [{limit: float(values[who]) for limit, values in report.excess.items()} for who in range(case.size)]
        members = [Member(m.flight.tightened(by), m.x) for m, by in zip(parted, excess, strict=True)]
    return None


def _deliver(members: list[Member]) -> tuple[Paths, Float[np.ndarray, " aircraft"]]:
    """Paths as they would come from a planner, shorter ones padded with empty cells."""
    each = [m.flight.knots(m.x) for m in members]
    most = max(len(times) for times, _ in each)
    times = np.stack([np.pad(t, (0, most - len(t)), mode="edge") for t, _ in each])
    knots = np.stack([np.pad(k, ((0, most - len(k)), (0, 0), (0, 0)), mode="edge") for _, k in each])
    return Paths(times, knots, np.zeros_like(knots)), times[:, -1]
