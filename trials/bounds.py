"""Proofs of infeasibility: necessary conditions for single aircraft and for pairs at the arrival."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from trials.data import PlanCase
from trials.motion import path_demands

__all__ = ["PossibleTimes", "arrival_offsets", "possible_times"]

_STEP = 0.25
"""Width of the cells of arrival times, s; every condition is relaxed by the possible change within a cell."""
_SLACK = 1e-6
"""A condition violated by less than this (m, m/s) proves nothing: it may be rounding."""

Times = Float[np.ndarray, " cell"]
Possible = Bool[np.ndarray, " cell"]


class PossibleTimes(NamedTuple):
    """Arrival times that are not ruled out."""

    centres: Times
    """Centres of cells: arrival of the first aircraft, s; for the rule "windows" the fraction of each window."""
    possible: Bool[np.ndarray, "aircraft cell"]
    """Whether an arrival of the aircraft in the cell is not disproved; equal rows for coupled rules."""
    reasons: tuple[str, ...]
    """Reasons of infeasibility; empty if an arrival may be possible."""


def arrival_offsets(case: PlanCase) -> Float[np.ndarray, " aircraft"] | None:
    """Delay of each aircraft after the fleet's common time, s; None if the times are not coupled."""
    if case.rule.name in ("together", "earliest"):
        return np.zeros(case.size)
    return case.rule.spacing * case.rule.ranks() if case.rule.name == "sequence" else None


