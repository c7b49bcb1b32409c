"""Search for a fleet's plan: attempts with arrival times and candidate sets, until a certificate is satisfied.

A proposal names arrival times and a candidate set. An attempt plans the fleet for a proposal, and ends with a plan or
with the mask of failed aircraft. A stage is a generator of proposals that receives the result of each attempt.
"""

import contextlib
import itertools
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from anser.numerics.arrays import as_array
from anser.planning.certified.arrival_times import (
    arrival_conflicts,
    arrival_sets,
    climb_times_min,
    common_times,
    direct_times,
    earlier_times,
    first_index,
    may_arrive,
    sample_interval,
    straight_times,
)
from anser.planning.certified.candidates import Candidates
from anser.planning.certified.certified_plan import (
    SMALL_FLEET,
    CertifiedPlan,
    FixedPaths,
    choose_interval_count,
    plans_at,
    standard_candidates,
)
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest, ArrivalTimes, Intervals
from anser.planning.certified.timed_profiles import MINIMAL, STANDARD, WITH_SPLINES, WITH_TURN_LEG_PATHS, CandidateSet

_DELAYS = (1.0, 1.01, 1.03, 1.06, 1.1, 1.15, 1.22, 1.3, 1.4, 1.55, 1.75, 2.0, 2.4, 3.0)  # factors of the first time
DELAY_RATIO = 1.008
"""Ratio of two consecutive arrival times, without offsets, that the search tries in single steps."""
# Factors of the first time: every kind of candidate is tried before a longer delay; first for two consecutive times,
# because an arrival at most one step later is preferred to further candidates.
_DELAY_BOUNDS = (1.0, DELAY_RATIO**1.5, 1.03, 1.3, 3.0)
_LONG_DELAY = 1.3  # factor up to which the standard candidates are tried in single steps
# Slightly later than by the direct path: a path of exactly its length may not exist, to rounding.
_DIRECT_TIME_FACTOR = 1.0002
# Greatest mean airspeed in windows over the preferred airspeed: makes up for the turns of the direct path.
_WINDOW_SPEED_FACTOR = 1.005
_LIST_FRACTIONS = (0.0, 0.1, 0.25, 0.5, 0.8)  # positions in the list of open times for further candidates
_GRID_S = 0.25  # spacing of the arrival times tested for the necessary conditions
_WINDOW_FRACTIONS = (0.0, 0.12, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0)
_WINDOW_ROTATIONS = 8
_DIRECT_INTERVALS = 64


