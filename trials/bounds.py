"""Proofs that no plan exists: necessary conditions of single aircraft and of pairs at their arrival."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from trials.data import PlanCase
from trials.motion import path_demands

__all__ = ["PossibleTimes", "arrival_offsets", "possible_times"]

_STEP = 0.25
"""Arrival times are looked at in cells of this width, s; every condition is relaxed by what can change within one."""
_SLACK = 1e-6
"""A condition missed by less than this (m, m/s) proves nothing: it may be rounding."""

Times = Float[np.ndarray, " cell"]
Possible = Bool[np.ndarray, " cell"]


class PossibleTimes(NamedTuple):
    """Where arrivals are not ruled out."""

    centres: Times
    """Centres of cells: arrival of the first aircraft, s; for the rule "windows" the share of each one's window."""
    possible: Bool[np.ndarray, "aircraft cell"]
    """Whether an arrival of this aircraft in this cell is not disproved; the cells of all agree for coupled rules."""
    reasons: tuple[str, ...]
    """Why none is possible; empty where one may be."""


def arrival_offsets(case: PlanCase) -> Float[np.ndarray, " aircraft"] | None:
    """How much later than the fleet's common time each aircraft arrives, s; None where their times are not coupled."""
    if case.rule.name in ("together", "earliest"):
        return np.zeros(case.size)
    return case.rule.spacing * case.rule.ranks() if case.rule.name == "sequence" else None


def possible_times(case: PlanCase, times: Float[np.ndarray, " aircraft"] | None, horizon: float) -> PossibleTimes:
    """Arrival times that necessary conditions leave open.

    Parameters
    ----------
    case
        What is asked.
    times
        Arrival times given beforehand, s; without them what the rule allows.
    horizon
        Last arrival considered where the rule sets none, s.

    Notes
    -----
    Conditions: the start keeps limits, separation and keep-outs; the rendezvous lies between floor and ceiling and
    outside keep-outs; it can be reached in the time by a point whose velocity less the mean wind is bounded, changes no
    faster than limits allow, and climbs no faster; and two rendezvous points are apart at the earlier arrival by what
    the later aircraft cannot cover in the time between. All are necessary, so what they rule out is proved.
    """
    at_start = _start_reasons(case)
    offsets = arrival_offsets(case)
    fixed = times
    if fixed is None and case.rule.name in ("at", "times"):
        fixed = case.rule.times
    if fixed is not None:
        possible, reasons = _coupled(case, np.array([float(fixed[0])]), fixed - fixed[0], 0.0)
        centres = np.array([float(fixed[0])])
    elif offsets is not None:
        centres = case.starts.time + np.arange(0.5 * _STEP, horizon, _STEP)
        possible, reasons = _coupled(case, centres, offsets, 0.5 * _STEP)
    else:
        share = (np.arange(64) + 0.5) / 64.0
        possible = np.empty((case.size, 64), dtype=bool)
        reasons = []
        for who, (early, late) in enumerate(case.rule.windows):
            own = _single(case, who, early + share * (late - early), 0.5 * (late - early) / 64.0)
            possible[who] = np.all(list(own.values()), axis=0)
            reasons += _name_reasons(f"aircraft {who}", own)
        centres = share
    return PossibleTimes(centres, possible, tuple(at_start + reasons))


def _coupled(
    case: PlanCase, tau: Times, offsets: Times, half: float
) -> tuple[Bool[np.ndarray, "aircraft cell"], list[str]]:
    left = np.ones(tau.size, dtype=bool)
    reasons: list[str] = []
    for who in range(case.size):
        own = _single(case, who, tau + offsets[who], half)
        reasons += _name_reasons(f"aircraft {who}", own)
        left &= np.all(list(own.values()), axis=0)
    for i in range(case.size):
        for j in range(i + 1, case.size):
            apart = _pair(case, i, j, tau + offsets[i], tau + offsets[j], half)
            if not apart.any():
                reasons.append(
                    f"aircraft {i} and {j}: their rendezvous points are closer than the separation at arrival"
                )
            left &= apart
    if not left.any() and not reasons:
        reasons.append("fleet: each condition leaves some arrival times, but none is left by all")
    return np.broadcast_to(left, (case.size, tau.size)), reasons


def _name_reasons(who: str, conditions: dict[str, Possible]) -> list[str]:
    alone = [f"{who}: {words}" for words, possible in conditions.items() if not possible.any()]
    if alone or np.all(list(conditions.values()), axis=0).any():
        return alone
    return [f"{who}: no arrival time meets all of: {'; '.join(k for k, v in conditions.items() if not v.all())}"]


