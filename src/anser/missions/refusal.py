"""Why no plan exists: which constraint binds, by how much, and the nearest request that works."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np

from anser.planning.certified.arrival_times import arrival_conflicts, arrival_distances_max, arrival_sets, reachable
from anser.planning.certified.search import FleetTask, SearchOutcome, common_times, search
from anser.planning.certified.task import Intervals
from anser.planning.holds.hold_paths import PlannedHolds
from anser.planning.limits import RELAXED_TOGETHER
from anser.planning.separation import Separation
from anser.scenario.schema import Scenario

_FACTORS = 2.0 ** np.linspace(0.0, 2.0, 9)  # by which a limit is loosened, from as asked to four times
_MESSAGES_MAX = 3
_STEPS = 5
_EDGE_S = 0.5
_ALL_PAIRS_MAX = 20  # aircraft up to which all pairs are looked at for all arrival times


def diagnose_refusal(scenario: Scenario, fleet: FleetTask, outcome: SearchOutcome) -> tuple[str, ...]:
    """Sentences that say what stands in the way of a plan of a scenario's fleet, after a search that found none."""
    names, request = [one.name for one in scenario.aircraft], fleet.request
    too_close = _conflicting_rendezvous(names, fleet)
    if too_close:
        return tuple(too_close)
    arrivals = outcome.arrivals
    if arrivals is None:
        arrivals = arrival_sets(fleet.tasks, fleet.airspace, request.latest_s)
    alone = _infeasible_aircraft(names, fleet, arrivals, outcome)
    if alone:
        return tuple(alone)
    if request.rule in ("together", "earliest", "sequence"):
        offsets = request.offsets(len(names))
        if not [1 for a, _ in common_times(arrivals, offsets) if a <= request.latest_s - float(np.max(offsets))]:
            return (_no_common_time(names, arrivals, offsets, request.latest_s),)
    return (_largest_feasible_separation(names, fleet, outcome),)


def diagnose_missing_holds(scenario: Scenario, fleet: FleetTask, holds: PlannedHolds) -> tuple[str, ...]:
    """Sentences that say who could arrive, but cannot hold afterwards, given the best holds that were found."""
    names = [one.name for one in scenario.aircraft]
    known = slice(len(names))  # not those that fill the fleet up
    found, ratios = [], np.asarray(holds.clearance_ratio)[known, known]
    for k in np.flatnonzero(~np.asarray(holds.clear)[known] & fleet.active):
        other = int(np.argmin(ratios[k]))
        if ratios[k, other] >= 1.0:
            found.append(
                f'aircraft "{names[k]}" can arrive, but no hold afterwards keeps it within the limits of altitude, '
                "off its goal and out of the keep-outs"
            )
        elif k < other or ratios[other, k] >= 1.0:
            found.append(
                f'"{names[k]}" and "{names[other]}" can arrive, but no holds afterwards keep them apart until the '
                f"flight ends: {ratios[k, other]:.2f} of the separation at best; other courses of arrival, rendezvous "
                "points farther apart or arrivals one after another would help"
            )
    return tuple(found[:_MESSAGES_MAX])


def format_intervals(intervals: Sequence[tuple[float, float]]) -> str:
    """Arrival times in words."""
    if not intervals:
        return "at no time"
    parts = [
        f"from {a:.1f} s on" if np.isinf(b) else f"from {a:.1f} to {b:.1f} s" for a, b in intervals[:_MESSAGES_MAX]
    ]
    more = " and later" if len(intervals) > _MESSAGES_MAX else ""
    return " and ".join(parts) + more


def _conflicting_rendezvous(names: Sequence[str], fleet: FleetTask) -> list[str]:
    """Pairs whose rendezvous points are closer than the separation whenever they may arrive."""
    if fleet.request.windows_s is not None or len(names) > _ALL_PAIRS_MAX:
        return []
    times = fleet.requested_times()
    if times.shape[0] == 0:
        return []
    always = np.all(arrival_conflicts(fleet.tasks, fleet.airspace, times), axis=0)
    level, height = arrival_distances_max(fleet.tasks, fleet.airspace, times)
    words = f"at {times[0, 0]:.1f} s" if fleet.request.rule == "at" else "when the first of them arrives"
    asked = fleet.airspace.separation
    least = float(asked.horizontal), float(asked.vertical)
    found = []
    for i, j in zip(*np.nonzero(np.triu(always)), strict=True):
        most = int(np.argmax(level[:, i, j]))
        reached = level[most, i, j], height[most, i, j]
        found.append(
            f'the rendezvous points of "{names[i]}" and "{names[j]}" are too close to each other: {words} they leave '
            f"{_distances(*reached, least[1] > 0.0)} at most, {_distances(*least, least[1] > 0.0)} asked, the reserve "
            "included"
        )
    return found[:_MESSAGES_MAX]


def _distances(horizontal_m: float, vertical_m: float, both: bool) -> str:
    """A distance in the plane and, where one is asked, that in altitude, in words."""
    return f"{horizontal_m:.0f} m" + (f" / {vertical_m:.0f} m" if both else "")


