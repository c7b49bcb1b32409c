"""Putting single flights together: distances between them, those least in conflict, joint solutions."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from trials.collocation import Encounter, Obstacle, solve_flights
from trials.data import PlanCase
from trials.flight import Flight, Quartics

__all__ = ["Apart", "Member", "choose_members", "part_members", "solve_alone", "tracks_of"]

_STAMP = 0.5
"""Time between the instants at which distances are kept, s; closer ones are added where a check asks for them."""
_CLOSING = 300.0
"""Relative speed for which distances between those instants are kept, m/s: their margin is the sagitta of its way."""
_SAGITTA_MOST = 0.05
"""Of the radius."""
_ROOM_M = 0.5
"""Margin of every distance."""
_NEAR_M, _NEAR_UP_M = 1500.0, 300.0
"""Distances are kept at instants at which they are this close at the start of a solution, and where one broke them."""
_REPEATS = 4
"""Solutions in which instants are added that the one before broke."""
_ALONE, _JOINT = 80, 120
"""Iterations of the solver, at most."""


@dataclass(frozen=True)
class Member:
    """A flight and unknowns that meet its constraints alone."""

    flight: Flight
    x: Float[np.ndarray, " unknown"]

    @property
    def path(self) -> Quartics:
        """Over the ground."""
        return self.flight.path(self.x)


@dataclass
class Apart:
    """What distances need beyond the usual, as dense checks found: by aircraft and keep-out, or by pair of aircraft."""

    keep_out: dict[tuple[int, ...], float] = field(default_factory=dict)
    """More margin, m."""
    separation: dict[tuple[int, ...], float] = field(default_factory=dict)
    """More margin, m."""
    times: dict[tuple[str, tuple[int, ...]], list[float]] = field(default_factory=dict)
    """Instants looked at besides, s."""


def tracks_of(
    flight: Flight, others: Sequence[Member], apart: Apart
) -> list[tuple[Float[np.ndarray, "3 node"], float, float]]:
    """Cylinders that a flight should avoid, at its nodes: keep-outs, and the separation from others."""
    case, width = flight.case, flight.width
    times = case.starts.time + width * np.arange(flight.intervals + 1)
    found = [(_keep_out(case, k, times), *_size(case, flight.who, k, apart)) for k in range(case.keep_outs.radius.size)]
    tracks = [(centre, radius, min(half, 1e6)) for centre, radius, half in found]
    for other in others:
        if case.separation_horizontal <= 0.0 or other.flight.who == flight.who:
            continue
        centre = other.path.at(times)
        centre[2, times > other.flight.arrival] = 1e7
        tracks.append((centre, 1.1 * case.separation_horizontal, case.separation_vertical))
    return tracks


def solve_alone(
    flight: Flight, start: Float[np.ndarray, " unknown"], others: Sequence[Member], apart: Apart
) -> tuple[Member | None, int]:
    """Look for a flight that meets its own constraints and stays apart from others: the flight, and the iterations."""
    members, spent = _solve([Member(flight, start)], others, apart, _ALONE)
    return (members[0] if members else None), spent


def part_members(members: Sequence[Member], apart: Apart) -> tuple[list[Member] | None, int]:
    """Part a fleet: solve those in conflict together, the others fixed, until none is; iterations of all beside it."""
    now, spent = list(members), 0
    joined: list[set[int]] = []
    for _ in range(len(now) + 1):
        pairs = [{i, j} for i in range(len(now)) for j in range(i) if _conflict(now[i], now[j], apart) > 0.0]
        if not pairs:
            return now, spent
        joined = _components([*joined, *pairs])
        for group in joined:
            if not any(pair <= group for pair in pairs):
                continue
            mine = sorted(group)
            rest = [one for k, one in enumerate(now) if k not in group]
            # Those outside are obstacles; without them if need be: who is in conflict then is joined in the next pass.
            found, made = _solve([now[k] for k in mine], rest, apart, _JOINT)
            spent += made
            if found is None and rest:
                found, made = _solve([now[k] for k in mine], [], apart, _JOINT)
                spent += made
            if found is None:
                return None, spent
            for k, one in zip(mine, found, strict=True):
                now[k] = one
    return None, spent


def choose_members(pools: Sequence[Sequence[Member]], first: Sequence[int], apart: Apart) -> list[Member]:
    """One member per pool, by exchanges that lessen their conflicts, from the first ones on."""
    chosen = list(first)
    known: dict[tuple[int, int, int, int], float] = {}

    def conflict(i: int, a: int, j: int, b: int) -> float:
        key = (i, a, j, b) if i < j else (j, b, i, a)
        if key not in known:
            known[key] = _conflict(pools[i][a], pools[j][b], apart)
        return known[key]

    for _ in range(4):
        before = list(chosen)
        for i, pool in enumerate(pools):
            cost = [sum(conflict(i, a, j, chosen[j]) for j in range(len(pools)) if j != i) for a in range(len(pool))]
            if cost[chosen[i]] > min(cost):
                chosen[i] = int(np.argmin(cost))
        if chosen == before:
            break
    return [pool[k] for pool, k in zip(pools, chosen, strict=True)]


def _components(groups: list[set[int]]) -> list[set[int]]:
    """Groups, those that overlap made one."""
    joined: list[set[int]] = []
    for group in groups:
        touching = [one for one in joined if one & group]
        joined = [one for one in joined if not one & group] + [set(group).union(*touching)]
    return joined


def _solve(
    members: Sequence[Member], fixed: Sequence[Member], apart: Apart, iterations: int
) -> tuple[list[Member] | None, int]:
    """Solve flights together, with more instants where the solution broke a distance in between."""
    now, spent = list(members), 0
    case = now[0].flight.case
    seen: dict[tuple[str, int, int], np.ndarray] = {}
    for _ in range(_REPEATS):
        paths = [one.path for one in now]
        obstacles: list[list[Obstacle]] = [[] for _ in now]
        encounters: list[Encounter] = []
        broken = False
        for k, one in enumerate(now):
            who, arrival = one.flight.who, one.flight.arrival
            for which in range(case.keep_outs.radius.size):
                times = _stamps(case, arrival, apart.times.get(("keep_out", (who, which)), []))
                radius, half = _size(case, who, which, apart)
                centre = _keep_out(case, which, times)
                close, bad = _look(seen, ("keep_out", k, which), paths[k].at(times) - centre, radius, half)
                broken |= bad
                if close.any():
                    obstacles[k].append(Obstacle(times[close], centre[:, close], radius, half))
            for j, other in enumerate([*now[:k], *fixed]):
                both = tuple(sorted((who, other.flight.who)))
                radius, half = _separation(case, both, apart)
                if radius <= 0.0:
                    continue
                times = _stamps(case, min(arrival, other.flight.arrival), apart.times.get(("separation", both), []))
                there = other.path.at(times)
                close, bad = _look(seen, ("separation", k, j), paths[k].at(times) - there, radius, half)
                broken |= bad
                if close.any() and j < k:
                    encounters.append(Encounter(k, j, times[close], radius, half))
                elif close.any():
                    obstacles[k].append(Obstacle(times[close], there[:, close], radius, half))
        if spent and not broken:
            return now, spent
        flights = [one.flight for one in now]
        solution = solve_flights(flights, [one.x for one in now], obstacles, encounters, iterations)
        spent += max(1, solution.iterations) * len(now)
        if not solution.feasible:
            return None, spent
        now = [Member(flight, x) for flight, x in zip(flights, solution.unknowns, strict=True)]
    return None, spent


def _look(
    seen: dict[tuple[str, int, int], np.ndarray],
    key: tuple[str, int, int],
    between: Float[np.ndarray, "3 time"],
    radius: float,
    half: float,
) -> tuple[np.ndarray, bool]:
    """At which instants a distance is to be kept, and whether it is broken at one that was not among them before."""
    flat, up = np.hypot(between[0], between[1]), np.abs(between[2])
    close = (flat < radius + _NEAR_M) & (up < half + _NEAR_UP_M)
    if key not in seen:
        seen[key] = close
        return close, False
    # Where it was kept before, what is left is the solver's own accuracy.
    broken = bool(np.any((flat < radius) & (up < half) & ~seen[key]))
    if broken:
        seen[key] = seen[key] | close
    return seen[key], broken


def _stamps(case: PlanCase, until: float, more: list[float]) -> Float[np.ndarray, " time"]:
    start = case.starts.time
    return np.unique(
        np.concatenate([np.arange(start + _STAMP, until, _STAMP), [until], [t for t in more if t <= until]])
    )


def _keep_out(case: PlanCase, which: int, times: Float[np.ndarray, " time"]) -> Float[np.ndarray, "3 time"]:
    """Centre of a keep-out at times, NED, m."""
    zones = case.keep_outs
    flat = zones.position_n[which][:, None] + zones.velocity_n[which][:, None] * times
    return np.concatenate([flat, np.full((1, times.size), -0.5 * (zones.bottom[which] + zones.top[which]))])


def _size(case: PlanCase, who: int, which: int, apart: Apart) -> tuple[float, float]:
    """Radius and half height of a keep-out with margins, m; the latter infinite where there is no way over or under."""
    zones, L = case.keep_outs, case.limits
    more = apart.keep_out.get((who, which), 0.0)
    radius, half = float(zones.radius[which]), 0.5 * float(zones.top[which] - zones.bottom[which])
    way = zones.bottom[which] > L.altitude_min[who] or zones.top[which] < L.altitude_max[who]
    return radius + _margin(radius) + more, half + _ROOM_M + more if way else float("inf")


def _separation(case: PlanCase, both: tuple[int, ...], apart: Apart) -> tuple[float, float]:
    """Distances of a pair with margins, m; 0 where none is asked."""
    flat, up, more = case.separation_horizontal, case.separation_vertical, apart.separation.get(both, 0.0)
    if flat <= 0.0 or up <= 0.0:
        return 0.0, 0.0
    return flat + _margin(flat) + more, up + _ROOM_M + more


def _margin(radius: float) -> float:
    return _ROOM_M + min((_CLOSING * _STAMP) ** 2 / (8.0 * radius), _SAGITTA_MOST * radius)


def _conflict(one: Member, other: Member, apart: Apart) -> float:
    """Sum over time of how deep two flights are within their separation, as a share of it."""
    case = one.flight.case
    both = tuple(sorted((one.flight.who, other.flight.who)))
    radius, half = _separation(case, both, apart)
    if radius <= 0.0:
        return 0.0
    more = apart.times.get(("separation", both), [])
    times = _stamps(case, min(one.flight.arrival, other.flight.arrival), more)
    between = one.path.at(times) - other.path.at(times)
    # A millimetre, within the margins, is the solver's own accuracy.
    deep = np.minimum(
        1.0 - np.hypot(between[0], between[1]) / (radius - 1e-3), 1.0 - np.abs(between[2]) / (half - 1e-3)
    )
    return float(np.sum(np.maximum(deep, 0.0)))
