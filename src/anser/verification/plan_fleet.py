"""Gauss-Newton steps on what is violated: one aircraft alone, and a fleet whose members keep apart."""

import time
from collections.abc import Iterator
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from anser.verification.plan_data import PlanCase
from anser.verification.plan_spline import SplineFlight, StepTerms, Unknowns

__all__ = ["Member", "choose_members", "part_members", "solve_single"]

_SINGLE_STEPS = 40
_FLEET_STEPS = 40
_ENOUGH = 1e-9
"""Cost at which nothing is violated but by a share of the margin."""
_SLOW, _PATIENCE = 0.9, 6
"""One aircraft's search is given up where so many steps in a row leave more than this share of the cost."""
_FLEET_SLOW, _FLEET_PATIENCE = 0.97, 10
"""The same of a fleet's: conflicts turn slowly where two aircraft have to change sides."""
_UP_WEIGHT = 3.0
"""Metres aside that one metre of height is worth, in choosing the way out of a conflict."""
_PAIR_SCALE = 200.0
_PAIR_MARGIN = 3.0
"""Aimed at beyond the separation, m."""
_COMBINATIONS = 3
"""Fleets put together per round."""


class Member(NamedTuple):
    """A flight and its unknowns."""

    flight: SplineFlight
    x: Unknowns


def solve_single(flight: SplineFlight, x: Unknowns) -> tuple[Unknowns | None, float]:
    """Unknowns that keep every limit and keep-out of one aircraft, from a guess; None where steps lead nowhere.

    With them the cost left: half the sum of squares of scaled violations.
    """
    cost, rows, values = flight.linearize(x)
    damping, slow = 1e-2 * cost, 0
    for _ in range(_SINGLE_STEPS):
        if cost <= _ENOUGH:
            break
        step = _damped_step(rows, values, damping)
        trial = flight.residual(x + step)
        if trial < cost:
            slow = slow + 1 if trial > _SLOW * cost else 0
            x = x + step
            cost, rows, values = flight.linearize(x)
            damping = 0.2 * damping
        else:
            damping, slow = 5.0 * damping, slow + 1
        if slow >= _PATIENCE:
            break
    return (x if cost <= _ENOUGH else None), cost


def _damped_step(rows: Float[np.ndarray, "row unknown"], values: Float[np.ndarray, " row"], damping: float) -> Unknowns:
    """Step that lowers |values + rows step|^2 + damping |step|^2 most, by the smaller of its two systems."""
    count, unknowns = rows.shape
    if count < unknowns:
        return -rows.T @ np.linalg.solve(rows @ rows.T + damping * np.eye(count), values)
    return -np.linalg.solve(rows.T @ rows + damping * np.eye(unknowns), rows.T @ values)


def choose_members(case: PlanCase, pool: list[list[Member]], rng: np.random.Generator) -> Iterator[list[Member]]:
    """Yield fleets whose members, one of each pool, conflict little: random choices improved one aircraft at a time."""
    size = len(pool)
    if size == 1 or case.separation_horizontal == 0.0 or case.separation_vertical == 0.0:
        yield [members[-1] for members in pool]
        return
    places = [[m.flight.positions(m.x) for m in members] for members in pool]
    costs = {}
    for i, j in combinations(range(size), 2):
        table = np.array([[np.sum(_pair_depths(case, a, b)[0] ** 2) for b in places[j]] for a in places[i]])
        # Least conflict is not surely the easiest to part: each round weighs the pairs anew.
        table = table * rng.lognormal(0.0, 1.0, table.shape)
        costs[i, j], costs[j, i] = table, table.T
    seen: set[tuple[int, ...]] = set()
    for _ in range(_COMBINATIONS):
        choice = [int(rng.integers(len(members))) for members in pool]
        for _ in range(4):
            for who in rng.permutation(size):
                total = sum(costs[who, j][:, choice[j]] for j in range(size) if j != who)
                choice[who] = int(np.argmin(total))
        if tuple(choice) not in seen:
            seen.add(tuple(choice))
            yield [members[k] for members, k in zip(pool, choice, strict=True)]