def possible_times(case: PlanCase, times: Float[np.ndarray, " aircraft"] | None, horizon: float) -> PossibleTimes:
    """Arrival times allowed by necessary conditions.

    Parameters
    ----------
    case
        Planning task.
    times
        Prescribed arrival times, s; None: any time allowed by the rule.
    horizon
        Last arrival considered for rules without a time limit, s.

    Notes
    -----
    Conditions: the start satisfies limits, separation and keep-outs; the rendezvous lies between floor and ceiling and
    outside keep-outs; it is reachable in the time by a point with bounded velocity relative to the mean wind, bounded
    acceleration and bounded climb rate; and two rendezvous points are separated at the earlier arrival, up to the
    distance covered by the later aircraft in between. The conditions are necessary, so a violation is a proof.
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
        for aircraft, (early, late) in enumerate(case.rule.windows):
            conditions = _single(case, aircraft, early + share * (late - early), 0.5 * (late - early) / 64.0)
            possible[aircraft] = np.all(list(conditions.values()), axis=0)
            reasons += _name_reasons(f"aircraft {aircraft}", conditions)
        centres = share
    return PossibleTimes(centres, possible, tuple(at_start + reasons))


def _coupled(
    case: PlanCase, tau: Times, offsets: Times, half: float
) -> tuple[Bool[np.ndarray, "aircraft cell"], list[str]]:
    possible = np.ones(tau.size, dtype=bool)
    reasons: list[str] = []
    for aircraft in range(case.size):
        conditions = _single(case, aircraft, tau + offsets[aircraft], half)
        reasons += _name_reasons(f"aircraft {aircraft}", conditions)
        possible &= np.all(list(conditions.values()), axis=0)
    for i in range(case.size):
        for j in range(i + 1, case.size):
            separated = _pair(case, i, j, tau + offsets[i], tau + offsets[j], half)
            if not separated.any():
                reasons.append(
                    f"aircraft {i} and {j}: their rendezvous points are closer than the separation at arrival"
                )
            possible &= separated
    if not possible.any() and not reasons:
        reasons.append("fleet: each condition leaves some arrival times, but none is left by all")
    return np.broadcast_to(possible, (case.size, tau.size)), reasons


def _name_reasons(label: str, conditions: dict[str, Possible]) -> list[str]:
    alone = [f"{label}: {description}" for description, possible in conditions.items() if not possible.any()]
    if alone or np.all(list(conditions.values()), axis=0).any():
        return alone
    return [f"{label}: no arrival time meets all of: {'; '.join(k for k, v in conditions.items() if not v.all())}"]


def _single(case: PlanCase, aircraft: int, time: Times, half: float) -> dict[str, Possible]:
    """Conditions for arrivals of one aircraft within `half` of each time, by the reason stated on failure."""
    L, start = case.limits, case.starts
    goal_speed = case.goals.speed_max(aircraft)
    meeting = case.goals.meeting_n(aircraft, time)
    flown = time - start.time
    winds = case.wind.velocities_n
    mean_wind = 0.5 * (winds.min(axis=0) + winds.max(axis=0))
    shear = float(np.max(np.linalg.norm(winds - mean_wind, axis=1)))
    displacement = meeting[:, :2] - start.position_n[aircraft, :2] - mean_wind[:2] * flown[:, None]
    distance = np.linalg.norm(displacement, axis=1)
    moving = goal_speed + float(np.linalg.norm(mean_wind)) + 1e-9
    top = float(L.speed_max[aircraft]) + shear
    initial_speed = displacement @ (start.velocity_n[aircraft, :2] - mean_wind[:2]) / np.maximum(distance, 1e-9)
    reach = _covered(np.minimum(initial_speed, top), top, _turning(case, aircraft), np.maximum(flown + half, 0.0))
    climbed = np.abs(meeting[:, 2] - start.position_n[aircraft, 2])
    climb_most = float(L.climb_rate_max[aircraft]) + float(np.max(np.abs(winds[:, 2])))
    altitude, margin = -meeting[:, 2], half * goal_speed + _SLACK
    conditions = {
        "the arrival is not after the start": flown + half > 0.0,
        "the rendezvous is out of reach in the time": distance - moving * half <= reach + _SLACK,
        "the rendezvous is higher or lower than the climb rate allows in the time": climbed - margin
        <= climb_most * np.maximum(flown + half, 0.0),
        "the rendezvous is below the floor": altitude + margin >= L.altitude_min[aircraft],
        "the rendezvous is above the ceiling": altitude - margin <= L.altitude_max[aircraft],
    }
    for volume in range(case.keep_outs.radius.size):
        clearance = case.keep_outs.clearance(volume, time, meeting.T)
        change = half * (goal_speed + float(np.linalg.norm(case.keep_outs.velocity_n[volume])))
        conditions[f"the rendezvous is inside keep-out {volume}"] = clearance + change + _SLACK >= 0.0
    return conditions


def _turning(case: PlanCase, aircraft: int) -> float:
    """Greatest horizontal acceleration within the limits, m/s^2."""
    L = case.limits
    lift = float(L.load_factor_max[aircraft]) * case.gravity
    along = max(float(L.acceleration_max[aircraft]), float(L.deceleration_max[aircraft]))
    steep = min(1.0, float(L.climb_rate_max[aircraft]) / max(float(L.speed_min[aircraft]), 1e-9))
    return float(np.hypot(lift * np.sin(float(L.bank_max[aircraft])), lift * steep + along))


def _covered(begin: Times, top: float, rate: float, time: Times) -> Times:
    """Distance covered by a speed that starts at `begin` and grows at `rate` up to `top`."""
    growing = np.minimum((top - begin) / rate, time)
    return begin * growing + 0.5 * rate * growing**2 + top * (time - growing)


def _pair(case: PlanCase, i: int, j: int, time_i: Times, time_j: Times, half: float) -> Possible:
    """Whether two aircraft can be separated at the earlier of two arrivals."""
    meeting_i, meeting_j = case.goals.meeting_n(i, time_i), case.goals.meeting_n(j, time_j)
    late = j if time_j[0] >= time_i[0] else i
    between = np.abs(time_j - time_i)
    wind = float(np.max(np.linalg.norm(case.wind.velocities_n, axis=1)))
    margin = half * (case.goals.speed_max(i) + case.goals.speed_max(j)) + _SLACK
    flat = (
        np.linalg.norm((meeting_i - meeting_j)[:, :2], axis=1)
        + margin
        + between * (float(case.limits.speed_max[late]) + wind)
    )
    up = np.abs((meeting_i - meeting_j)[:, 2]) + margin + between * (float(case.limits.climb_rate_max[late]) + wind)
    return (flat >= case.separation_horizontal) | (up >= case.separation_vertical)


def _start_reasons(case: PlanCase) -> list[str]:
    """Violations at the start, which no plan can remove."""
    start, L = case.starts, case.limits
    positions = start.position_n.T
    demands = path_demands(start.velocity_n.T, start.acceleration_n.T, case.wind.at(-positions[2]), case.gravity)
    excesses = {
        "too slow": L.speed_min - demands.speed,
        "too fast": demands.speed - L.speed_max,
        "climbing too fast": np.abs(demands.climb_rate) - L.climb_rate_max,
        "below its floor": L.altitude_min + positions[2],
        "above its ceiling": -positions[2] - L.altitude_max,
    }
    reasons = [
        f"aircraft {aircraft}: starts {description}"
        for description, excess in excesses.items()
        for aircraft in np.flatnonzero(excess > _SLACK)
    ]
    for volume in range(case.keep_outs.radius.size):
        inside = case.keep_outs.clearance(volume, np.full(case.size, start.time), positions) < -_SLACK
        reasons += [f"aircraft {aircraft}: starts inside keep-out {volume}" for aircraft in np.flatnonzero(inside)]
    for i in range(case.size):
        for j in range(i + 1, case.size):
            flat, up = np.hypot(*(positions[:2, i] - positions[:2, j])), abs(positions[2, i] - positions[2, j])
            if flat < case.separation_horizontal - _SLACK and up < case.separation_vertical - _SLACK:
                reasons.append(f"aircraft {i} and {j}: start closer than the separation")
    return reasons
