"""The search for a plan of a fleet: arrival times and candidates tried stage by stage until a certificate keeps all."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from anser.numerics import as_array
from anser.planning.certified.arrival_proposals import (
    Failed,
    FleetTask,
    Stage,
    earlier_stage,
    first_stage,
    later_stage,
    open_arrivals,
    open_stage,
)
from anser.planning.certified.candidate_sets import STANDARD, CandidateSet
from anser.planning.certified.certified_plan import CertifiedPlan, Standing, intervals_for, plan_at
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest, ArrivalTimes, Intervals

_TIME_TOLERANCE = 5e-4  # part of itself by which a time differs from one that need not be tried again
_EXTENSIONS = 2  # times at most that an attempt is repeated with more aircraft that look at the extra candidates

Progress = Callable[[str], None]
FailedAfterArrival = Callable[[CertifiedPlan], np.ndarray]


@dataclass(frozen=True)
class Outcome:
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
    without_holds: CertifiedPlan | None = None

    def leading(self, count: int) -> "Outcome":
        """Of the first aircraft only."""
        plans = (None if one is None else one.leading(count) for one in (self.plan, self.best_attempt))
        without_holds = None if self.without_holds is None else self.without_holds.leading(count)
        arrivals = None if self.arrivals is None else self.arrivals[:count]
        return Outcome(next(plans), self.attempts, next(plans), arrivals, without_holds)


@dataclass(frozen=True)
class _Attempt:
    """Arrival times and candidates that were tried, and which aircraft failed."""

    times: ArrivalTimes
    candidate_set: CandidateSet
    failed: Failed


@dataclass(frozen=True)
class _State:
    """How far the search has come: the attempts made, the plan where one was found; the others as in `Outcome`."""

    tried: tuple[_Attempt, ...] = ()
    plan: CertifiedPlan | None = None
    best_attempt: CertifiedPlan | None = None
    without_holds: CertifiedPlan | None = None

    def failed_at(self, times: ArrivalTimes, candidate_set: CandidateSet) -> Failed | None:
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

    def outcome(self, arrivals: list[Intervals] | None = None) -> Outcome:
        """The result of the search."""
        if self.plan is not None:
            return Outcome(self.plan, len(self.tried), arrivals=arrivals)
        return Outcome(None, len(self.tried), self.best_attempt, arrivals, self.without_holds)


@dataclass(frozen=True)
class _Searcher:
    """What does not change during a search: see `search`."""

    start_time: float
    fleet: FleetTask
    on_progress: Progress
    failed_after_arrival: FailedAfterArrival
    standing: Standing | None
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
        self, state: _State, times: ArrivalTimes, candidate_set: CandidateSet, extra_for: Failed | None
    ) -> tuple[CertifiedPlan, Failed, _State]:
        """A plan, and which aircraft fail before or after their arrivals."""
        fleet = self.fleet
        plan = plan_at(
            self.start_time,
            fleet.tasks,
            fleet.airspace,
            as_array(times),
            intervals_for(float(np.max(times))) if self.intervals is None else self.intervals,
            candidate_set,
            None if extra_for is None else as_array(extra_for, bool),
            *(() if self.standing is None else (self.standing,)),
        )
        failed = fleet.active & ~np.asarray(plan.feasible)
        if not failed.any():
            failed = fleet.active & self.failed_after_arrival(plan)
            if failed.any():
                state = replace(state, without_holds=plan)
        return plan, failed, state


def search(
    start_time: float,
    tasks: AircraftTask,
    airspace: Airspace,
    request: ArrivalRequest,
    on_progress: Progress = lambda what: None,
    thorough: bool = True,
    failed_after_arrival: FailedAfterArrival = lambda plan: np.zeros(plan.arrival_times.shape, dtype=bool),
    standing: Standing | None = None,
    intervals: int | None = None,
) -> Outcome:
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
    searcher = _Searcher(start_time, fleet, on_progress, failed_after_arrival, standing, intervals)
    on_progress("planning")
    state = searcher.run(_State(), first_stage(fleet, thorough))
    if state.plan is not None or fleet.times_given or not thorough:
        return state.outcome()
    if fleet.is_small and request.rule != "windows" and not fleet.admissible(fleet.times_asked()).any():
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