def _single(case: PlanCase, who: int, time: Times, half: float) -> dict[str, Possible]:
    """Conditions of one aircraft for arrivals within `half` of each time, by what they say when they fail."""
    L, start = case.limits, case.starts
    goal_speed = case.goals.speed_max(who)
    meeting = case.goals.meeting_n(who, time)
    flown = time - start.time
    winds = case.wind.velocities_n
    mean_wind = 0.5 * (winds.min(axis=0) + winds.max(axis=0))
    shear = float(np.max(np.linalg.norm(winds - mean_wind, axis=1)))
    way = meeting[:, :2] - start.position_n[who, :2] - mean_wind[:2] * flown[:, None]
    distance = np.linalg.norm(way, axis=1)
    moving = goal_speed + float(np.linalg.norm(mean_wind)) + 1e-9
    top = float(L.speed_max[who]) + shear
    ahead = way @ (start.velocity_n[who, :2] - mean_wind[:2]) / np.maximum(distance, 1e-9)
    reach = _covered(np.minimum(ahead, top), top, _turning(case, who), np.maximum(flown + half, 0.0))
    climbed = np.abs(meeting[:, 2] - start.position_n[who, 2])
    climb_most = float(L.climb_rate_max[who]) + float(np.max(np.abs(winds[:, 2])))
    altitude, room = -meeting[:, 2], half * goal_speed + _SLACK
    free = {
        "the arrival is not after the start": flown + half > 0.0,
        "the rendezvous is out of reach in the time": distance - moving * half <= reach + _SLACK,
        "the rendezvous is higher or lower than the climb rate allows in the time": climbed - room
        <= climb_most * np.maximum(flown + half, 0.0),
        "the rendezvous is below the floor": altitude + room >= L.altitude_min[who],
        "the rendezvous is above the ceiling": altitude - room <= L.altitude_max[who],
    }
    for which in range(case.keep_outs.radius.size):
        clearance = case.keep_outs.clearance(which, time, meeting.T)
        change = half * (goal_speed + float(np.linalg.norm(case.keep_outs.velocity_n[which])))
        free[f"the rendezvous is inside keep-out {which}"] = clearance + change + _SLACK >= 0.0
    return free


def _turning(case: PlanCase, who: int) -> float:
    """Greatest horizontal acceleration that limits allow, m/s^2."""
    L = case.limits
    lift = float(L.load_factor_max[who]) * case.gravity
    along = max(float(L.acceleration_max[who]), float(L.deceleration_max[who]))
    steep = min(1.0, float(L.climb_rate_max[who]) / max(float(L.speed_min[who]), 1e-9))
    return float(np.hypot(lift * np.sin(float(L.bank_max[who])), lift * steep + along))


def _covered(begin: Times, top: float, rate: float, time: Times) -> Times:
    """Distance that a speed covers which starts at `begin` and grows at `rate` up to `top`."""
    growing = np.minimum((top - begin) / rate, time)
    return begin * growing + 0.5 * rate * growing**2 + top * (time - growing)


def _pair(case: PlanCase, i: int, j: int, time_i: Times, time_j: Times, half: float) -> Possible:
    """Whether two aircraft can be apart at the earlier of two arrivals."""
    here, there = case.goals.meeting_n(i, time_i), case.goals.meeting_n(j, time_j)
    late = j if time_j[0] >= time_i[0] else i
    between = np.abs(time_j - time_i)
    wind = float(np.max(np.linalg.norm(case.wind.velocities_n, axis=1)))
    room = half * (case.goals.speed_max(i) + case.goals.speed_max(j)) + _SLACK
    flat = np.linalg.norm((here - there)[:, :2], axis=1) + room + between * (float(case.limits.speed_max[late]) + wind)
    up = np.abs((here - there)[:, 2]) + room + between * (float(case.limits.climb_rate_max[late]) + wind)
    return (flat >= case.separation_horizontal) | (up >= case.separation_vertical)


def _start_reasons(case: PlanCase) -> list[str]:
    """What is broken at the start already: nothing can mend that."""
    start, L = case.starts, case.limits
    place = start.position_n.T
    asked = path_demands(start.velocity_n.T, start.acceleration_n.T, case.wind.at(-place[2]), case.gravity)
    beyond = {
        "too slow": L.speed_min - asked.speed,
        "too fast": asked.speed - L.speed_max,
        "climbing too fast": np.abs(asked.climb_rate) - L.climb_rate_max,
        "below its floor": L.altitude_min + place[2],
        "above its ceiling": -place[2] - L.altitude_max,
    }
    reasons = [f"aircraft {who}: starts {words}" for words, by in beyond.items() for who in np.flatnonzero(by > _SLACK)]
    for which in range(case.keep_outs.radius.size):
        inside = case.keep_outs.clearance(which, np.full(case.size, start.time), place) < -_SLACK
        reasons += [f"aircraft {who}: starts inside keep-out {which}" for who in np.flatnonzero(inside)]
    for i in range(case.size):
        for j in range(i + 1, case.size):
            flat, up = np.hypot(*(place[:2, i] - place[:2, j])), abs(place[2, i] - place[2, j])
            if flat < case.separation_horizontal - _SLACK and up < case.separation_vertical - _SLACK:
                reasons.append(f"aircraft {i} and {j}: start closer than the separation")
    return reasons