@dataclass(frozen=True)
class FleetTask:
    """Planning problem of a fleet: tasks of the aircraft, airspace, and arrival rule."""

    tasks: AircraftTask  # planning problem of each aircraft, stacked
    airspace: Airspace  # environment that the aircraft share
    request: ArrivalRequest  # arrival rule
    # candidate sets in the order of trial, from the cheapest to the most thorough; a large fleet tries `STANDARD` only
    candidate_sets: tuple[CandidateSet, ...] = (STANDARD, WITH_TURN_LEG_PATHS, WITH_SPLINES)

    @cached_property
    def active(self) -> Bool[np.ndarray, " aircraft"]:
        """Mask of the active aircraft."""
        return np.asarray(self.tasks.active) > 0.0

    @property
    def indices(self) -> Int[np.ndarray, " active"]:
        """Indices of the active aircraft."""
        return np.flatnonzero(self.active)

    @property
    def offsets(self) -> ArrivalTimes:
        """Delay after the first arrival, s, that the arrival rule requires of each aircraft."""
        return self.request.offsets(self.active.size)

    @property
    def latest_first_s(self) -> float:
        """Latest time of the first arrival, s, with which the last of the active aircraft arrives in time."""
        return self.request.latest_s - float(np.max(self.offsets[self.indices], initial=0.0))

    @property
    def has_fixed_times(self) -> bool:
        """Whether the arrival rule prescribes the arrival time of every aircraft."""
        return self.request.rule in ("at", "times")

    @property
    def is_small(self) -> bool:
        """Whether at most `SMALL_FLEET` aircraft are active, for which every kind of candidate is tried."""
        return self.indices.size <= SMALL_FLEET

    @property
    def levels(self) -> tuple[CandidateSet, ...]:
        """Candidate sets in the order of trial, from the cheapest to the most thorough."""
        return self.candidate_sets if self.is_small else (STANDARD,)

    @cached_property
    def preferred_times(self) -> ArrivalTimes:
        """Preferred flight time of each aircraft, s: direct path at the preferred mean airspeed, or climb if longer.

        If `direct_times` does not converge, the straight line replaces the direct path. In windows, the time of the
        direct path is divided by up to `_WINDOW_SPEED_FACTOR`, but not reduced below the time of the straight line.
        """
        tasks, windows_s = self.tasks, self.request.windows_s
        direct, converged = (np.asarray(x) for x in direct_times(tasks, self.airspace, tasks.speed, _DIRECT_INTERVALS))
        if windows_s is not None or not converged.all():
            straight = np.asarray(straight_times(tasks, self.airspace))
            direct = np.where(converged, direct, straight)
            if windows_s is not None:
                direct = np.maximum(direct / _WINDOW_SPEED_FACTOR, np.minimum(direct, straight))
        return np.clip(np.maximum(direct, climb_times_min(tasks, self.airspace)), 1.0, self.request.latest_s)

    def admissible(self, times: Float[np.ndarray, "n aircraft"]) -> Bool[np.ndarray, " n"]:
        """Return whether each set (row) of arrival times, s after the start, meets the necessary conditions."""
        repeated_indices = np.tile(self.indices, times.shape[0])
        meets_conditions = may_arrive(
            self.tasks, self.airspace, repeated_indices, times[:, self.indices].ravel()
        ).reshape(times.shape[0], self.indices.size)
        return np.all(meets_conditions, axis=1) & ~arrival_conflicts(self.tasks, self.airspace, times).any(axis=(1, 2))

    def requested_times(self) -> Float[np.ndarray, "n aircraft"]:
        """Return the sets of arrival times to test, (set, aircraft), s: prescribed, or first arrivals every 0.25 s."""
        if self.request.times_s is not None:
            return self.request.times_s[None]
        return np.append(np.arange(_GRID_S, self.latest_first_s, _GRID_S), self.latest_first_s)[:, None] + self.offsets

    def common_intervals(self, arrivals: Sequence[Intervals]) -> Intervals:
        """Return intervals of the first arrival time, s, for which every active aircraft can arrive `offsets` later.

        `arrivals` are each aircraft's reachable intervals. Results begin by `latest_first_s`, but may end later.
        """
        open_intervals = [sets if on else [(0.0, np.inf)] for sets, on in zip(arrivals, self.active, strict=True)]
        return [(a, b) for a, b in common_times(open_intervals, self.offsets) if a <= self.latest_first_s]


@dataclass(frozen=True)
class Proposal:
    """Arrival times (s after the start) and candidate set for an attempt, and a progress message or None."""

    times: ArrivalTimes
    candidate_set: CandidateSet
    message: str | None = None


FailedAircraft = Bool[np.ndarray, " aircraft"]
Stage = Generator[Proposal, FailedAircraft, None]
"""Generator of proposals that receives the mask of failed aircraft after each attempt: all False for a plan."""


def _make_proposal(times: ArrivalTimes, candidate_set: CandidateSet) -> Proposal:
    return Proposal(times, candidate_set, f"trying arrival at {float(np.max(times)):.1f} s")


def first_stage(fleet: FleetTask, thorough: bool) -> Stage:
    """Propose the preferred times with `MINIMAL` and, if admissible, with larger candidate sets.

    If `thorough` is False, or the arrival rule does not fix the times, `STANDARD` is the only larger set.
    """
    preferred_times = _preferred_arrival_times(fleet)
    if preferred_times is None:
        return
    yield Proposal(preferred_times, MINIMAL)
    if fleet.admissible(np.asarray(preferred_times, dtype=float)[None])[0]:
        for candidate_set in fleet.levels if fleet.has_fixed_times and thorough else (STANDARD,):
            yield Proposal(preferred_times, candidate_set)


