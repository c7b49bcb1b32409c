"""Search for a plan of a fleet.

Arrival times and candidates tried stage by stage until a certificate keeps everything.
"""

import contextlib
import itertools
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from anser.numerics.arrays import as_array
from anser.planning.certified.arrival_times import (
    arrival_conflicts,
    arrival_sets,
    climb_times_min,
    direct_times,
    earlier_times,
    first_index,
    may_arrive,
)
from anser.planning.certified.certified_plan import CertifiedPlan, FixedPaths, choose_interval_count, plan_at
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest, ArrivalTimes, Intervals
from anser.planning.certified.timed_profiles import MINIMAL, STANDARD, WITH_SPLINES, WITH_TURN_LEG_PATHS, CandidateSet

_DELAYS = (1.0, 1.01, 1.03, 1.06, 1.1, 1.15, 1.22, 1.3, 1.4, 1.55, 1.75, 2.0, 2.4, 3.0)  # of the first time
_DELAY_RATIO = 1.008  # ratio of two arrival times that are tried after each other
_DELAY_BOUNDS = (1.0, 1.03, 1.3, 3.0)  # of the first time: before a longer delay every kind of candidate is tried
_LONG_DELAY = 1.3  # up to which the usual candidates are tried in single steps
_DIRECT_TIME_FACTOR = 1.0002  # later than the direct path takes: to rounding there may be none of just its length
_PARTS_OF_SMALL = (0.0, 0.1, 0.25, 0.5, 0.8)  # of the list of open times, for more than the standard candidates
_GRID_S = 0.25  # between arrival times that are tested for the necessary conditions
_SMALL_FLEET = 12  # aircraft up to which every kind of candidate is tried
_WINDOW_PARTS = (0.0, 0.12, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0)
_WINDOW_ROTATIONS = 8
_DIRECT_INTERVALS = 64


@dataclass(frozen=True)
class FleetTask:
    """A fleet that is to be planned: its tasks, stacked, the airspace and when it is to arrive."""

    tasks: AircraftTask
    airspace: Airspace
    request: ArrivalRequest

    @cached_property
    def active(self) -> Bool[np.ndarray, " aircraft"]:
        """Which aircraft count."""
        return np.asarray(self.tasks.active) > 0.0

    @property
    def indices(self) -> Int[np.ndarray, " active"]:
        """Indices of those that count."""
        return np.flatnonzero(self.active)

    @property
    def offsets(self) -> ArrivalTimes:
        """How long after the first each arrives, s."""
        return self.request.offsets(self.active.size)

    @property
    def has_fixed_times(self) -> bool:
        """Whether the rule leaves no arrival time open."""
        return self.request.rule in ("at", "times")

    @property
    def is_small(self) -> bool:
        """Whether the fleet is small enough to try every kind of candidate."""
        return self.indices.size <= _SMALL_FLEET

    @property
    def levels(self) -> tuple[CandidateSet, ...]:
        """The candidates to try one after the other."""
        return (STANDARD, WITH_TURN_LEG_PATHS, WITH_SPLINES) if self.is_small else (STANDARD,)

    @cached_property
    def preferred_times(self) -> ArrivalTimes:
        """Time of each by the direct path at its preferred speed, s; more only if the climb certainly takes more."""
        tasks = self.tasks
        times, converged = direct_times(tasks, self.airspace, tasks.speed, _DIRECT_INTERVALS)
        line = np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n)
        straight = np.linalg.norm(line, axis=1) / np.asarray(tasks.speed)
        direct = np.where(np.asarray(converged), np.asarray(times), straight)
        return np.clip(np.maximum(direct, climb_times_min(tasks, self.airspace)), 1.0, self.request.latest_s)

    def admissible(self, times: Float[np.ndarray, "n aircraft"]) -> Bool[np.ndarray, " n"]:
        """Which sets of arrival times (s after the start) meet the necessary conditions."""
        everyone = np.tile(self.indices, times.shape[0])
        alone = may_arrive(self.tasks, self.airspace, everyone, times[:, self.indices].ravel()).reshape(
            times.shape[0], -1
        )
        return np.all(alone, axis=1) & ~arrival_conflicts(self.tasks, self.airspace, times).any(axis=(1, 2))

    def requested_times(self) -> Float[np.ndarray, "n aircraft"]:
        """Arrival times that the rule leaves open, every quarter of a second, or those given; not for windows."""
        if self.request.times_s is not None:
            return self.request.times_s[None]
        last = self.request.latest_s - float(np.max(self.offsets))
        return np.arange(_GRID_S, last, _GRID_S)[:, None] + self.offsets

    def common_intervals(self, arrivals: Sequence[Intervals]) -> Intervals:
        """Times of the first arrival that are open to all that count, none later than may be, s."""
        own = [sets if on else [(0.0, np.inf)] for sets, on in zip(arrivals, self.active, strict=True)]
        last = self.request.latest_s - float(np.max(self.offsets))
        return [(a, b) for a, b in common_times(own, self.offsets) if a <= last]