def _pair_depths(
    case: PlanCase, one: Float[np.ndarray, "3 time"], other: Float[np.ndarray, "3 time"], margin: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scaled depth of conflicts, the stamps at which, and their slope with the position of the first."""
    count = min(one.shape[1], other.shape[1])
    rel = one[:, :count] - other[:, :count]
    flat = np.maximum(np.hypot(rel[0], rel[1]), 1e-6)
    aside = case.separation_horizontal + margin - flat
    up = case.separation_vertical + margin - np.abs(rel[2])
    at = np.flatnonzero((aside > 0.0) & (up > 0.0))
    by_height = _UP_WEIGHT * up[at] < aside[at]
    depth = np.where(by_height, _UP_WEIGHT * up[at], aside[at]) / _PAIR_SCALE
    slope = np.zeros((at.size, 3))
    slope[:, :2] = np.where(by_height, 0.0, -rel[:2, at] / flat[at]).T
    slope[:, 2] = np.where(by_height, -_UP_WEIGHT * np.where(rel[2, at] >= 0.0, 1.0, -1.0), 0.0)
    return depth, at, slope / _PAIR_SCALE


def part_members(case: PlanCase, members: list[Member], deadline: float) -> list[Member] | None:
    """Fleet that keeps limits, keep-outs and separation, from one that keeps less; None where steps lead nowhere."""
    flights, xs = [m.flight for m in members], [m.x for m in members]
    ends = np.cumsum([0, *(x.size for x in xs)])
    spans = [slice(a, b) for a, b in pairwise(ends)]
    x = np.concatenate(xs)
    cost, rows, values = _fleet_terms(case, flights, spans, x)
    damping, slow = 1e-2 * cost, 0
    for _ in range(_FLEET_STEPS):
        if cost <= _ENOUGH:
            break
        if time.thread_time() > deadline or slow >= _FLEET_PATIENCE:
            return None
        trial_x = x + _damped_step(rows, values, damping)
        trial = _fleet_cost(case, flights, spans, trial_x)
        if trial < cost:
            slow = slow + 1 if trial > _FLEET_SLOW * cost else 0
            x = trial_x
            cost, rows, values = _fleet_terms(case, flights, spans, x)
            damping = 0.2 * damping
        else:
            damping, slow = 5.0 * damping, slow + 1
    return [Member(f, x[span]) for f, span in zip(flights, spans, strict=True)] if cost <= _ENOUGH else None


def _conflicts(case: PlanCase, flights: list[SplineFlight], spans: list[slice], x: Unknowns) -> Iterator[tuple]:
    if case.separation_horizontal == 0.0 or case.separation_vertical == 0.0:
        return
    places = [flight.positions(x[span]) for flight, span in zip(flights, spans, strict=True)]
    for i, j in combinations(range(len(flights)), 2):
        depth, at, slope = _pair_depths(case, places[i], places[j], _PAIR_MARGIN)
        if at.size:
            yield i, j, depth, at, slope


def _fleet_cost(case: PlanCase, flights: list[SplineFlight], spans: list[slice], x: Unknowns) -> float:
    alone = sum(flight.residual(x[span]) for flight, span in zip(flights, spans, strict=True))
    return alone + sum(0.5 * float(depth @ depth) for _, _, depth, _, _ in _conflicts(case, flights, spans, x))


def _fleet_terms(case: PlanCase, flights: list[SplineFlight], spans: list[slice], x: Unknowns) -> StepTerms:
    """Cost, Jacobian and residual of the whole fleet."""
    terms = [flight.linearize(x[span]) for flight, span in zip(flights, spans, strict=True)]
    conflicts = list(_conflicts(case, flights, spans, x))
    values = np.concatenate([*(own for _, _, own in terms), *(depth for _, _, depth, _, _ in conflicts)])
    rows, row = np.zeros((values.size, x.size)), 0
    for span, (_, own, _) in zip(spans, terms, strict=True):
        rows[row : row + len(own), span] = own
        row += len(own)
    for i, j, depth, at, slope in conflicts:
        part = slice(row, row + depth.size)
        rows[part, spans[i]] = np.einsum("ka,aku->ku", slope, flights[i].S.slope[:, at])
        rows[part, spans[j]] = -np.einsum("ka,aku->ku", slope, flights[j].S.slope[:, at])
        row += depth.size
    return 0.5 * float(values @ values), rows, values
