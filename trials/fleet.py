"""Assembly of single flights into a fleet: distances, choice of the least conflicting flights, joint solutions."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from trials.collocation import Encounter, Obstacle, solve_flights
from trials.data import PlanCase
from trials.flight import Flight, Quartics

__all__ = ["DistanceMargins", "Member", "avoidance_cylinders", "choose_members", "part_members", "solve_alone"]

_STAMP = 0.5
"""Spacing of the times at which distances are constrained, s; further times are added after dense checks."""
_CLOSING = 300.0
"""Relative speed for which distances hold between those times, m/s: the margin is the sagitta of the path."""
_SAGITTA_MOST = 0.05
"""Greatest sagitta, as a fraction of the radius."""
_ROOM_M = 0.5
"""Margin of every distance, m."""
_NEAR_M, _NEAR_UP_M = 1500.0, 300.0
"""Distances are kept at instants at which they are this close at the start of a solution, and where one broke them."""
_REPEATS = 4
"""Greatest number of solutions, each with additional times at violated distances."""
_ALONE, _JOINT = 80, 120
"""Iterations of the solver, at most."""


@dataclass(frozen=True)
class Member:
    """A flight with unknowns that satisfy its own constraints."""

    flight: Flight
    x: Float[np.ndarray, " unknown"]

    @property
    def path(self) -> Quartics:
        """Path over the ground."""
        return self.flight.path(self.x)


@dataclass
class DistanceMargins:
    """Additional margins from dense checks, by (aircraft, keep-out) or by pair of aircraft."""

    keep_out: dict[tuple[int, ...], float] = field(default_factory=dict)
    """Additional margin, m."""
    separation: dict[tuple[int, ...], float] = field(default_factory=dict)
    """Additional margin, m."""
    times: dict[tuple[str, tuple[int, ...]], list[float]] = field(default_factory=dict)
    """Additional constrained times, s."""


def avoidance_cylinders(
    flight: Flight, neighbours: Sequence[Member], margins: DistanceMargins
) -> list[tuple[Float[np.ndarray, "3 node"], float, float]]:
    """Cylinders to avoid, at the nodes of a flight: keep-outs, and the separation from other flights."""
    case, width = flight.case, flight.width
    times = case.starts.time + width * np.arange(flight.intervals + 1)
    cylinders = [
        (_keep_out(case, k, times), *_size(case, flight.aircraft, k, margins))
        for k in range(case.keep_outs.radius.size)
    ]
    tracks = [(centre, radius, min(half, 1e6)) for centre, radius, half in cylinders]
    for neighbour in neighbours:
        if case.separation_horizontal <= 0.0 or neighbour.flight.aircraft == flight.aircraft:
            continue
        centre = neighbour.path.at(times)
        centre[2, times > neighbour.flight.arrival] = 1e7
        tracks.append((centre, 1.1 * case.separation_horizontal, case.separation_vertical))
    return tracks


def solve_alone(
    flight: Flight, start: Float[np.ndarray, " unknown"], neighbours: Sequence[Member], margins: DistanceMargins
) -> tuple[Member | None, int]:
    """Search for a flight with its own constraints and the separation from others; return it and the iterations."""
    members, spent = _solve([Member(flight, start)], neighbours, margins, _ALONE)
    return (members[0] if members else None), spent


def part_members(members: Sequence[Member], margins: DistanceMargins) -> tuple[list[Member] | None, int]:
    """Separate a fleet: solve flights in conflict jointly, the others fixed, until no conflict is left."""
    current, iterations = list(members), 0
    groups: list[set[int]] = []
    for _ in range(len(current) + 1):
        pairs = [
            {i, j} for i in range(len(current)) for j in range(i) if _conflict(current[i], current[j], margins) > 0.0
        ]
        if not pairs:
            return current, iterations
        groups = _components([*groups, *pairs])
        for conflict_group in groups:
            if not any(pair <= conflict_group for pair in pairs):
                continue
            indices = sorted(conflict_group)
            fixed = [member for k, member in enumerate(current) if k not in conflict_group]
            # Flights outside the group are obstacles; if that fails they are ignored until the next pass.
            solved, used = _solve([current[k] for k in indices], fixed, margins, _JOINT)
            iterations += used
            if solved is None and fixed:
                solved, used = _solve([current[k] for k in indices], [], margins, _JOINT)
                iterations += used
            if solved is None:
                return None, iterations
            for k, member in zip(indices, solved, strict=True):
                current[k] = member
    return None, iterations


def choose_members(pools: Sequence[Sequence[Member]], initial: Sequence[int], margins: DistanceMargins) -> list[Member]:
    """Choose one member per pool, by exchanges that reduce the conflicts, starting from `initial`."""
    chosen = list(initial)
    cache: dict[tuple[int, int, int, int], float] = {}

    def conflict(i: int, a: int, j: int, b: int) -> float:
        key = (i, a, j, b) if i < j else (j, b, i, a)
        if key not in cache:
            cache[key] = _conflict(pools[i][a], pools[j][b], margins)
        return cache[key]

    for _ in range(4):
        previous = list(chosen)
        for i, pool in enumerate(pools):
            cost = [sum(conflict(i, a, j, chosen[j]) for j in range(len(pools)) if j != i) for a in range(len(pool))]
            if cost[chosen[i]] > min(cost):
                chosen[i] = int(np.argmin(cost))
        if chosen == previous:
            break
    return [pool[k] for pool, k in zip(pools, chosen, strict=True)]


def _components(groups: list[set[int]]) -> list[set[int]]:
    """Merge overlapping groups."""
    merged: list[set[int]] = []
    for group in groups:
        touching = [other_group for other_group in merged if other_group & group]
        merged = [other_group for other_group in merged if not other_group & group] + [set(group).union(*touching)]
    return merged


def _solve(
    members: Sequence[Member], fixed: Sequence[Member], margins: DistanceMargins, iterations: int
) -> tuple[list[Member] | None, int]:
    """Solve flights jointly, with additional times where the solution violates a distance in between."""
    current, used = list(members), 0
    case = current[0].flight.case
    constrained: dict[tuple[str, int, int], np.ndarray] = {}
    for _ in range(_REPEATS):
        paths = [member.path for member in current]
        obstacles: list[list[Obstacle]] = [[] for _ in current]
        encounters: list[Encounter] = []
        broken = False
        for k, member in enumerate(current):
            aircraft, arrival = member.flight.aircraft, member.flight.arrival
            for volume in range(case.keep_outs.radius.size):
                times = _stamps(case, arrival, margins.times.get(("keep_out", (aircraft, volume)), []))
                radius, half = _size(case, aircraft, volume, margins)
                centre = _keep_out(case, volume, times)
                mask, violated = _look(constrained, ("keep_out", k, volume), paths[k].at(times) - centre, radius, half)
                broken |= violated
                if mask.any():
                    obstacles[k].append(Obstacle(times[mask], centre[:, mask], radius, half))
            for j, neighbour in enumerate([*current[:k], *fixed]):
                pair = tuple(sorted((aircraft, neighbour.flight.aircraft)))
                radius, half = _separation(case, pair, margins)
                if radius <= 0.0:
                    continue
                times = _stamps(
                    case, min(arrival, neighbour.flight.arrival), margins.times.get(("separation", pair), [])
                )
                neighbour_positions = neighbour.path.at(times)
                mask, violated = _look(
                    constrained, ("separation", k, j), paths[k].at(times) - neighbour_positions, radius, half
                )
                broken |= violated
                if mask.any() and j < k:
                    encounters.append(Encounter(k, j, times[mask], radius, half))
                elif mask.any():
                    obstacles[k].append(Obstacle(times[mask], neighbour_positions[:, mask], radius, half))
        if used and not broken:
            return current, used
        flights = [member.flight for member in current]
        solution = solve_flights(flights, [member.x for member in current], obstacles, encounters, iterations)
        used += max(1, solution.iterations) * len(current)
        if not solution.feasible:
            return None, used
        current = [Member(flight, x) for flight, x in zip(flights, solution.unknowns, strict=True)]
    return None, used


def _look(
    constrained: dict[tuple[str, int, int], np.ndarray],
    key: tuple[str, int, int],
    displacement: Float[np.ndarray, "3 time"],
    radius: float,
    half: float,
) -> tuple[np.ndarray, bool]:
    """Times at which a distance is constrained, and whether it is violated at another time."""
    horizontal, vertical = np.hypot(displacement[0], displacement[1]), np.abs(displacement[2])
    mask = (horizontal < radius + _NEAR_M) & (vertical < half + _NEAR_UP_M)
    if key not in constrained:
        constrained[key] = mask
        return mask, False
    # At times already constrained, a remaining violation is within the solver's accuracy.
    violated = bool(np.any((horizontal < radius) & (vertical < half) & ~constrained[key]))
    if violated:
        constrained[key] = constrained[key] | mask
    return constrained[key], violated


def _stamps(case: PlanCase, end_time: float, extra_times: list[float]) -> Float[np.ndarray, " time"]:
    start = case.starts.time
    return np.unique(
        np.concatenate(
            [np.arange(start + _STAMP, end_time, _STAMP), [end_time], [t for t in extra_times if t <= end_time]]
        )
    )


def _keep_out(case: PlanCase, volume: int, times: Float[np.ndarray, " time"]) -> Float[np.ndarray, "3 time"]:
    """Centre of a keep-out at times, NED, m."""
    keep_outs = case.keep_outs
    horizontal = keep_outs.position_n[volume][:, None] + keep_outs.velocity_n[volume][:, None] * times
    return np.concatenate(
        [horizontal, np.full((1, times.size), -0.5 * (keep_outs.bottom[volume] + keep_outs.top[volume]))]
    )


def _size(case: PlanCase, aircraft: int, volume: int, margins: DistanceMargins) -> tuple[float, float]:
    """Radius and half height of a keep-out with margins, m; infinite height without a vertical escape."""
    keep_outs, L = case.keep_outs, case.limits
    extra = margins.keep_out.get((aircraft, volume), 0.0)
    radius, half = float(keep_outs.radius[volume]), 0.5 * float(keep_outs.top[volume] - keep_outs.bottom[volume])
    has_vertical_escape = (
        keep_outs.bottom[volume] > L.altitude_min[aircraft] or keep_outs.top[volume] < L.altitude_max[aircraft]
    )
    return radius + _margin(radius) + extra, half + _ROOM_M + extra if has_vertical_escape else float("inf")


def _separation(case: PlanCase, pair: tuple[int, ...], margins: DistanceMargins) -> tuple[float, float]:
    """Separation of a pair with margins, m; 0 if none is required."""
    horizontal, vertical, extra = (
        case.separation_horizontal,
        case.separation_vertical,
        margins.separation.get(pair, 0.0),
    )
    if horizontal <= 0.0 or vertical <= 0.0:
        return 0.0, 0.0
    return horizontal + _margin(horizontal) + extra, vertical + _ROOM_M + extra


def _margin(radius: float) -> float:
    return _ROOM_M + min((_CLOSING * _STAMP) ** 2 / (8.0 * radius), _SAGITTA_MOST * radius)


def _conflict(member: Member, neighbour: Member, margins: DistanceMargins) -> float:
    """Depth of two flights inside their separation, relative to it, summed over time."""
    case = member.flight.case
    pair = tuple(sorted((member.flight.aircraft, neighbour.flight.aircraft)))
    radius, half = _separation(case, pair, margins)
    if radius <= 0.0:
        return 0.0
    extra_times = margins.times.get(("separation", pair), [])
    times = _stamps(case, min(member.flight.arrival, neighbour.flight.arrival), extra_times)
    displacement = member.path.at(times) - neighbour.path.at(times)
    # A millimetre, within the margins, is the solver's accuracy.
    depth = np.minimum(
        1.0 - np.hypot(displacement[0], displacement[1]) / (radius - 1e-3),
        1.0 - np.abs(displacement[2]) / (half - 1e-3),
    )
    return float(np.sum(np.maximum(depth, 0.0)))