@dataclass(frozen=True)
class Proposal:
    """Arrival times (s after the start), the candidates to try there, and a message of progress."""

    times: ArrivalTimes
    candidate_set: CandidateSet
    message: str | None = None


FailedAircraft = Bool[np.ndarray, " aircraft"]
Stage = Generator[Proposal, FailedAircraft, None]
"""Proposals, each answered by which aircraft failed; none: a plan was found."""


def _make_proposal(times: ArrivalTimes, candidate_set: CandidateSet) -> Proposal:
    return Proposal(times, candidate_set, f"trying arrival at {float(np.max(times)):.1f} s")


def first_stage(fleet: FleetTask, thorough: bool) -> Stage:
    """The times that the rule prefers: with few candidates, then with more where nothing rules them out."""
    first = _preferred_arrival_times(fleet)
    if first is None:
        return
    yield Proposal(first, MINIMAL)
    if fleet.admissible(np.asarray(first, dtype=float)[None])[0]:
        for candidate_set in fleet.levels if fleet.has_fixed_times and thorough else (STANDARD,):
            yield Proposal(first, candidate_set)


def later_stage(fleet: FleetTask) -> Stage:
    """The first times, or as soon after them as there is a plan, where the rule leaves that open.

    The usual candidates in small steps, then every kind of candidate before the time that was found: at once for short
    delays, then for longer ones. Better a loop than to be there at twice the time. Of windows, each aircraft is put
    off by itself. The last plan found is the earliest.
    """
    first = _preferred_arrival_times(fleet)
    if first is None:
        return
    by_itself = fleet.request.rule == "windows"
    times, late = (
        first.copy(),
        [fleet.indices[k : k + 1] for k in range(fleet.indices.size)] if by_itself else [fleet.indices],
    )
    for near, far in itertools.pairwise(_DELAY_BOUNDS):
        delays = [_delays(fleet, rows, first, near, far) for rows in late]
        one_by_one = max((len(one.times) for one in delays), default=1) if fleet.is_small and far <= _LONG_DELAY else 1
        index = yield from _find_first_open(delays, times, (STANDARD,), one_by_one)
        if fleet.levels[1:]:
            before = [one.truncated(k) for one, k in zip(delays, index, strict=True)]
            better = yield from _find_first_open(before, times, fleet.levels[1:], 1)
            index = [old if new is None else new for old, new in zip(index, better, strict=True)]
        late = [rows for rows, k in zip(late, index, strict=True) if k is None]
        if not late:
            break
    if by_itself and not late:
        yield from _attempt_candidate_sets(times, fleet.levels)


@dataclass(frozen=True)
class _Delays:
    """Rising arrival times of aircraft that are put off together: all of a fleet, or one that has a window of its own.

    Attributes
    ----------
    rows
        Indices of the aircraft.
    times
        Their arrival times, s.
    """

    indices: Int[np.ndarray, " rows"]
    times: Float[np.ndarray, "n rows"]

    def truncated(self, index: int | None) -> "_Delays":
        """The times before an index, all of them for None; none before one that is a single step after the first."""
        near = index is not None and self.times[index, 0] <= _DELAY_RATIO**1.5 * self.times[0, 0]
        return _Delays(self.indices, self.times[: 0 if near else index])


