"""Arrival times that the search tries, with the candidates at each, stage by stage."""

import contextlib
import itertools
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from anser.planning.certified.arrivals import arrival_sets, direct_times
from anser.planning.certified.candidate_sets import (
    MINIMAL,
    STANDARD,
    WITH_SPLINES,
    WITH_TURN_LEG_PATHS,
    CandidateSet,
)
from anser.planning.certified.earliest import earlier_times, first_index
from anser.planning.certified.necessary_conditions import arrival_conflicts, climb_times_min, may_arrive
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest, ArrivalTimes, Intervals

_DELAYS = (1.0, 1.01, 1.03, 1.06, 1.1, 1.15, 1.22, 1.3, 1.4, 1.55, 1.75, 2.0, 2.4, 3.0)  # of the first time
_STEP = 1.008  # ratio of two arrival times that are tried after each other
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
    def rows(self) -> Int[np.ndarray, " active"]:
        """Indices of those that count."""
        return np.flatnonzero(self.active)

    @property
    def offsets(self) -> ArrivalTimes:
        """How long after the first each arrives, s."""
        return self.request.offsets(self.active.size)

    @property
    def times_given(self) -> bool:
        """Whether the rule leaves no arrival time open."""
        return self.request.rule in ("at", "times")

    @property
    def is_small(self) -> bool:
        """Whether the fleet is small enough to try every kind of candidate."""
        return self.rows.size <= _SMALL_FLEET

    @property
    def levels(self) -> tuple[CandidateSet, ...]:
        """The candidates to try one after the other."""
        return (STANDARD, WITH_TURN_LEG_PATHS, WITH_SPLINES) if self.is_small else (STANDARD,)

    @cached_property
    def preferred(self) -> ArrivalTimes:
        """Time of each by the direct path at its preferred speed, s; more only if the climb certainly takes more."""
        tasks = self.tasks
        times, converged = direct_times(tasks, self.airspace, tasks.speed, _DIRECT_INTERVALS)
        line = np.asarray(tasks.rendezvous_n) - np.asarray(tasks.position_n)
        straight = np.linalg.norm(line, axis=1) / np.asarray(tasks.speed)
        direct = np.where(np.asarray(converged), np.asarray(times), straight)
        return np.clip(np.maximum(direct, climb_times_min(tasks, self.airspace)), 1.0, self.request.latest_s)

    def admissible(self, times: Float[np.ndarray, "n aircraft"]) -> Bool[np.ndarray, " n"]:
        """Which sets of arrival times (s after the start) meet the necessary conditions."""
        everyone = np.tile(self.rows, times.shape[0])
        alone = may_arrive(self.tasks, self.airspace, everyone, times[:, self.rows].ravel()).reshape(times.shape[0], -1)
        return np.all(alone, axis=1) & ~arrival_conflicts(self.tasks, self.airspace, times).any(axis=(1, 2))

    def times_asked(self) -> Float[np.ndarray, "n aircraft"]:
        """Arrival times that the rule leaves open, every quarter of a second, or those given; not for windows."""
        if self.request.times_s is not None:
            return self.request.times_s[None]
        last = self.request.latest_s - float(np.max(self.offsets))
        return np.arange(_GRID_S, last, _GRID_S)[:, None] + self.offsets

    def common(self, arrivals: Sequence[Intervals]) -> Intervals:
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


Failed = Bool[np.ndarray, " aircraft"]
Stage = Generator[Proposal, Failed, None]
"""Proposals, each answered by which aircraft failed; none: a plan was found."""


def _trying(times: ArrivalTimes, candidate_set: CandidateSet) -> Proposal:
    return Proposal(times, candidate_set, f"trying arrival at {float(np.max(times)):.1f} s")


def first_stage(fleet: FleetTask, thorough: bool) -> Stage:
    """The times that the rule prefers: with few candidates, then with more where nothing rules them out."""
    first = _first_times(fleet)
    if first is None:
        return
    yield Proposal(first, MINIMAL)
    if fleet.admissible(np.asarray(first, dtype=float)[None])[0]:
        for candidate_set in fleet.levels if fleet.times_given and thorough else (STANDARD,):
            yield Proposal(first, candidate_set)


def later_stage(fleet: FleetTask) -> Stage:
    """The first times, or as soon after them as there is a plan, where the rule leaves that open.

    The usual candidates in small steps, then every kind of candidate before the time that was found: at once for short
    delays, then for longer ones. Better a loop than to be there at twice the time. Of windows, each aircraft is put
    off by itself. The last plan found is the earliest.
    """
    first = _first_times(fleet)
    if first is None:
        return
    by_itself = fleet.request.rule == "windows"
    times, late = first.copy(), [fleet.rows[k : k + 1] for k in range(fleet.rows.size)] if by_itself else [fleet.rows]
    for near, far in itertools.pairwise(_DELAY_BOUNDS):
        delays = [_delays(fleet, rows, first, near, far) for rows in late]
        one_by_one = max((len(one.times) for one in delays), default=1) if fleet.is_small and far <= _LONG_DELAY else 1
        index = yield from _first_open(delays, times, (STANDARD,), one_by_one)
        if fleet.levels[1:]:
            before = [one.until(k) for one, k in zip(delays, index, strict=True)]
            better = yield from _first_open(before, times, fleet.levels[1:], 1)
            index = [old if new is None else new for old, new in zip(index, better, strict=True)]
        late = [rows for rows, k in zip(late, index, strict=True) if k is None]
        if not late:
            break
    if by_itself and not late:
        yield from _attempted(times, fleet.levels)


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

    rows: Int[np.ndarray, " rows"]
    times: Float[np.ndarray, "n rows"]

    def until(self, index: int | None) -> "_Delays":
        """The times before an index, all of them for None; none before one that is a single step after the first."""
        near = index is not None and self.times[index, 0] <= _STEP**1.5 * self.times[0, 0]
        return _Delays(self.rows, self.times[: 0 if near else index])