def later_stage(fleet: FleetTask) -> Stage:
    """Propose the preferred arrival times, later times, and times between; the last plan found is the earliest.

    In windows, each aircraft is delayed individually.
    """
    preferred_times = _preferred_arrival_times(fleet)
    if preferred_times is None:
        return
    individually = fleet.request.rule == "windows"
    times = preferred_times.copy()
    groups = [fleet.indices[k : k + 1] for k in range(fleet.indices.size)] if individually else [fleet.indices]
    # In each range of delays, other candidate sets are tried before the first feasible time of the standard candidates,
    # because a loop is better than an arrival at twice the time.
    for delay_min, delay_max in itertools.pairwise(_DELAY_BOUNDS):
        delays = [_delays(fleet, indices, preferred_times, delay_min, delay_max) for indices in groups]
        in_single_steps = fleet.is_small and delay_max <= _LONG_DELAY
        one_by_one = max((len(group_delays.times) for group_delays in delays), default=1) if in_single_steps else 1
        index = yield from _find_first_open(delays, times, (STANDARD,), one_by_one)
        if fleet.levels[1:]:
            earlier_delays = [group_delays.truncated(k) for group_delays, k in zip(delays, index, strict=True)]
            better = yield from _find_first_open(earlier_delays, times, fleet.levels[1:], 1)
            index = [old if new is None else new for old, new in zip(index, better, strict=True)]
        groups = [indices for indices, k in zip(groups, index, strict=True) if k is None]
        if not groups:
            break
    if individually and not groups:
        yield from _attempt_candidate_sets(times, fleet.levels)


@dataclass(frozen=True)
class _DelayedTimes:
    """Arrival times to try, ascending, of aircraft delayed together: the fleet, or one aircraft with a window."""

    indices: Int[np.ndarray, " group"]  # indices of the aircraft
    times: Float[np.ndarray, "n group"]  # sets of arrival times, s

    def truncated(self, index: int | None) -> "_DelayedTimes":
        """Return the times before `index` (None: all times); no times if `times[index]` is close to the first time."""
        is_close = index is not None and self.times[index, 0] <= DELAY_RATIO**1.5 * self.times[0, 0]
        return _DelayedTimes(self.indices, self.times[: 0 if is_close else index])


def _delays(
    fleet: FleetTask, indices: Int[np.ndarray, " group"], first_times: ArrivalTimes, delay_min: float, delay_max: float
) -> _DelayedTimes:
    """Return the admissible arrival times of a group of aircraft (`indices`) that are delayed together.

    times = offsets + factor * (`first_times` - offsets), with `offsets` of `FleetTask`. The factors are the powers of
    `DELAY_RATIO` from `delay_min` to below `delay_max`.
    """
    windows, offsets = fleet.request.windows_s, fleet.offsets
    factors = DELAY_RATIO ** np.arange(
        np.ceil(np.log(delay_min) / np.log(DELAY_RATIO)), np.log(delay_max) / np.log(DELAY_RATIO)
    )
    times = factors[:, None] * (first_times - offsets) + offsets
    latest = fleet.request.latest_s if windows is None else windows[indices, 1]
    times = times[np.all(times[:, indices] <= latest, axis=1)]
    if windows is None:
        return _DelayedTimes(indices, times[fleet.admissible(times)][:, indices])
    admissible = may_arrive(fleet.tasks, fleet.airspace, np.repeat(indices, len(times)), times[:, indices].ravel())
    return _DelayedTimes(indices, times[admissible][:, indices])


def _find_first_open(
    delays: Sequence[_DelayedTimes], times: ArrivalTimes, candidate_sets: Sequence[CandidateSet], one_by_one: int
) -> Generator[Proposal, FailedAircraft, list[int | None]]:
    """Search each entry of `delays` for the first feasible time; return the indices, None if no time is feasible.

    Each proposal tests a time of every entry; feasible times are put into `times` (s). `one_by_one`: see `first_index`.
    """
    scans = {k: first_index(len(group_delays.times), one_by_one) for k, group_delays in enumerate(delays)}
    index: list[int | None] = [None] * len(delays)
    is_open: dict[int, bool | None] = dict.fromkeys(scans)
    while True:
        proposed = times.copy()
        for k in list(scans):
            try:
                proposed[delays[k].indices] = delays[k].times[scans[k].send(is_open[k])]
            except StopIteration as end:
                index[k] = end.value
                del scans[k]
                if end.value is not None:
                    times[delays[k].indices] = proposed[delays[k].indices] = delays[k].times[end.value]
        if not scans:
            return index
        failed = yield from _attempt_candidate_sets(proposed, candidate_sets)
        is_open = {k: not failed[delays[k].indices].any() for k in scans}