def _delays(
    fleet: FleetTask, indices: Int[np.ndarray, " rows"], first_times: ArrivalTimes, delay_min: float, delay_max: float
) -> _Delays:
    """Times from one multiple of the first to another that the rule allows and no necessary condition rules out."""
    windows, offsets = fleet.request.windows_s, fleet.offsets
    steps = _DELAY_RATIO ** np.arange(
        np.ceil(np.log(delay_min) / np.log(_DELAY_RATIO)), np.log(delay_max) / np.log(_DELAY_RATIO)
    )
    times = steps[:, None] * (first_times - offsets) + offsets
    latest = fleet.request.latest_s if windows is None else windows[indices, 1]
    times = times[np.all(times[:, indices] <= latest, axis=1)]
    if windows is None:
        return _Delays(indices, times[fleet.admissible(times)][:, indices])
    alone = may_arrive(fleet.tasks, fleet.airspace, np.repeat(indices, len(times)), times[:, indices].ravel())
    return _Delays(indices, times[alone][:, indices])


def _find_first_open(
    delays: Sequence[_Delays], times: ArrivalTimes, candidate_sets: Sequence[CandidateSet], one_by_one: int
) -> Generator[Proposal, FailedAircraft, list[int | None]]:
    """Index of the first time that is found to be open, per entry of `delays`; these times are written to `times`.

    All entries are searched at once: each attempt answers for every aircraft.
    """
    scans = {k: first_index(len(one.times), one_by_one) for k, one in enumerate(delays)}
    index: list[int | None] = [None] * len(delays)
    open_at: dict[int, bool | None] = dict.fromkeys(scans)
    while True:
        proposed = times.copy()
        for k in list(scans):
            try:
                proposed[delays[k].indices] = delays[k].times[scans[k].send(open_at[k])]
            except StopIteration as end:
                index[k] = end.value
                del scans[k]
                if end.value is not None:
                    times[delays[k].indices] = proposed[delays[k].indices] = delays[k].times[end.value]
        if not scans:
            return index
        failed = yield from _attempt_candidate_sets(proposed, candidate_sets)
        open_at = {k: not failed[delays[k].indices].any() for k in scans}


def _attempt_candidate_sets(
    times: ArrivalTimes, candidate_sets: Sequence[CandidateSet]
) -> Generator[Proposal, FailedAircraft, FailedAircraft]:
    """Which aircraft fail with the last of some candidate sets; the first with which none fails is enough."""
    failed = np.ones(times.shape, dtype=bool)
    for candidate_set in candidate_sets:
        failed = yield _make_proposal(times, candidate_set)
        if not failed.any():
            break
    return failed


def open_stage(fleet: FleetTask, arrivals: Sequence[Intervals]) -> Stage:
    """Times that are open to each aircraft by itself, with more and more candidates."""
    times = [t for t in _times_open_to_all(fleet, arrivals) if fleet.admissible(t[None])[0]]
    few = [times[k] for k in sorted({round(u * (len(times) - 1)) for u in _PARTS_OF_SMALL})] if times else []
    for candidate_set in fleet.levels:
        for t in times if candidate_set is STANDARD else few:
            yield _make_proposal(t, candidate_set)


def earlier_stage(fleet: FleetTask, plan_arrival_s: float) -> Stage:
    """Times between the first that nothing rules out and that of a plan (s after its start)."""
    times, works = fleet.requested_times(), None
    tried = earlier_times(times[fleet.admissible(times), 0], plan_arrival_s)
    with contextlib.suppress(StopIteration):
        while True:
            time = tried.send(works)
            message = f"looking for an earlier arrival, at {time:.1f} s"
            failed = yield Proposal(np.full(fleet.active.size, time), WITH_SPLINES, message)
            works = not failed.any()


