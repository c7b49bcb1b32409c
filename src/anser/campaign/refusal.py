"""Why no plan exists: which constraint binds, by how much, and the nearest request that works."""

from collections.abc import Sequence

import numpy as np

from anser.planning.certified import (
    RELAXED,
    Airspace,
    ArrivalRequest,
    Outcome,
    Traveller,
    apart_at_arrival,
    arrival_sets,
    common_times,
    crowded,
    possible_times,
    relaxed,
    search,
)
from anser.planning.certified.arrivals import reachable
from anser.planning.limits import LOOSENED_TOGETHER
from anser.scenario import Scenario
from anser.simulation import PlannedHolds

Intervals = list[tuple[float, float]]
_FACTORS = 2.0 ** np.linspace(0.0, 2.0, 9)  # by which a limit is loosened, from as asked to four times
_MOST_SHOWN = 3
_STEPS = 5
_EDGE_S = 0.5
_CROWDED_MOST = 20  # aircraft up to which all pairs are looked at for all arrival times


def explain(
    scenario: Scenario, travellers: Traveller, airspace: Airspace, request: ArrivalRequest, outcome: Outcome
) -> tuple[str, ...]:
    """Sentences that say what stands in the way of a plan.

    Parameters
    ----------
    scenario
        Names the aircraft.
    travellers, airspace, request
        The task.
    outcome
        Of the search that found no plan.
    """
    names = [one.name for one in scenario.aircraft]
    beside = _crowded(names, travellers, airspace, request)
    if beside:
        return tuple(beside)
    arrivals = outcome.arrivals
    if arrivals is None:
        arrivals = arrival_sets(travellers, airspace, request.latest_s)
    alone = _alone(names, travellers, airspace, request, arrivals, outcome)
    if alone:
        return tuple(alone)
    if request.rule in ("together", "earliest", "sequence"):
        offsets = np.zeros(len(names)) if request.offsets_s is None else request.offsets_s
        if not [1 for a, _ in common_times(arrivals, offsets) if a <= request.latest_s - float(np.max(offsets))]:
            return (_no_common_time(names, arrivals, offsets, request.latest_s),)
    return (_conflict(names, travellers, airspace, request, outcome),)


def explain_unheld(scenario: Scenario, travellers: Traveller, holds: PlannedHolds) -> tuple[str, ...]:
    """Say why a fleet that could arrive has no plan: who cannot hold afterwards.

    Parameters
    ----------
    scenario
        Names the aircraft.
    travellers
        The task.
    holds
        The best that were found.
    """
    names = [one.name for one in scenario.aircraft]
    found, room = [], np.asarray(holds.room)
    for k in np.flatnonzero(~np.asarray(holds.clear) & (np.asarray(travellers.active) > 0.0)):
        other = int(np.argmin(room[k]))
        if room[k, other] >= 1.0:
            found.append(
                f'aircraft "{names[k]}" can arrive, but no hold afterwards keeps it within the limits of altitude, '
                "off its goal and out of the keep-outs"
            )
        elif k < other or room[other, k] >= 1.0:
            found.append(
                f'"{names[k]}" and "{names[other]}" can arrive, but no holds afterwards keep them apart until the '
                f"flight ends: {room[k, other]:.2f} of the separation at best; other courses of arrival, rendezvous "
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


def _crowded(names: Sequence[str], travellers: Traveller, airspace: Airspace, request: ArrivalRequest) -> list[str]:
    """Pairs whose rendezvous points are closer than the separation whenever they may arrive."""
    if request.windows_s is not None or len(names) > _CROWDED_MOST:
        return []
    times, _ = possible_times(travellers, airspace, request)
    if times.shape[0] == 0:
        return []
    always = np.all(crowded(travellers, airspace, times), axis=0)
    level, height = apart_at_arrival(travellers, airspace, times)
    words = f"at {times[0, 0]:.1f} s" if request.rule == "at" else "when the first of them arrives"
    least = float(airspace.separation.horizontal), float(airspace.separation.vertical)
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


def _alone(
    names: Sequence[str],
    travellers: Traveller,
    airspace: Airspace,
    request: ArrivalRequest,
    arrivals: Sequence[Intervals],
    outcome: Outcome,
) -> list[str]:
    """Aircraft that by themselves cannot do what is asked."""
    found = []
    closest = outcome.closest
    # The search looks further than the arrival sets do: what it found for one aircraft is not denied.
    flown = (
        np.zeros(len(names), dtype=bool)
        if closest is None
        else np.asarray(closest.valid & closest.certificate.kept_alone)
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
        binding = _binding(k, travellers, airspace, wanted)
        nearest = f"; by itself it can {spoken(own)}" if own else ""
        found.append(f'aircraft "{name}" {asked}{binding}{nearest}')
    return found


def _binding(who: int, travellers: Traveller, airspace: Airspace, wanted_s: float) -> str:
    """The limit whose loosening alone lets an aircraft arrive at a time, and by how much."""
    best: tuple[float, str] | None = None
    for what in RELAXED:
        if what == "keep-outs" and airspace.keep_outs.radius.shape[0] == 0:
            continue
        low, high = 0, len(_FACTORS) - 1

        def works(step: int, what: str = what) -> bool:
            looser = relaxed(travellers, airspace, what, float(_FACTORS[step]))
            return bool(reachable(*looser, np.array([who]), np.array([wanted_s]))[0])

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


def _conflict(
    names: Sequence[str], travellers: Traveller, airspace: Airspace, request: ArrivalRequest, outcome: Outcome
) -> str:
    """The largest separation with which a plan exists."""
    asked = airspace.separation
    horizontal, vertical = float(asked.horizontal), float(asked.vertical)
    if horizontal == 0.0:
        return f"no plan was found in {outcome.tries} tries, though each aircraft by itself has one"
    pair = ""
    if outcome.closest is not None:
        room = np.asarray(outcome.closest.certificate.room)
        one, other = (int(k) for k in np.unravel_index(int(np.argmin(room)), room.shape))
        pair = f' ("{names[one]}" and "{names[other]}" are the closest)'
    low, high = 0.0, 1.0
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        looser = relaxed(travellers, airspace, "separation", 1.0 / max(middle, 1e-6))
        works = search(0.0, *looser, request, thorough=False).plan is not None
        low, high = (middle, high) if works else (low, middle)
    if low == 0.0:
        return f"the aircraft do not keep apart{pair}: not even a small part of the separation asked was reached"
    reached, wanted = (_distances(part * horizontal, part * vertical, vertical > 0.0) for part in (low, 1.0))
    return f"separation {reached} reachable, {wanted} asked{pair}, the reserve included"
