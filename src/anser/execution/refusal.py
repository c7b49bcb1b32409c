"""Why no plan exists: which constraint binds, by how much, and the nearest request that works."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np

from anser.planning.certified import (
    FleetTask,
    Outcome,
    Separation,
    arrival_conflicts,
    arrival_distances_max,
    arrival_sets,
    common_times,
    search,
)
from anser.planning.certified.arrivals import reachable
from anser.planning.certified.task import Intervals
from anser.planning.limits import LOOSENED_TOGETHER
from anser.scenario import Scenario
from anser.simulation import PlannedHolds

_FACTORS = 2.0 ** np.linspace(0.0, 2.0, 9)  # by which a limit is loosened, from as asked to four times
_MOST_SHOWN = 3
_STEPS = 5
_EDGE_S = 0.5
_ALL_PAIRS_MOST = 20  # aircraft up to which all pairs are looked at for all arrival times


def explain(scenario: Scenario, fleet: FleetTask, outcome: Outcome) -> tuple[str, ...]:
    """Sentences that say what stands in the way of a plan of a scenario's fleet, after a search that found none."""
    names, request = [one.name for one in scenario.aircraft], fleet.request
    too_close = _too_close(names, fleet)
    if too_close:
        return tuple(too_close)
    arrivals = outcome.arrivals
    if arrivals is None:
        arrivals = arrival_sets(fleet.tasks, fleet.airspace, request.latest_s)
    alone = _alone(names, fleet, arrivals, outcome)
    if alone:
        return tuple(alone)
    if request.rule in ("together", "earliest", "sequence"):
        offsets = request.offsets(len(names))
        if not [1 for a, _ in common_times(arrivals, offsets) if a <= request.latest_s - float(np.max(offsets))]:
            return (_no_common_time(names, arrivals, offsets, request.latest_s),)
    return (_conflict(names, fleet, outcome),)


def explain_missing_holds(scenario: Scenario, fleet: FleetTask, holds: PlannedHolds) -> tuple[str, ...]:
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
    return tuple(found[:_MOST_SHOWN])


def spoken(intervals: Sequence[tuple[float, float]]) -> str:
    """Arrival times in words."""
    if not intervals:
        return "at no time"
    parts = [f"from {a:.1f} s on" if np.isinf(b) else f"from {a:.1f} to {b:.1f} s" for a, b in intervals[:_MOST_SHOWN]]
    more = " and later" if len(intervals) > _MOST_SHOWN else ""
    return " and ".join(parts) + more


def _too_close(names: Sequence[str], fleet: FleetTask) -> list[str]:
    """Pairs whose rendezvous points are closer than the separation whenever they may arrive."""
    if fleet.request.windows_s is not None or len(names) > _ALL_PAIRS_MOST:
        return []
    times = fleet.times_asked()
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
    return found[:_MOST_SHOWN]


def _distances(horizontal_m: float, vertical_m: float, both: bool) -> str:
    """A distance in the plane and, where one is asked, that in altitude, in words."""
    return f"{horizontal_m:.0f} m" + (f" / {vertical_m:.0f} m" if both else "")


def _alone(names: Sequence[str], fleet: FleetTask, arrivals: Sequence[Intervals], outcome: Outcome) -> list[str]:
    """Aircraft that by themselves cannot do what is asked."""
    found, request, best = [], fleet.request, outcome.best_attempt
    # The search looks further than the arrival sets do: what it found for one aircraft is not denied.
    flown = np.zeros(len(names), dtype=bool) if best is None else np.asarray(best.valid & best.certificate.kept_alone)
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
        nearest = f"; by itself it can {spoken(own)}" if own else ""
        found.append(f'aircraft "{name}" {asked}{_binding(k, fleet, wanted)}{nearest}')
    return found


def _loosened(fleet: FleetTask, what: str, factor: float) -> FleetTask:
    """The same fleet with one kind of limit, or the keep-outs, loosened by a factor (1 is as asked)."""
    limits = fleet.tasks.limits
    if what == "keep-outs":
        radius = fleet.airspace.keep_outs.radius / factor
        airspace = eqx.tree_at(lambda a: a.keep_outs.radius, fleet.airspace, radius)
        return FleetTask(fleet.tasks, airspace, fleet.request)
    for limit in LOOSENED_TOGETHER[what]:
        wider = limit.loosened(getattr(limits, limit.field), factor)
        limits = eqx.tree_at(lambda x, field=limit.field: getattr(x, field), limits, wider)
    return FleetTask(eqx.tree_at(lambda t: t.limits, fleet.tasks, limits), fleet.airspace, fleet.request)


def _binding(who: int, fleet: FleetTask, wanted_s: float) -> str:
    """The limit whose loosening alone lets an aircraft arrive at a time, and by how much."""
    best: tuple[float, str] | None = None
    for what in (*LOOSENED_TOGETHER, "keep-outs"):
        if what == "keep-outs" and fleet.airspace.keep_outs.radius.shape[0] == 0:
            continue
        low, high = 0, len(_FACTORS) - 1

        def works(step: int, what: str = what) -> bool:
            looser = _loosened(fleet, what, float(_FACTORS[step]))
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
    keys = " and ".join(f"limits.{limit.setting}" for limit in LOOSENED_TOGETHER.get(what, ()))
    named = f"{what} ({keys})" if keys else what
    return f": the {named} stands in the way, and loosened by {100 * (factor - 1):.0f} % it would do"


def _no_common_time(names: Sequence[str], arrivals: Sequence[Intervals], offsets_s: np.ndarray, latest_s: float) -> str:
    starts = [own[0][0] - o for own, o in zip(arrivals, offsets_s, strict=True)]
    ends = [own[-1][1] - o for own, o in zip(arrivals, offsets_s, strict=True)]
    last, first = int(np.argmax(starts)), int(np.argmin(ends))
    return (
        f'no arrival time up to {latest_s:.0f} s is open to all: "{names[last]}" can arrive '
        f'{spoken(arrivals[last])}, "{names[first]}" {spoken(arrivals[first])}'
    )


def _conflict(names: Sequence[str], fleet: FleetTask, outcome: Outcome) -> str:
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