def _attempt_candidate_sets(
    times: ArrivalTimes, candidate_sets: Sequence[CandidateSet]
) -> Generator[Proposal, FailedAircraft, FailedAircraft]:
    """Propose candidate sets in order until no aircraft fails; return the mask of failures with the last set."""
    failed = np.ones(times.shape, dtype=bool)
    for candidate_set in candidate_sets:
        failed = yield _make_proposal(times, candidate_set)
        if not failed.any():
            break
    return failed


def open_stage(fleet: FleetTask, arrivals: Sequence[Intervals]) -> Stage:
    """Propose times at which every aircraft, flying alone, can arrive, with increasingly thorough candidate sets."""
    times = [t for t in _times_open_to_all(fleet, arrivals) if fleet.admissible(t[None])[0]]
    selected_times = [times[k] for k in sorted({round(u * (len(times) - 1)) for u in _LIST_FRACTIONS})] if times else []
    for candidate_set in fleet.levels:
        for t in times if candidate_set is STANDARD else selected_times:
            yield _make_proposal(t, candidate_set)


def earlier_stage(fleet: FleetTask, plan_arrival_s: float) -> Stage:
    """Propose common arrival times before `plan_arrival_s`, the arrival time of the plan found, s after the start."""
    times, is_feasible = fleet.requested_times(), None
    search = earlier_times(times[fleet.admissible(times), 0], plan_arrival_s)
    with contextlib.suppress(StopIteration):
        while True:
            time = search.send(is_feasible)
            message = f"trying an earlier arrival at {time:.1f} s"
            failed = yield Proposal(np.full(fleet.active.size, time), WITH_SPLINES, message)
            is_feasible = not failed.any()


def open_arrivals(fleet: FleetTask, on_progress: Callable[[str], None]) -> list[Intervals] | None:
    """Return each aircraft's intervals of reachable arrival times, s after the start; None if a window has none."""
    request = fleet.request
    on_progress("searching the possible arrival times of each aircraft")
    arrivals = arrival_sets(fleet.tasks, fleet.airspace, request.latest_s, request.windows_s)
    if request.windows_s is not None:
        is_closed = any(on and not intervals for on, intervals in zip(fleet.active, arrivals, strict=True))
        return None if is_closed else arrivals
    if fleet.is_small and not fleet.common_intervals(arrivals):
        on_progress("searching a common arrival time again, with splines")
        arrivals = arrival_sets(fleet.tasks, fleet.airspace, request.latest_s, with_splines=True)
    return arrivals


def _preferred_arrival_times(fleet: FleetTask) -> ArrivalTimes | None:
    """Return the arrival times, s, one per aircraft, that the arrival rule prescribes or prefers.

    None for the rule "earliest", or if a preferred time is later than the latest allowed arrival.
    """
    request, preferred = fleet.request, fleet.preferred_times
    if request.times_s is not None:
        return request.times_s
    if request.windows_s is not None:
        return np.clip(_DIRECT_TIME_FACTOR * preferred, request.windows_s[:, 0], request.windows_s[:, 1])
    if request.rule == "earliest":
        return None
    times = _DIRECT_TIME_FACTOR * _preferred_first_arrival(fleet) + fleet.offsets
    return times if np.max(times[fleet.indices]) <= request.latest_s else None


def _preferred_first_arrival(fleet: FleetTask) -> float:
    """Return the first arrival, s, with which every active aircraft arrives at its preferred time or later."""
    return float(np.max((fleet.preferred_times - fleet.offsets)[fleet.indices]))


def _times_open_to_all(fleet: FleetTask, arrivals: Sequence[Intervals]) -> Iterator[ArrivalTimes]:
    """Yield sets of times, s, at which each aircraft alone can arrive: ascending; in windows, preferred times first."""
    request = fleet.request
    if request.windows_s is not None:
        yield from _window_times(fleet.preferred_times, request.windows_s, arrivals)
        return
    latest_first_arrival, base = fleet.latest_first_s, _preferred_first_arrival(fleet)
    common = fleet.common_intervals(arrivals)
    if request.rule == "earliest":
        first_arrivals = [t for a, b in common for t in sample_interval(a, min(b, latest_first_arrival))]
    else:
        first_arrivals = [min(max(base * f, a), b) for f in _DELAYS for a, b in common if a <= base * f <= b]
        first_arrivals += [
            t for a, b in common if b >= base for t in sample_interval(max(a, base), min(b, latest_first_arrival))
        ]
    for time in sorted({round(t, 9) for t in first_arrivals if 0.0 < t <= latest_first_arrival}):
        yield time + fleet.offsets