def open_arrivals(fleet: FleetTask, on_progress: Callable[[str], None]) -> list[Intervals] | None:
    """For each aircraft the times open to it alone (s after the start); None where one has none in its window."""
    request = fleet.request
    on_progress("looking for arrival times that are open to each aircraft")
    arrivals = arrival_sets(fleet.tasks, fleet.airspace, request.latest_s, request.windows_s)
    if request.windows_s is not None:
        return None if any(on and not own for on, own in zip(fleet.active, arrivals, strict=True)) else arrivals
    if fleet.is_small and not fleet.common_intervals(arrivals):
        on_progress("looking again, with splines, for a time that is open to all")
        arrivals = arrival_sets(fleet.tasks, fleet.airspace, request.latest_s, with_splines=True)
    return arrivals


def _preferred_arrival_times(fleet: FleetTask) -> ArrivalTimes | None:
    """The times that the rule asks for first; None where they must be looked for."""
    request, preferred = fleet.request, fleet.preferred_times
    if request.times_s is not None:
        return request.times_s
    if request.windows_s is not None:
        return np.clip(_DIRECT_TIME_FACTOR * preferred, request.windows_s[:, 0], request.windows_s[:, 1])
    if request.rule == "earliest":
        return None
    times = _DIRECT_TIME_FACTOR * float(np.max(preferred - fleet.offsets)) + fleet.offsets
    return times if np.max(times) <= request.latest_s else None


def _times_open_to_all(fleet: FleetTask, arrivals: Sequence[Intervals]) -> Iterator[ArrivalTimes]:
    """Arrival times to try, the preferred ones first; only such as are open to every aircraft by itself."""
    request, offsets, preferred = fleet.request, fleet.offsets, fleet.preferred_times
    if request.windows_s is not None:
        yield from _window_times(preferred, request.windows_s, arrivals)
        return
    last = request.latest_s - float(np.max(offsets))
    base = float(np.max(preferred - offsets))
    common = fleet.common_intervals(arrivals)
    if request.rule == "earliest":
        wanted = [t for a, b in common for t in _sample_interval(a, min(b, last))]
    else:
        wanted = [min(max(base * f, a), b) for f in _DELAYS for a, b in common if a <= base * f <= b]
        wanted += [t for a, b in common if b >= base for t in _sample_interval(max(a, base), min(b, last))]
    for time in sorted({round(t, 9) for t in wanted if 0.0 < t <= last}):
        yield time + offsets


def _sample_interval(low: float, high: float) -> list[float]:
    """Times of an interval, the early ones densely."""
    if not high > low:
        return [low]
    top = min(high, 2.5 * low + 10.0)
    return [low + (top - low) * u for u in (0.0, 0.002, 0.01, 0.03, 0.07, 0.14, 0.25, 0.4, 0.6, 0.8, 1.0)]


def _window_times(
    preferred_times: ArrivalTimes, windows_s: Float[np.ndarray, "aircraft 2"], arrivals: Sequence[Intervals]
) -> Iterator[ArrivalTimes]:
    """One time within each window that is open to its aircraft; then all shifted within their windows."""
    grids = []
    for (low, high), sets, wish in zip(windows_s, arrivals, preferred_times, strict=True):
        inside = [(max(a, low), min(b, high)) for a, b in sets if max(a, low) <= min(b, high)] or [(low, high)]
        times = {float(a + (b - a) * u) for a, b in inside for u in _WINDOW_PARTS}
        grids.append(sorted(times, key=lambda t: abs(t - wish)))
    for shift in range(max(len(grid) for grid in grids)):
        yield np.array([grid[min(shift, len(grid) - 1)] for grid in grids])
    # Each at another of its times: conflicts between two that both moved alike.
    for shift in range(1, _WINDOW_ROTATIONS):
        yield np.array([grid[(k * shift) % len(grid)] for k, grid in enumerate(grids)])


def common_times(arrivals: Sequence[Intervals], offsets_s: ArrivalTimes) -> Intervals:
    """Times of the first arrival that are open to all, s."""
    common: Intervals = [(0.0, float("inf"))]
    for own, offset in zip(arrivals, offsets_s, strict=True):
        first = [(a - offset, b - offset) for a, b in own]
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in first if max(a, c) <= min(b, d)]
    return common


_TIME_TOLERANCE = 5e-4  # part of itself by which a time differs from one that need not be tried again
_EXTENSIONS = 2  # times at most that an attempt is repeated with more aircraft that look at the extra candidates

