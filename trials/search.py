"""Second search for any feasible plan, and proofs that there is none: what may refute a refusal of the planner."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from trials.bounds import PossibleTimes, arrival_offsets, possible_times
from trials.check import dense_check
from trials.data import Paths, PlanCase
from trials.fleet import Apart, Member, choose_members, part_members, solve_alone, tracks_of
from trials.flight import Flight
from trials.report import PlanReport
from trials.sampled_flights import sample_flight

__all__ = ["SearchResult", "second_search"]

_LATE = 3.0
"""Without a time set by the rule, arrivals up to so many times the earliest possible, and _LATE_EXTRA_S, are tried."""
_LATE_EXTRA_S = 120.0
_COARSE = 0.02
"""Step of the first check, s: what fails here need not be looked at every millisecond."""
_POOL = 2
"""Single flights wanted per aircraft before a fleet is put together."""
_POOL_MOST = 8
"""A pool that is full gives one up, drawn by lot, for a new one."""
_TRIES = 6
"""Starts per aircraft and round."""
_TRIES_OPEN = 4
"""The same where another arrival time may do: better to try that."""
_LONE_STARTS = 60
"""Where times are fixed, starts without a flight for one aircraft alone after which none is expected."""
_CHECKS = 6
"""Dense checks of a fleet, each with more margin where the one before found a limit passed between instants."""


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
    iterations: int
    """Of the solver; those of several flights together count once for each."""


@dataclass
class _Progress:
    """How far a search came."""

    left: int
    """Iterations."""
    rounds: int = 0
    lone: Counter[int] = field(default_factory=Counter)
    """By aircraft: starts that led to no flight for it even alone, since the last that did."""
    joined: int = 0
    """Fleets that were put together but could not be parted."""
    farthest: tuple[int, float] = (-1, 0.0)
    """Most aircraft with a flight alone in one round; the fleet's time then, s."""


def second_search(
    case: PlanCase,
    iterations: int,
    times: Float[np.ndarray, " aircraft"] | None = None,
    horizon: float = 3600.0,
    seed: int = 0,
) -> SearchResult:
    """Look for any plan that keeps everything that was asked.

    Parameters
    ----------
    case
        What was asked.
    iterations
        When to give up: iterations of the solver, counted once per flight in it. Not a time: the outcome does not
        depend on the machine's speed.
    times
        Arrival times to keep, s: for a refusal of these very times. Without them whatever the rule allows, which for
        "together" is any common time.
    horizon
        Last arrival of the first aircraft that proofs consider, s, where the rule sets no time.
    seed
        Of the random starts.

    Notes
    -----
    After the proofs of `trials.bounds`: direct collocation of a point mass (`trials.collocation`), solved by IPOPT,
    from random flights that the cross-entropy method brings near the rendezvous (`trials.sampled_flights`). Within a
    round each aircraft stays apart from those solved before it, if it can. The flights found make a pool per aircraft;
    members that conflict least are chosen together, and those still in conflict are solved jointly with their
    separation as constraints. A plan counts only once `dense_check` passes it. That none was found proves nothing: the
    problem is not convex, and the solver's solutions are local ones.
    """
    bounds = possible_times(case, times, horizon)
    if bounds.reasons:
        return SearchResult("proved", None, None, bounds.reasons, 0)
    rng = np.random.default_rng([11, seed])
    progress = _Progress(iterations)
    pools: dict[tuple[float, ...], list[list[Member]]] = {}
    fixed = times is not None or case.rule.name in ("at", "times")
    while progress.left > 0 and not (fixed and max(progress.lone.values(), default=0) >= _LONE_STARTS):
        arrivals = _draw_times(case, times, bounds, progress, rng)
        progress.rounds += 1
        uncoupled = case.rule.name == "windows" and times is None
        pool = pools.setdefault(() if uncoupled else tuple(arrivals), [[] for _ in range(case.size)])
        found = _round(case, arrivals, pool, rng, progress)
        if found is not None:
            return SearchResult("found", *found, (), iterations - progress.left)
    words = [f"{progress.rounds} rounds, {progress.joined} fleets put together but not parted"]
    words += [f"aircraft {who}: no path even alone from {n} starts" for who, n in sorted(progress.lone.items()) if n]
    return SearchResult("not found", None, None, tuple(words), iterations - progress.left)


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
        wanted = case.starts.time + 1.5 * first + 0.25 * _LATE_EXTRA_S
    elif progress.rounds % 2 == 0:
        wanted = progress.farthest[1] + rng.choice([0.0, 0.2, 1.0]) * rng.normal(0.0, 0.05 * first + 2.0)
    else:
        wanted = case.starts.time + rng.uniform(1.0, _LATE) * first + _LATE_EXTRA_S * rng.random() ** 2
    return open_times[np.argmin(np.abs(open_times - wanted))] + offsets


