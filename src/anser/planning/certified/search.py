"""Planning a fleet by a rule of arrival: which times to try, and what to say where none will do."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from anser.planning.certified.arrivals import arrival_sets, direct_times
from anser.planning.certified.certified_plan import CertifiedPlan, plan_at, ticks_for
from anser.planning.certified.choices import ALL, EVERY, FEW, MANY, Choices
from anser.planning.certified.earliest import earliest_time
from anser.planning.certified.profile import CLIMB_ACCELERATION
from anser.planning.certified.request import Airspace, Traveller
from anser.planning.certified.ruled_out import conceivable, crowded

RULES = ("together", "earliest", "at", "sequence", "times", "windows")
_LATER = (1.0, 1.01, 1.03, 1.06, 1.1, 1.15, 1.22, 1.3, 1.4, 1.55, 1.75, 2.0, 2.4, 3.0)
_MUCH_LATER = 1.3  # times the first time
_THOROUGHLY = (1.0, 1.06, 1.15, 1.3)  # the same, of the times at which every kind of candidate is tried
_A_HAIR = 1.0002  # later than the direct path takes: to rounding there may be none of just its length
_SAME = 5e-4  # part of itself by which a time differs from one that need not be tried again
_SOME = (0.0, 0.1, 0.25, 0.5, 0.8)  # parts of the list of times at which more than the plain candidates are tried
_WIDER = 2  # times at most that a try is made again, with more aircraft that look at every candidate
_STEP_S = 0.25  # between arrival times that are looked at for what rules them out
_THOROUGH_FLEET = 12  # aircraft up to which every kind of candidate is tried
_WINDOW_STEPS = (0.0, 0.12, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0)

Told = Callable[[str], None]
After = Callable[[CertifiedPlan], np.ndarray]
Times = Float[np.ndarray, " aircraft"]
Intervals = list[tuple[float, float]]


@dataclass(frozen=True)
class ArrivalRequest:
    """When a fleet is to arrive.

    Attributes
    ----------
    rule
        One of `RULES`: "together" (one time, the first at which the farthest can be there at its preferred speed),
        "earliest" (the first that is found, see `earliest_time`), "at" (a given one), "sequence" (one after another),
        "times" (each at its own), "windows" (each within its own).
    times_s
        For "at" and "times", one per aircraft, s after the start of the plan.
    offsets_s
        For "sequence": how long after the first each arrives, s; else zeros.
    windows_s
        For "windows": (aircraft, 2), s.
    latest_s
        No arrival is later than this, s.
    """

    rule: str
    latest_s: float
    times_s: Times | None = None
    offsets_s: Times | None = None
    windows_s: Float[np.ndarray, "aircraft 2"] | None = None


@dataclass(frozen=True)
class Outcome:
    """What came of a search.

    Attributes
    ----------
    plan
        The plan; None where none was found.
    tries
        Number of sets of arrival times and candidates tried.
    closest
        The try with the fewest aircraft in trouble, where there is no plan.
    arrivals
        Per aircraft, the arrival times open to it alone (s after the start), where they were needed.
    unheld
        A plan that keeps everything up to the arrivals, but not after them, where there is no other.
    """

    plan: CertifiedPlan | None
    tries: int
    closest: CertifiedPlan | None = None
    arrivals: list[Intervals] | None = field(default=None)
    unheld: CertifiedPlan | None = None


def search(
    start_time: float,
    travellers: Traveller,
    airspace: Airspace,
    request: ArrivalRequest,
    told: Told = lambda what: None,
    thorough: bool = True,
    after: After = lambda plan: np.zeros(plan.arrival_times.shape, dtype=bool),
) -> Outcome:
    """Find a plan whose certificate keeps everything.

    First the times that the rule prefers, with few candidates; then, where that fails, the times that are open to each
    aircraft by itself, with more and more candidates.

    Parameters
    ----------
    start_time
        Now, s.
    travellers, airspace
        The task.
    request
        When to arrive.
    told
        Called with what is being done.
    thorough
        False stops after the first times.
    after
        Called with a plan that keeps everything: which aircraft do not after their arrivals.
    """
    active = np.asarray(travellers.active) > 0.0
    size = int(np.sum(active))
    tries, closest, fewest = 0, None, np.inf
    unheld: CertifiedPlan | None = None
    tried: list[tuple[Choices, Times, np.ndarray]] = []

    def found_at(durations: Times, choices: Choices) -> np.ndarray | None:
        """Which aircraft were in trouble where that was tried; None where it was not."""
        for kind, times, lost in tried:
            if kind is choices and np.allclose(durations, times, rtol=_SAME, atol=0.0):
                return lost
        return None

    def planned(
        durations: Times, choices: Choices, sought: Bool[np.ndarray, " aircraft"] | None
    ) -> tuple[CertifiedPlan, np.ndarray]:
        """A plan, and which aircraft are in trouble."""
        ticks = ticks_for(float(np.max(durations)))
        nonlocal unheld
        about = None if sought is None else jnp.asarray(sought)
        plan = plan_at(start_time, travellers, airspace, jnp.asarray(durations), ticks, choices, about)
        lost = active & ~np.asarray(plan.good)
        if not lost.any():
            lost = active & after(plan)
            unheld = plan if lost.any() else unheld
        return plan, lost

    def attempt(durations: Times, choices: Choices) -> CertifiedPlan | None:
        nonlocal tries, closest, fewest
        if found_at(durations, choices) is not None:
            return None
        sought = None
        if choices.beyond is not None:
            sought = found_at(durations, MANY)
            if sought is None:
                plan = attempt(durations, MANY)
                if plan is not None:
                    return plan
                sought = found_at(durations, MANY)
        tries += 1
        plan, lost = planned(durations, choices, sought)
        for _ in range(_WIDER):
            # One that finds something at last may be in the way of others, which then need more to choose from too.
            if sought is None or not (lost & ~sought).any():
                break
            sought = sought | lost
            plan, lost = planned(durations, choices, sought)
        tried.append((choices, durations, lost))
        if np.sum(lost) < fewest:
            closest, fewest = plan, np.sum(lost)
        return None if lost.any() else plan

    def earlier(plan: CertifiedPlan) -> CertifiedPlan:
        """The earliest plan that is found between the first time that nothing rules out and that of a plan."""

        def works(time: float) -> bool:
            nonlocal plan
            told(f"looking for an earlier arrival, at {time:.1f} s")
            made = attempt(np.full(active.size, time), EVERY)
            plan = plan if made is None else made
            return made is not None

        times, open_to_all = possible_times(travellers, airspace, request)
        arrival = float(np.max(np.asarray(plan.arrival_times)[active])) - start_time
        earliest_time(times[open_to_all, 0], arrival, works)
        return plan

    told("planning")
    fixed = request.rule in ("at", "times")
    thorough_fleet = size <= _THOROUGH_FLEET
    levels = (MANY, ALL, EVERY) if thorough_fleet else (MANY,)
    preferred = _preferred(travellers, airspace, request)
    first = _first_times(preferred, request)
    if first is not None:
        plan = attempt(first, FEW)
        if plan is not None:
            return Outcome(plan, tries)
        if _possible(travellers, airspace, first):
            for choices in levels if fixed and thorough else (MANY,):
                plan = attempt(first, choices)
                if plan is not None:
                    return Outcome(plan, tries)
    if fixed or not thorough:
        return Outcome(None, tries, closest, unheld=unheld)
    if thorough_fleet and request.rule != "windows" and not possible_times(travellers, airspace, request)[1].any():
        return Outcome(None, tries, closest, unheld=unheld)
    for durations, choices in _later_times(first, request, levels):
        if not _possible(travellers, airspace, durations):
            continue
        told(f"trying arrival at {float(np.max(durations)):.1f} s")
        plan = attempt(durations, choices)
        if plan is not None:
            return Outcome(plan, tries)
    told("looking for arrival times that are open to each aircraft")
    windows = request.windows_s
    arrivals = arrival_sets(travellers, airspace, request.latest_s, windows)
    if thorough_fleet and windows is None and not _common(request, arrivals, active):
        told("looking again, with free motions, for a time that is open to all")
        arrivals = arrival_sets(travellers, airspace, request.latest_s, deeply=True)
    if windows is not None and any(on and not own for on, own in zip(active, arrivals, strict=True)):
        return Outcome(None, tries, closest, unheld=unheld)
    for choices in levels:
        times = [t for t in _times(preferred, request, arrivals, active) if _possible(travellers, airspace, t)]
        if choices is not MANY:
            times = [times[k] for k in sorted({round(u * (len(times) - 1)) for u in _SOME})] if times else []
        for durations in times:
            told(f"trying arrival at {float(np.max(durations)):.1f} s")
            plan = attempt(durations, choices)
            if plan is not None:
                if request.rule == "earliest" and thorough_fleet:
                    plan = earlier(plan)
                return Outcome(plan, tries, arrivals=None if windows is not None else arrivals)
    return Outcome(None, tries, closest, None if windows is not None else arrivals, unheld)


def _possible(travellers: Traveller, airspace: Airspace, durations: Times) -> bool:
    """Whether nothing rules durations (s) out from the beginning."""
    who, durations = np.flatnonzero(np.asarray(travellers.active) > 0.0), np.asarray(durations, dtype=float)
    alone = bool(np.all(conceivable(travellers, airspace, who, durations[who])))
    return alone and not crowded(travellers, airspace, durations[None]).any()


def possible_times(
    travellers: Traveller, airspace: Airspace, request: ArrivalRequest
) -> tuple[Float[np.ndarray, "n aircraft"], Bool[np.ndarray, " n"]]:
    """Arrival times of a fleet that its rule leaves open, every quarter of a second, and which nothing rules out.

    For the rules that one time decides: "together", "earliest", "sequence"; of "at" and "times", those asked for.
    """
    if request.times_s is not None:
        times = request.times_s[None]
    else:
        offsets = _offsets(request, np.asarray(travellers.active).size)
        times = np.arange(_STEP_S, request.latest_s - float(np.max(offsets)), _STEP_S)[:, None] + offsets
    who = np.flatnonzero(np.asarray(travellers.active) > 0.0)
    everyone = np.tile(who, times.shape[0])
    alone = conceivable(travellers, airspace, everyone, times[:, who].ravel()).reshape(-1, who.size)
    return times, np.all(alone, axis=1) & ~crowded(travellers, airspace, times).any(axis=(1, 2))


def _preferred(travellers: Traveller, airspace: Airspace, request: ArrivalRequest) -> Times:
    """Time of each by the direct path at its preferred speed, s."""
    ticks = 64
    times, found = direct_times(travellers, airspace, travellers.speed, ticks)
    line = travellers.goal_position_n + travellers.rendezvous.stand_off_n - travellers.position_n
    straight = np.linalg.norm(np.asarray(line), axis=1) / np.asarray(travellers.speed)
    level = np.where(np.asarray(found), np.asarray(times), 1.2 * straight)
    return np.clip(np.maximum(level, _time_to_height(travellers, airspace, level)), 1.0, request.latest_s)


def _time_to_height(travellers: Traveller, airspace: Airspace, times: Times) -> Times:
    """Least time for the change of altitude, within climb rate and acceleration along the path at steady speed, s."""
    limits, gravity = travellers.limits, float(airspace.gravity)
    down = np.asarray(travellers.goal_position_n + travellers.rendezvous.stand_off_n - travellers.position_n)[:, 2]
    fall = down + times * np.asarray(travellers.goal_velocity_n)[:, 2]
    force = np.where(fall > 0.0, np.asarray(limits.deceleration_max), np.asarray(limits.acceleration_max))
    rate = np.minimum(np.asarray(limits.climb_rate_max), force * np.asarray(travellers.speed) / gravity)
    rate = np.maximum(0.99 * rate, 0.1)
    return np.abs(fall) / rate + 1.5 * rate / CLIMB_ACCELERATION


def _offsets(request: ArrivalRequest, count: int) -> Times:
    return np.zeros(count) if request.offsets_s is None else request.offsets_s


def _first_times(preferred: Times, request: ArrivalRequest) -> Times | None:
    """The times that the rule asks for first; None where they must be looked for."""
    if request.rule in ("at", "times"):
        assert request.times_s is not None
        return request.times_s
    if request.rule == "windows":
        assert request.windows_s is not None
        return np.clip(preferred, request.windows_s[:, 0], request.windows_s[:, 1])
    if request.rule == "earliest":
        return None
    offsets = _offsets(request, preferred.size)
    times = _A_HAIR * float(np.max(preferred - offsets)) + offsets
    return times if np.max(times) <= request.latest_s else None


def _later_times(
    first: Times | None, request: ArrivalRequest, levels: Sequence[Choices]
) -> Iterator[tuple[Times, Choices]]:
    """A little later than the times asked for first, and later still, where the rule leaves that open.

    Before it becomes much later, every kind of candidate is tried: better a loop than to be there at twice the time.
    """
    if first is None or request.rule == "windows":
        return
    offsets = _offsets(request, first.size)
    tried = [(factor, MANY) for factor in _LATER[1:] if factor <= _MUCH_LATER]
    tried += [(factor, choices) for choices in levels[1:2] for factor in _THOROUGHLY]
    tried += [(factor, MANY) for factor in _LATER if factor > _MUCH_LATER]
    for factor, choices in tried:
        times = factor * (first - offsets) + offsets
        if np.max(times) <= request.latest_s:
            yield times, choices


def _times(
    preferred: Times, request: ArrivalRequest, arrivals: Sequence[Intervals], active: np.ndarray
) -> Iterator[Times]:
    """Arrival times to try, the preferred ones first; only such as are open to every aircraft by itself."""
    count = preferred.size
    if request.rule == "windows":
        yield from _window_times(preferred, request, arrivals)
        return
    offsets = _offsets(request, count)
    last = request.latest_s - float(np.max(offsets))
    base = float(np.max(preferred - offsets))
    common = _common(request, arrivals, active)
    if request.rule == "earliest":
        wanted = [t for a, b in common for t in _spread(a, min(b, last))]
    else:
        wanted = [min(max(base * f, a), b) for f in _LATER for a, b in common if a <= base * f <= b]
        wanted += [t for a, b in common if b >= base for t in _spread(max(a, base), min(b, last))]
    for time in sorted({round(t, 9) for t in wanted if 0.0 < t <= last}):
        yield time + offsets


def _common(request: ArrivalRequest, arrivals: Sequence[Intervals], active: np.ndarray) -> Intervals:
    """Times of the first arrival that are open to all, none later than may be, s."""
    offsets = _offsets(request, len(arrivals))
    own = [sets if on else [(0.0, np.inf)] for sets, on in zip(arrivals, active, strict=True)]
    return [(a, b) for a, b in common_times(own, offsets) if a <= request.latest_s - float(np.max(offsets))]


def _spread(low: float, high: float) -> list[float]:
    """Times of an interval, the early ones densely."""
    if not high > low:
        return [low]
    top = min(high, 2.5 * low + 10.0)
    return [low + (top - low) * u for u in (0.0, 0.002, 0.01, 0.03, 0.07, 0.14, 0.25, 0.4, 0.6, 0.8, 1.0)]


def _window_times(preferred: Times, request: ArrivalRequest, arrivals: Sequence[Intervals]) -> Iterator[Times]:
    """One time within each window that is open to its aircraft; then all shifted within their windows."""
    assert request.windows_s is not None
    allowed = []
    for (low, high), sets, wish in zip(request.windows_s, arrivals, preferred, strict=True):
        inside = [(max(a, low), min(b, high)) for a, b in sets if max(a, low) <= min(b, high)]
        if not inside:
            inside = [(low, high)]
        grid = sorted({float(a + (b - a) * u) for a, b in inside for u in _WINDOW_STEPS}, key=lambda t: abs(t - wish))
        allowed.append(grid)
    for shift in range(max(len(grid) for grid in allowed)):
        yield np.array([grid[min(shift, len(grid) - 1)] for grid in allowed])
    # Each at another of its times: conflicts between two that both moved alike.
    for shift in range(1, 8):
        yield np.array([grid[(k * shift) % len(grid)] for k, grid in enumerate(allowed)])


def _intersect(sets: Sequence[Intervals]) -> Intervals:
    common: Intervals = [(0.0, float("inf"))]
    for own in sets:
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in own if max(a, c) <= min(b, d)]
    return common


def common_times(arrivals: Sequence[Intervals], offsets_s: Times) -> Intervals:
    """Times of the first arrival that are open to all, s."""
    return _intersect([[(a - o, b - o) for a, b in own] for own, o in zip(arrivals, offsets_s, strict=True)])


def stacked(travellers: Sequence[Traveller]) -> Traveller:
    """A fleet of single travellers."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *travellers)