Progress = Callable[[str], None]
FailedAfterArrival = Callable[[CertifiedPlan], np.ndarray]


@dataclass(frozen=True)
class SearchOutcome:
    """What came of a search.

    Attributes
    ----------
    plan
        The plan; None where none was found.
    attempts
        Number of sets of arrival times and candidates tried.
    best_attempt
        The one with the fewest aircraft that failed, where there is no plan.
    arrivals
        Per aircraft, the arrival times open to it alone (s after the start), where they were needed.
    without_holds
        A plan that keeps everything up to the arrivals, but not after them, where there is no other.
    """

    plan: CertifiedPlan | None
    attempts: int
    best_attempt: CertifiedPlan | None = None
    arrivals: list[Intervals] | None = None
    plan_without_holds: CertifiedPlan | None = None

    def leading(self, count: int) -> "SearchOutcome":
        """Of the first aircraft only."""
        plans = (None if one is None else one.leading(count) for one in (self.plan, self.best_attempt))
        plan_without_holds = None if self.plan_without_holds is None else self.plan_without_holds.leading(count)
        arrivals = None if self.arrivals is None else self.arrivals[:count]
        return SearchOutcome(next(plans), self.attempts, next(plans), arrivals, plan_without_holds)


@dataclass(frozen=True)
class _Attempt:
    """Arrival times and candidates that were tried, and which aircraft failed."""

    times: ArrivalTimes
    candidate_set: CandidateSet
    failed: FailedAircraft


@dataclass(frozen=True)
class _State:
    """Progress of the search: its attempts, and the plan once there is one; the other fields as in `SearchOutcome`."""

    tried: tuple[_Attempt, ...] = ()
    plan: CertifiedPlan | None = None
    best_attempt: CertifiedPlan | None = None
    plan_without_holds: CertifiedPlan | None = None

    def failed_at(self, times: ArrivalTimes, candidate_set: CandidateSet) -> FailedAircraft | None:
        """Which aircraft failed where that was tried; None where it was not."""
        for past in self.tried:
            if past.candidate_set is candidate_set and np.allclose(times, past.times, rtol=_TIME_TOLERANCE, atol=0.0):
                return past.failed
        return None

    def with_attempt(self, attempt: _Attempt, plan: CertifiedPlan) -> "_State":
        """The state after an attempt that gave a plan, or one in which aircraft failed."""
        fewest = min((np.sum(past.failed) for past in self.tried), default=np.inf)
        return replace(
            self,
            tried=(*self.tried, attempt),
            plan=None if attempt.failed.any() else plan,
            best_attempt=plan if np.sum(attempt.failed) < fewest else self.best_attempt,
        )

    def outcome(self, arrivals: list[Intervals] | None = None) -> SearchOutcome:
        """The result of the search."""
        if self.plan is not None:
            return SearchOutcome(self.plan, len(self.tried), arrivals=arrivals)
        return SearchOutcome(None, len(self.tried), self.best_attempt, arrivals, self.plan_without_holds)


