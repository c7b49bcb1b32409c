"""Second search for any feasible plan, and proofs of infeasibility: a test of the planner's refusals."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from trials.bounds import PossibleTimes, arrival_offsets, possible_times
from trials.check import dense_check
from trials.data import Paths, PlanCase
from trials.fleet import DistanceMargins, Member, avoidance_cylinders, choose_members, part_members, solve_alone
from trials.flight import Flight
from trials.report import PlanReport
from trials.sampled_flights import sample_flight

__all__ = ["SearchResult", "second_search"]

_LATE = 3.0
"""Without a prescribed time, latest arrival as a multiple of the earliest possible, to which _LATE_EXTRA_S is added."""
_LATE_EXTRA_S = 120.0
_COARSE = 0.02
"""Step of the first check, s: a failure at this step saves the check at every millisecond."""
_POOL = 2
"""Number of single flights per aircraft before a fleet is assembled."""
_POOL_MOST = 8
"""Size of a full pool; a random flight is replaced by a new one."""
_TRIES = 6
"""Starts per aircraft and round."""
_TRIES_OPEN = 4
"""Starts per aircraft and round if other arrival times are allowed: another time is more promising."""
_LONE_STARTS = 60
"""With fixed times, number of failed starts for one aircraft alone after which the search ends."""
_CHECKS = 6
"""Number of dense checks of a fleet, each with more margin after a violation between the nodes."""


@dataclass(frozen=True)
class SearchResult:
    """Outcome of a search."""

    status: str
    """"found", "proved" (impossible) or "not found"."""
    paths: Paths | None
    """A plan that passed `dense_check`; None without a plan."""
    arrival_times: Float[np.ndarray, " aircraft"] | None
    """Arrival times, s."""
    reasons: tuple[str, ...]
    """Of "proved": reason of infeasibility; of "not found": progress of the search."""
    iterations: int
    """Iterations of the solver, counted once per flight of a joint solution."""


@dataclass
class _Progress:
    """Progress of a search."""

    iterations_left: int
    """Iterations."""
    rounds: int = 0
    failed_alone: Counter[int] = field(default_factory=Counter)
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
    """Search for any plan that satisfies every requirement of the task.

    Parameters
    ----------
    case
        Planning task.
    iterations
        Limit on the solver's iterations, counted once per flight. Not a time: the outcome is independent of the
        machine's speed.
    times
        Prescribed arrival times, s, to test the refusal of these times. None: any time allowed by the rule; for
        "together", any common time.
    horizon
        Last arrival of the first aircraft considered by the proofs for rules without a time limit, s.
    seed
        Seed of the random starts.

    Notes
    -----
    After the proofs of `trials.bounds`: direct collocation of a point mass (`trials.collocation`), solved by IPOPT,
    from random flights that the cross-entropy method brings near the rendezvous (`trials.sampled_flights`). Within a
    round each aircraft stays clear of the flights solved before, if possible. The flights form a pool per aircraft; a
    combination of members with few conflicts is selected, and members in conflict are solved jointly with their
    separation as constraints. A plan counts only after `dense_check` passes it. A failed search proves nothing: the
    problem is not convex, and the solver finds local solutions.
    """
    bounds = possible_times(case, times, horizon)
    if bounds.reasons:
        return SearchResult("proved", None, None, bounds.reasons, 0)
    rng = np.random.default_rng([11, seed])
    progress = _Progress(iterations)
    pools: dict[tuple[float, ...], list[list[Member]]] = {}
    has_fixed_times = times is not None or case.rule.name in ("at", "times")
    while progress.iterations_left > 0 and not (
        has_fixed_times and max(progress.failed_alone.values(), default=0) >= _LONE_STARTS
    ):
        arrivals = _draw_times(case, times, bounds, progress, rng)
        progress.rounds += 1
        uncoupled = case.rule.name == "windows" and times is None
        pool = pools.setdefault(() if uncoupled else tuple(arrivals), [[] for _ in range(case.size)])
        plan = _round(case, arrivals, pool, rng, progress)
        if plan is not None:
            return SearchResult("found", *plan, (), iterations - progress.iterations_left)
    reasons = [f"{progress.rounds} rounds, {progress.joined} fleets put together but not parted"]
    reasons += [
        f"aircraft {aircraft}: no path even alone from {n} starts"
        for aircraft, n in sorted(progress.failed_alone.items())
        if n
    ]
    return SearchResult("not found", None, None, tuple(reasons), iterations - progress.iterations_left)


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
        shares = [bounds.centres[centres] for centres in bounds.possible]
        share = np.array([rng.choice(centres) if progress.rounds else centres[centres.size // 2] for centres in shares])
        return early + share * (late - early)
    open_times = bounds.centres[bounds.possible[0]]
    earliest_duration = open_times[0] - case.starts.time
    if progress.rounds == 0:
        target_time = case.starts.time + 1.5 * earliest_duration + 0.25 * _LATE_EXTRA_S
    elif progress.rounds % 2 == 0:
        target_time = progress.farthest[1] + rng.choice([0.0, 0.2, 1.0]) * rng.normal(
            0.0, 0.05 * earliest_duration + 2.0
        )
    else:
        target_time = case.starts.time + rng.uniform(1.0, _LATE) * earliest_duration + _LATE_EXTRA_S * rng.random() ** 2
    return open_times[np.argmin(np.abs(open_times - target_time))] + offsets


def _round(
    case: PlanCase,
    arrivals: Float[np.ndarray, " aircraft"],
    pool: list[list[Member]],
    rng: np.random.Generator,
    progress: _Progress,
) -> tuple[Paths, Float[np.ndarray, " aircraft"]] | None:
    """Fill the pools and assemble a fleet; return the plan if it passes."""
    margins = DistanceMargins()
    offsets = arrival_offsets(case)
    common = float(arrivals[0] - (0.0 if offsets is None else offsets[0]))
    hardest = sorted(
        range(case.size), key=lambda aircraft: (len(pool[aircraft]), -progress.failed_alone[aircraft], rng.random())
    )
    solved: list[Member] = []
    for rank, aircraft in enumerate(hardest):
        flight = Flight.of(case, aircraft, float(arrivals[aircraft]))
        if len(pool[aircraft]) == _POOL_MOST:
            pool[aircraft].pop(int(rng.integers(_POOL_MOST)))
        pool_size = max(len(pool[aircraft]) + 1, _POOL)
        for _ in range(_TRIES if offsets is None else _TRIES_OPEN):
            if len(pool[aircraft]) >= pool_size:
                break
            if progress.iterations_left <= 0:
                return None
            start = sample_flight(flight, rng, avoidance_cylinders(flight, solved, margins))
            member, used = solve_alone(flight, start, solved, margins)
            progress.iterations_left -= used
            if member is None and solved and not pool[aircraft]:
                member, used = solve_alone(flight, start, [], margins)
                progress.iterations_left -= used
            progress.failed_alone[aircraft] = (
                progress.failed_alone[aircraft] + 1 if member is None and not pool[aircraft] else 0
            )
            if member is not None:
                pool[aircraft].append(member)
        if not pool[aircraft]:
            progress.farthest = max(progress.farthest, (rank, common))
            return None
        solved.append(pool[aircraft][-1])
    progress.farthest = max(progress.farthest, (case.size, common))
    # First the flights of this round, which were solved to avoid each other.
    for initial in ([len(flights) - 1 for flights in pool], [int(rng.integers(len(flights))) for flights in pool]):
        plan = _finish(case, choose_members(pool, initial, margins), margins, progress)
        if plan is not None:
            return plan
        progress.joined += 1
        if progress.iterations_left <= 0:
            return None
    return None


def _finish(
    case: PlanCase, members: list[Member], margins: DistanceMargins, progress: _Progress
) -> tuple[Paths, Float[np.ndarray, " aircraft"]] | None:
    """Separate a fleet and check it densely; repeat with more margin or shorter intervals after a violation."""
    for _ in range(_CHECKS):
        parted, used = part_members(members, margins)
        progress.iterations_left -= used
        if parted is None:
            return None
        paths, arrivals = _deliver(parted)
        report = dense_check(paths, case, arrivals, _COARSE)
        if report.passes:
            report = dense_check(paths, case, arrivals)
        if report.passes:
            return paths, arrivals
        _widen_distances(report, margins)
        members = []
        for aircraft, member in enumerate(parted):
            excess = {limit: float(values[aircraft]) for limit, values in report.excess.items()}
            if not any(breach.who[0] == aircraft for breach in report.breaches if breach.kind != "separation"):
                members.append(member)
                continue
            flight = member.flight.tightened(excess)
            start = member.x if flight.intervals == member.flight.intervals else flight.unknowns_of(member.path)
            new_member, used = solve_alone(flight, start, [], margins)
            progress.iterations_left -= used
            if new_member is None:
                return None
            members.append(new_member)
    return None


def _widen_distances(report: PlanReport, margins: DistanceMargins) -> None:
    """Increase the margin and add times near each violated distance."""
    for breach in report.breaches:
        if breach.kind not in ("keep_out", "separation"):
            continue
        key = breach.who if breach.kind == "keep_out" else tuple(sorted(breach.who))
        by_key = margins.keep_out if breach.kind == "keep_out" else margins.separation
        by_key[key] = by_key.get(key, 0.0) + min(1.2 * breach.amount, 5.0)
        around = breach.time + 0.1 * np.arange(-5, 6)
        margins.times.setdefault((breach.kind, key), []).extend(float(t) for t in around if t > 0.0)


def _deliver(members: list[Member]) -> tuple[Paths, Float[np.ndarray, " aircraft"]]:
    """Paths in the planner's format, shorter paths padded with empty cells."""
    paths = [member.path.knots() for member in members]
    knot_count = max(len(times) for times, _ in paths)
    times = np.stack([np.pad(t, (0, knot_count - len(t)), mode="edge") for t, _ in paths])
    knots = np.stack([np.pad(k, ((0, knot_count - len(k)), (0, 0), (0, 0)), mode="edge") for _, k in paths])
    return Paths(times, knots, np.zeros_like(knots)), times[:, -1]