def _delays(fleet: FleetTask, rows: Int[np.ndarray, " rows"], first: ArrivalTimes, near: float, far: float) -> _Delays:
    """Times from one multiple of the first to another that the rule allows and no necessary condition rules out."""
    windows, offsets = fleet.request.windows_s, fleet.offsets
    steps = _STEP ** np.arange(np.ceil(np.log(near) / np.log(_STEP)), np.log(far) / np.log(_STEP))
    times = steps[:, None] * (first - offsets) + offsets
    latest = fleet.request.latest_s if windows is None else windows[rows, 1]
    times = times[np.all(times[:, rows] <= latest, axis=1)]
    if windows is None:
        return _Delays(rows, times[fleet.admissible(times)][:, rows])
    alone = may_arrive(fleet.tasks, fleet.airspace, np.repeat(rows, len(times)), times[:, rows].ravel())
    return _Delays(rows, times[alone][:, rows])


def _first_open(
    delays: Sequence[_Delays], times: ArrivalTimes, candidate_sets: Sequence[CandidateSet], one_by_one: int
) -> Generator[Proposal, Failed, list[int | None]]:
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
                proposed[delays[k].rows] = delays[k].times[scans[k].send(open_at[k])]
            except StopIteration as end:
                index[k] = end.value
                del scans[k]
                if end.value is not None:
                    times[delays[k].rows] = proposed[delays[k].rows] = delays[k].times[end.value]
        if not scans:
            return index
        failed = yield from _attempted(proposed, candidate_sets)
        open_at = {k: not failed[delays[k].rows].any() for k in scans}


def _attempted(times: ArrivalTimes, candidate_sets: Sequence[CandidateSet]) -> Generator[Proposal, Failed, Failed]:
    """Which aircraft fail with the last of some candidate sets; the first with which none fails is enough."""
    failed = np.ones(times.shape, dtype=bool)
    for candidate_set in candidate_sets:
        failed = yield _trying(times, candidate_set)
        if not failed.any():
            break
    return failed


def open_stage(fleet: FleetTask, arrivals: Sequence[Intervals]) -> Stage:
    """Times that are open to each aircraft by itself, with more and more candidates."""
    times = [t for t in _times_open_to_all(fleet, arrivals) if fleet.admissible(t[None])[0]]
    few = [times[k] for k in sorted({round(u * (len(times) - 1)) for u in _PARTS_OF_SMALL})] if times else []
    for candidate_set in fleet.levels:
        for t in times if candidate_set is STANDARD else few:
            yield _trying(t, candidate_set)


def earlier_stage(fleet: FleetTask, known_s: float) -> Stage:
    """Times between the first that nothing rules out and that of a plan (s after its start)."""
    times, works = fleet.times_asked(), None
    tried = earlier_times(times[fleet.admissible(times), 0], known_s)
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
    if fleet.is_small and not fleet.common(arrivals):
        on_progress("looking again, with splines, for a time that is open to all")
        arrivals = arrival_sets(fleet.tasks, fleet.airspace, request.latest_s, with_splines=True)
    return arrivals


def _first_times(fleet: FleetTask) -> ArrivalTimes | None:
    """The times that the rule asks for first; None where they must be looked for."""
    request, preferred = fleet.request, fleet.preferred
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
    request, offsets, preferred = fleet.request, fleet.offsets, fleet.preferred
    if request.windows_s is not None:
        yield from _window_times(preferred, request.windows_s, arrivals)
        return
    last = request.latest_s - float(np.max(offsets))
    base = float(np.max(preferred - offsets))
    common = fleet.common(arrivals)
    if request.rule == "earliest":
        wanted = [t for a, b in common for t in _spread(a, min(b, last))]
    else:
        wanted = [min(max(base * f, a), b) for f in _DELAYS for a, b in common if a <= base * f <= b]
        wanted += [t for a, b in common if b >= base for t in _spread(max(a, base), min(b, last))]
    for time in sorted({round(t, 9) for t in wanted if 0.0 < t <= last}):
        yield time + offsets


def _spread(low: float, high: float) -> list[float]:
    """Times of an interval, the early ones densely."""
    if not high > low:
        return [low]
    top = min(high, 2.5 * low + 10.0)
    return [low + (top - low) * u for u in (0.0, 0.002, 0.01, 0.03, 0.07, 0.14, 0.25, 0.4, 0.6, 0.8, 1.0)]


def _window_times(
    preferred: ArrivalTimes, windows_s: Float[np.ndarray, "aircraft 2"], arrivals: Sequence[Intervals]
) -> Iterator[ArrivalTimes]:
    """One time within each window that is open to its aircraft; then all shifted within their windows."""
    grids = []
    for (low, high), sets, wish in zip(windows_s, arrivals, preferred, strict=True):
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