def _window_times(
    preferred_times: ArrivalTimes, windows_s: Float[np.ndarray, "aircraft 2"], arrivals: Sequence[Intervals]
) -> Iterator[ArrivalTimes]:
    """Yield sets of reachable arrival times within the windows (s), one time per aircraft, the preferred first."""
    grids = []
    for (low, high), intervals, preferred_time in zip(windows_s, arrivals, preferred_times, strict=True):
        inside = [(max(a, low), min(b, high)) for a, b in intervals if max(a, low) <= min(b, high)] or [(low, high)]
        times = {float(a + (b - a) * u) for a, b in inside for u in _WINDOW_FRACTIONS}
        grids.append(sorted(times, key=lambda t: abs(t - preferred_time)))
    # Every aircraft takes the next nearest time to its preferred time.
    for shift in range(max(len(grid) for grid in grids)):
        yield np.array([grid[min(shift, len(grid) - 1)] for grid in grids])
    # Each aircraft at a different index of its grid: resolves conflicts that remain under a common shift.
    for shift in range(1, _WINDOW_ROTATIONS):
        yield np.array([grid[(k * shift) % len(grid)] for k, grid in enumerate(grids)])


_TIME_TOLERANCE = 5e-4  # relative difference below which two arrival times count as the same attempt
_EXTENSIONS = 2  # greatest number of repetitions of an attempt with extra candidates for further aircraft

Progress = Callable[[str], None]
FailedAfterArrival = Callable[[CertifiedPlan], np.ndarray]


@dataclass(frozen=True)
class SearchOutcome:
    """Result of a search: the plan, or the attempts that came closest to a plan."""

    plan: CertifiedPlan | None  #: None if the search failed.
    attempts: int  #: Number of attempts, each with a set of arrival times and a candidate set.
    best_attempt: CertifiedPlan | None = None  #: If there is no plan: attempt with the fewest failed aircraft.
    #: Each aircraft's intervals of arrival times that it can reach alone, s after the start; None if not computed.
    arrivals: list[Intervals] | None = None
    #: If there is no plan: attempt that satisfies every constraint up to the arrivals, but lacks holds.
    plan_without_holds: CertifiedPlan | None = None
    #: If there is a plan: failed attempt with the latest arrival times before the plan's arrival times.
    earlier_attempt: CertifiedPlan | None = None

    def leading(self, count: int) -> "SearchOutcome":
        """Return the result for the first `count` aircraft."""
        plan, best_attempt, plan_without_holds, earlier_attempt = (
            None if plan is None else plan.leading(count)
            for plan in (self.plan, self.best_attempt, self.plan_without_holds, self.earlier_attempt)
        )
        arrivals = None if self.arrivals is None else self.arrivals[:count]
        return SearchOutcome(plan, self.attempts, best_attempt, arrivals, plan_without_holds, earlier_attempt)


class _Attempt(NamedTuple):
    times: ArrivalTimes
    candidate_set: CandidateSet
    failed: FailedAircraft  # mask of the aircraft that lack a valid path or a hold at these times
    plan: CertifiedPlan  # paths of the attempt, proven or not
    fails_after_arrival: bool  # whether all paths are proven, and only holds are missing


class FailedAttempt(str):
    """Progress message before turn-and-leg paths or splines are tried; `attempt` failed with standard candidates."""

    attempt: CertifiedPlan  #: Paths of the standard candidates, for all aircraft of the search.

    def __new__(cls, text: str, attempt: CertifiedPlan) -> "FailedAttempt":
        """Return the message `text` with an attempt."""
        message = super().__new__(cls, text)
        message.attempt = attempt
        return message