@dataclass(frozen=True)
class _Searcher:
    """What does not change during a search: see `search`."""

    start_time: float
    fleet: FleetTask
    on_progress: Progress
    failed_after_arrival: FailedAfterArrival
    fixed_paths: FixedPaths | None
    intervals: int | None

    def run(self, state: _State, stage: Stage, to_the_end: bool = False) -> _State:
        """Attempt what a stage proposes, up to the first plan, or to its end: then the last plan found stands."""
        with contextlib.suppress(StopIteration):
            proposal = next(stage)
            while True:
                if proposal.message is not None:
                    self.on_progress(proposal.message)
                made = self.attempt(state, proposal.times, proposal.candidate_set)
                failed = made.failed_at(proposal.times, proposal.candidate_set)
                state = made if made.plan is not None else replace(made, plan=state.plan)
                if made.plan is not None and not to_the_end:
                    break
                # Without an attempt of its own, the standard candidates were enough.
                proposal = stage.send(np.zeros_like(self.fleet.active) if failed is None else failed)
        return state

    def attempt(self, state: _State, times: ArrivalTimes, candidate_set: CandidateSet) -> _State:
        """Try arrival times with candidates, unless that was tried before; the state's plan is what came of it.

        Extra candidates are for the aircraft that fail with the standard ones.
        """
        state = replace(state, plan=None)
        if state.failed_at(times, candidate_set) is not None:
            return state
        extra_for = None
        if candidate_set.extra is not None:
            if state.failed_at(times, STANDARD) is None:
                state = self.attempt(state, times, STANDARD)
                if state.plan is not None:
                    return state
            extra_for = state.failed_at(times, STANDARD)
        plan, failed, state = self._plan(state, times, candidate_set, extra_for)
        for _ in range(_EXTENSIONS):
            # One that finds something at last may be in the way of others, which then need more to choose from too.
            if extra_for is None or not (failed & ~extra_for).any():
                break
            extra_for = extra_for | failed
            plan, failed, state = self._plan(state, times, candidate_set, extra_for)
        return state.with_attempt(_Attempt(times, candidate_set, failed), plan)

    def _plan(
        self, state: _State, times: ArrivalTimes, candidate_set: CandidateSet, extra_for: FailedAircraft | None
    ) -> tuple[CertifiedPlan, FailedAircraft, _State]:
        """A plan, and which aircraft fail before or after their arrivals."""
        fleet = self.fleet
        plan = plan_at(
            self.start_time,
            fleet.tasks,
            fleet.airspace,
            as_array(times),
            choose_interval_count(float(np.max(times))) if self.intervals is None else self.intervals,
            candidate_set,
            None if extra_for is None else as_array(extra_for, bool),
            *(() if self.fixed_paths is None else (self.fixed_paths,)),
        )
        failed = fleet.active & ~np.asarray(plan.feasible)
        if not failed.any():
            failed = fleet.active & self.failed_after_arrival(plan)
            if failed.any():
                state = replace(state, plan_without_holds=plan)
        return plan, failed, state


def search(
    start_time: float,
    tasks: AircraftTask,
    airspace: Airspace,
    request: ArrivalRequest,
    on_progress: Progress = lambda what: None,
    thorough: bool = True,
    failed_after_arrival: FailedAfterArrival = lambda plan: np.zeros(plan.arrival_times.shape, dtype=bool),
    fixed_paths: FixedPaths | None = None,
    intervals: int | None = None,
) -> SearchOutcome:
    """Find a plan whose certificate keeps everything.

    First the times that the rule prefers, with few candidates; then as soon after them as there is a plan; then, where
    that fails, the times that are open to each aircraft by itself, with more and more candidates; for the earliest
    plan, times before the one found.

    Parameters
    ----------
    start_time
        Now, s.
    tasks, airspace
        The task.
    request
        When to arrive.
    on_progress
        Called with what is being done.
    thorough
        False stops after the first times.
    failed_after_arrival
        Called with a plan that keeps everything: which aircraft do not after their arrivals.
    standing
        Paths that all keep clear of, of aircraft that are not active; None: there are none.
    intervals
        Even intervals between the knots of the paths; None: as the arrival times ask.
    """
    fleet = FleetTask(tasks, airspace, request)
    searcher = _Searcher(start_time, fleet, on_progress, failed_after_arrival, fixed_paths, intervals)
    on_progress("planning")
    state = searcher.run(_State(), first_stage(fleet, thorough))
    if state.plan is not None or fleet.has_fixed_times or not thorough:
        return state.outcome()
    if fleet.is_small and request.rule != "windows" and not fleet.admissible(fleet.requested_times()).any():
        return state.outcome()
    state = searcher.run(state, later_stage(fleet), to_the_end=True)
    if state.plan is not None:
        return state.outcome()
    arrivals = open_arrivals(fleet, on_progress)
    if arrivals is None:
        return state.outcome()
    state = searcher.run(state, open_stage(fleet, arrivals))
    if state.plan is not None and request.rule == "earliest" and fleet.is_small:
        arrival_s = float(np.max(np.asarray(state.plan.arrival_times)[fleet.active])) - start_time
        state = searcher.run(state, earlier_stage(fleet, arrival_s), to_the_end=True)
    return state.outcome(None if request.rule == "windows" else arrivals)