def _infeasible_aircraft(
    names: Sequence[str], fleet: FleetTask, arrivals: Sequence[Intervals], outcome: SearchOutcome
) -> list[str]:
    """Aircraft that by themselves cannot do what is asked."""
    found, request, best = [], fleet.request, outcome.best_attempt
    # The search looks further than the arrival sets do: what it found for one aircraft is not denied.
    flown = (
        np.zeros(len(names), dtype=bool)
        if best is None
        else np.asarray(best.valid & best.certificate.satisfied_individually)
    )
    for k, name in enumerate(names):
        if flown[k]:
            continue
        own = arrivals[k]
        if not own:
            asked = f"cannot arrive within {request.latest_s:.0f} s"
            wanted = request.latest_s
        elif request.times_s is not None:
            wanted = float(request.times_s[k])
            if any(a - _EDGE_S <= wanted <= b + _EDGE_S for a, b in own):
                continue
            asked = f"cannot arrive at {wanted:.1f} s"
        elif request.windows_s is not None:
            low, high = request.windows_s[k]
            if any(a <= high and b >= low for a, b in own):
                continue
            asked, wanted = f"cannot arrive between {low:.1f} and {high:.1f} s", float(high)
        else:
            continue
        nearest = f"; by itself it can {format_intervals(own)}" if own else ""
        found.append(f'aircraft "{name}" {asked}{_binding_constraint(k, fleet, wanted)}{nearest}')
    return found


def _relax_constraint(fleet: FleetTask, what: str, factor: float) -> FleetTask:
    """The same fleet with one kind of limit, or the keep-outs, loosened by a factor (1 is as asked)."""
    limits = fleet.tasks.limits
    if what == "keep-outs":
        radius = fleet.airspace.keep_outs.radius / factor
        airspace = eqx.tree_at(lambda a: a.keep_outs.radius, fleet.airspace, radius)
        return FleetTask(fleet.tasks, airspace, fleet.request)
    for limit in RELAXED_TOGETHER[what]:
        wider = limit.relaxed(getattr(limits, limit.field), factor)
        limits = eqx.tree_at(lambda x, field=limit.field: getattr(x, field), limits, wider)
    return FleetTask(eqx.tree_at(lambda t: t.limits, fleet.tasks, limits), fleet.airspace, fleet.request)


def _binding_constraint(who: int, fleet: FleetTask, wanted_s: float) -> str:
    """The limit whose loosening alone lets an aircraft arrive at a time, and by how much."""
    best: tuple[float, str] | None = None
    for what in (*RELAXED_TOGETHER, "keep-outs"):
        if what == "keep-outs" and fleet.airspace.keep_outs.radius.shape[0] == 0:
            continue
        low, high = 0, len(_FACTORS) - 1

        def works(step: int, what: str = what) -> bool:
            looser = _relax_constraint(fleet, what, float(_FACTORS[step]))
            return bool(reachable(looser.tasks, looser.airspace, np.array([who]), np.array([wanted_s]))[0])

        if not works(high):
            continue
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if works(middle) else (middle, high)
        if best is None or _FACTORS[high] < best[0]:
            best = float(_FACTORS[high]), what
    if best is None:
        return ": no single limit, loosened up to four times, changes that"
    factor, what = best
    keys = " and ".join(f"limits.{limit.scenario_key}" for limit in RELAXED_TOGETHER.get(what, ()))
    named = f"{what} ({keys})" if keys else what
    return f": the {named} stands in the way, and loosened by {100 * (factor - 1):.0f} % it would do"


def _no_common_time(names: Sequence[str], arrivals: Sequence[Intervals], offsets_s: np.ndarray, latest_s: float) -> str:
    starts = [own[0][0] - o for own, o in zip(arrivals, offsets_s, strict=True)]
    ends = [own[-1][1] - o for own, o in zip(arrivals, offsets_s, strict=True)]
    last, first = int(np.argmax(starts)), int(np.argmin(ends))
    return (
        f'no arrival time up to {latest_s:.0f} s is open to all: "{names[last]}" can arrive '
        f'{format_intervals(arrivals[last])}, "{names[first]}" {format_intervals(arrivals[first])}'
    )


def _largest_feasible_separation(names: Sequence[str], fleet: FleetTask, outcome: SearchOutcome) -> str:
    """The largest separation with which a plan exists."""
    asked = fleet.airspace.separation
    horizontal, vertical = float(asked.horizontal), float(asked.vertical)
    if horizontal == 0.0:
        return f"no plan was found in {outcome.attempts} tries, though each aircraft by itself has one"
    pair = ""
    if outcome.best_attempt is not None:
        ratios = np.asarray(outcome.best_attempt.certificate.clearance_ratio)
        one, other = (int(k) for k in np.unravel_index(int(np.argmin(ratios)), ratios.shape))
        pair = f' ("{names[one]}" and "{names[other]}" are the closest)'
    low, high = 0.0, 1.0
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        factor = 1.0 / max(middle, 1e-6)
        smaller = Separation(asked.horizontal / factor, asked.vertical / factor)
        airspace = eqx.tree_at(lambda a: a.separation, fleet.airspace, smaller)
        works = search(0.0, fleet.tasks, airspace, fleet.request, thorough=False).plan is not None
        low, high = (middle, high) if works else (low, middle)
    if low == 0.0:
        return f"the aircraft do not keep apart{pair}: not even a small part of the separation asked was reached"
    reached, wanted = (_distances(part * horizontal, part * vertical, vertical > 0.0) for part in (low, 1.0))
    return f"separation {reached} reachable, {wanted} asked{pair}, the reserve included"