def _round(
    case: PlanCase,
    arrivals: Float[np.ndarray, " aircraft"],
    pool: list[list[Member]],
    rng: np.random.Generator,
    progress: _Progress,
) -> tuple[Paths, Float[np.ndarray, " aircraft"]] | None:
    """Fill the pools and put a fleet together; the plan if it passes."""
    apart = Apart()
    offsets = arrival_offsets(case)
    common = float(arrivals[0] - (0.0 if offsets is None else offsets[0]))
    hardest = sorted(range(case.size), key=lambda who: (len(pool[who]), -progress.lone[who], rng.random()))
    ready: list[Member] = []
    for rank, who in enumerate(hardest):
        flight = Flight.of(case, who, float(arrivals[who]))
        if len(pool[who]) == _POOL_MOST:
            pool[who].pop(int(rng.integers(_POOL_MOST)))
        wanted = max(len(pool[who]) + 1, _POOL)
        for _ in range(_TRIES if offsets is None else _TRIES_OPEN):
            if len(pool[who]) >= wanted:
                break
            if progress.left <= 0:
                return None
            start = sample_flight(flight, rng, tracks_of(flight, ready, apart))
            member, spent = solve_alone(flight, start, ready, apart)
            progress.left -= spent
            if member is None and ready and not pool[who]:
                member, spent = solve_alone(flight, start, [], apart)
                progress.left -= spent
            progress.lone[who] = progress.lone[who] + 1 if member is None and not pool[who] else 0
            if member is not None:
                pool[who].append(member)
        if not pool[who]:
            progress.farthest = max(progress.farthest, (rank, common))
            return None
        ready.append(pool[who][-1])
    progress.farthest = max(progress.farthest, (case.size, common))
    # Those of this round first, which were made to avoid each other.
    for first in ([len(own) - 1 for own in pool], [int(rng.integers(len(own))) for own in pool]):
        plan = _finish(case, choose_members(pool, first, apart), apart, progress)
        if plan is not None:
            return plan
        progress.joined += 1
        if progress.left <= 0:
            return None
    return None


def _finish(
    case: PlanCase, members: list[Member], apart: Apart, progress: _Progress
) -> tuple[Paths, Float[np.ndarray, " aircraft"]] | None:
    """Part a fleet and check it densely; again with more margin or shorter intervals where it passed a limit."""
    for _ in range(_CHECKS):
        parted, spent = part_members(members, apart)
        progress.left -= spent
        if parted is None:
            return None
        paths, arrivals = _deliver(parted)
        report = dense_check(paths, case, arrivals, _COARSE)
        if report.passes:
            report = dense_check(paths, case, arrivals)
        if report.passes:
            return paths, arrivals
        _widen_distances(report, apart)
        members = []
        for who, one in enumerate(parted):
            excess = {limit: float(values[who]) for limit, values in report.excess.items()}
            if not any(breach.who[0] == who for breach in report.breaches if breach.kind != "separation"):
                members.append(one)
                continue
            flight = one.flight.tightened(excess)
            start = one.x if flight.intervals == one.flight.intervals else flight.unknowns_of(one.path)
            again, spent = solve_alone(flight, start, [], apart)
            progress.left -= spent
            if again is None:
                return None
            members.append(again)
    return None


def _widen_distances(report: PlanReport, apart: Apart) -> None:
    """More margin and closer instants where a distance was passed."""
    for breach in report.breaches:
        if breach.kind not in ("keep_out", "separation"):
            continue
        who = breach.who if breach.kind == "keep_out" else tuple(sorted(breach.who))
        margins = apart.keep_out if breach.kind == "keep_out" else apart.separation
        margins[who] = margins.get(who, 0.0) + min(1.2 * breach.amount, 5.0)
        around = breach.time + 0.1 * np.arange(-5, 6)
        apart.times.setdefault((breach.kind, who), []).extend(float(t) for t in around if t > 0.0)


def _deliver(members: list[Member]) -> tuple[Paths, Float[np.ndarray, " aircraft"]]:
    """Paths as they would come from a planner, shorter ones padded with empty cells."""
    each = [one.path.knots() for one in members]
    most = max(len(times) for times, _ in each)
    times = np.stack([np.pad(t, (0, most - len(t)), mode="edge") for t, _ in each])
    knots = np.stack([np.pad(k, ((0, most - len(k)), (0, 0), (0, 0)), mode="edge") for _, k in each])
    return Paths(times, knots, np.zeros_like(knots)), times[:, -1]