@dataclass
class _Search:
    """Search in progress: the arguments of `search`, the attempts so far, and the results as in `SearchOutcome`."""

    start_time: float
    fleet: FleetTask  # with the keep-outs at their positions at `start_time`
    airspace: Airspace
    on_progress: Progress
    failed_after_arrival: FailedAfterArrival
    fixed_paths: FixedPaths | None
    intervals: int | None
    tried: list[_Attempt] = field(default_factory=list)
    plan: CertifiedPlan | None = None
    best_attempt: CertifiedPlan | None = None
    plan_without_holds: CertifiedPlan | None = None
    standard: tuple[ArrivalTimes, Candidates] | None = None  # the last arrival times, and their standard candidates

    def outcome(self, arrivals: list[Intervals] | None = None) -> SearchOutcome:
        if self.plan is not None:
            earlier = self._latest_failure_before(np.asarray(self.plan.arrival_times) - self.start_time)
            return SearchOutcome(self.plan, len(self.tried), arrivals=arrivals, earlier_attempt=earlier)
        return SearchOutcome(None, len(self.tried), self.best_attempt, arrivals, self.plan_without_holds)

    def _latest_failure_before(self, times: ArrivalTimes) -> CertifiedPlan | None:
        """Return the failed attempt with the latest arrival times (by their sum) before `times`; None if none."""
        failures = [past for past in self.tried if past.failed.any() and np.sum(past.times) < np.sum(times)]
        return max(reversed(failures), key=lambda past: float(np.sum(past.times))).plan if failures else None

    def run(self, stage: Stage, run_to_end: bool = False) -> None:
        """Attempt the proposals of a stage up to the first plan, or all (`run_to_end`); store the last plan found."""
        with contextlib.suppress(StopIteration):
            proposal = next(stage)
            while True:
                if proposal.message is not None:
                    self.on_progress(proposal.message)
                plan = self.attempt(proposal.times, proposal.candidate_set)
                if plan is not None:
                    self.plan = plan
                    if not run_to_end:
                        break
                failed = self.failed_at(proposal.times, proposal.candidate_set)
                # Without a recorded attempt for this set, the standard candidates sufficed.
                proposal = stage.send(np.zeros_like(self.fleet.active) if failed is None else failed)

    def failed_at(self, times: ArrivalTimes, candidate_set: CandidateSet) -> FailedAircraft | None:
        past = self.attempt_at(times, candidate_set)
        return None if past is None else past.failed

    def attempt_at(self, times: ArrivalTimes, candidate_set: CandidateSet) -> _Attempt | None:
        """Return the attempt with the arrival times (s) and the candidate set; None if not attempted."""
        for past in self.tried:
            if past.candidate_set is candidate_set and np.allclose(times, past.times, rtol=_TIME_TOLERANCE, atol=0.0):
                return past
        return None

    def attempt(self, times: ArrivalTimes, candidate_set: CandidateSet) -> CertifiedPlan | None:
        """Plan the fleet for arrival times (s) and a candidate set; return the plan, or None if an aircraft fails.

        None also if this combination was attempted before. Extra candidates are generated only for aircraft that lack a
        proven path with the standard candidates.
        """
        if self.failed_at(times, candidate_set) is not None:
            return None
        extra_for = None
        if candidate_set.extra is not None:
            if self.failed_at(times, STANDARD) is None:
                plan = self.attempt(times, STANDARD)
                if plan is not None:
                    return plan
            standard = self.attempt_at(times, STANDARD)
            assert standard is not None
            if standard.fails_after_arrival:
                # Extra candidates would not be chosen: the choice is by cost, and they mostly cost more.
                self.tried.append(standard._replace(times=times, candidate_set=candidate_set))
                return None
            extra_for = standard.failed
            self.on_progress(FailedAttempt("trying further kinds of paths", standard.plan))
        attempt = self._make_plan(times, candidate_set, extra_for)
        for _ in range(_EXTENSIONS):
            # A new path of one aircraft may obstruct other aircraft, which then need extra candidates too.
            if extra_for is None or attempt.fails_after_arrival or not (attempt.failed & ~extra_for).any():
                break
            extra_for = extra_for | attempt.failed
            attempt = self._make_plan(times, candidate_set, extra_for)
        if np.sum(attempt.failed) < min((np.sum(past.failed) for past in self.tried), default=np.inf):
            self.best_attempt = attempt.plan
        self.tried.append(attempt)
        return None if attempt.failed.any() else attempt.plan

    def _make_plan(
        self, times: ArrivalTimes, candidate_set: CandidateSet, extra_for: FailedAircraft | None
    ) -> _Attempt:
        """Make a plan for arrival times (s); return the attempt with the mask of failed aircraft.

        If only holds are missing, the plan is stored as `plan_without_holds`, and a second attempt with regard to the
        time after the arrivals is returned if no aircraft fails. Extra candidates are for the aircraft `extra_for`.
        """
        arguments = (
            self.start_time,
            self.fleet.tasks,
            self.airspace,
            as_array(times),
            choose_interval_count(float(np.max(times))) if self.intervals is None else self.intervals,
        )
        if candidate_set is MINIMAL:
            candidates = standard_candidates(*arguments, MINIMAL)
        else:
            candidates = self._standard_candidates(times, arguments)
        plans = plans_at(
            *arguments,
            candidate_set,
            candidates,
            None if extra_for is None else as_array(extra_for, bool),
            *(() if self.fixed_paths is None else (self.fixed_paths,)),
        )
        attempt = self._judge(times, candidate_set, next(plans))
        if attempt.fails_after_arrival:
            self.plan_without_holds = attempt.plan
            separated_later = self._judge(times, candidate_set, next(plans))
            if not separated_later.failed.any():
                return separated_later
        return attempt

    def _standard_candidates(self, times: ArrivalTimes, arguments: tuple[Any, ...]) -> Candidates:
        """Return `standard_candidates(*arguments)` for arrival times (s); stored until the times change."""
        if self.standard is None or not np.array_equal(times, self.standard[0]):
            self.standard = times.copy(), standard_candidates(*arguments)
        return self.standard[1]

    def _judge(self, times: ArrivalTimes, candidate_set: CandidateSet, plan: CertifiedPlan) -> _Attempt:
        """Return the attempt; an aircraft fails if it lacks a proven path or, with all paths proven, lacks a hold."""
        failed = self.fleet.active & ~np.asarray(plan.feasible)
        if failed.any():
            return _Attempt(times, candidate_set, failed, plan, fails_after_arrival=False)
        failed = self.fleet.active & self.failed_after_arrival(plan)
        return _Attempt(times, candidate_set, failed, plan, fails_after_arrival=bool(failed.any()))


def search(
    start_time: float,  # current time, s
    tasks: AircraftTask,
    airspace: Airspace,
    request: ArrivalRequest,
    on_progress: Progress = lambda message: None,  # callback for progress messages
    thorough: bool = True,  # False: only the preferred times are tried
    # function from a feasible plan to the mask of aircraft that fail after their arrivals
    failed_after_arrival: FailedAfterArrival = lambda plan: np.zeros(plan.arrival_times.shape, dtype=bool),
    # fixed paths of inactive aircraft that the planned paths avoid; None: no fixed paths
    fixed_paths: FixedPaths | None = None,
    # number of equal intervals between the knots of the paths; None: derived from the arrival times
    intervals: int | None = None,
    candidate_sets: tuple[CandidateSet, ...] = FleetTask.candidate_sets,  # see `FleetTask`
) -> SearchOutcome:
    """Find a plan that keeps limits, separation and keep-outs, proven by its certificate.

    Arrival times are tried in this order:

    1. the times that the arrival rule of `request` prefers
    2. later times, up to the earliest feasible ones
    3. times at which each aircraft alone can arrive
    4. for the rule "earliest", times before the arrival times of the plan
    """
    fleet = FleetTask(tasks, airspace.at_start(start_time), request, candidate_sets)
    progress = _Search(start_time, fleet, airspace, on_progress, failed_after_arrival, fixed_paths, intervals)
    on_progress("planning")
    progress.run(first_stage(fleet, thorough))
    if progress.plan is not None or fleet.has_fixed_times or not thorough:
        return progress.outcome()
    if fleet.is_small and request.rule != "windows" and not fleet.admissible(fleet.requested_times()).any():
        return progress.outcome()
    progress.run(later_stage(fleet), run_to_end=True)
    if progress.plan is not None:
        return progress.outcome()
    arrivals = open_arrivals(fleet, on_progress)
    if arrivals is None:
        return progress.outcome()
    progress.run(open_stage(fleet, arrivals))
    if progress.plan is not None and request.rule == "earliest" and fleet.is_small:
        arrival_s = float(np.max(np.asarray(progress.plan.arrival_times)[fleet.active])) - start_time
        progress.run(earlier_stage(fleet, arrival_s), run_to_end=True)
    return progress.outcome(None if request.rule == "windows" else arrivals)
