"""Dense check of a plan: every limit, separation and arrival at every millisecond, by formulas of its own."""

import numpy as np
from jaxtyping import Bool, Float

from trials.data import ArrivalRule, FleetLimits, Paths, PlanCase
from trials.motion import EMPTY_S, PathCells, path_cells, path_demands
from trials.report import LIMITS, Breach, PlanReport, Tolerances
from trials.separation import PairReport, chord_blocks, least_clearances

__all__ = ["check_rule", "dense_check"]

_CHUNK = 16384
"""Samples worked on at once: they fit the processor's cache."""
_CELL_SAMPLES = 8
"""Samples within a cell shorter than as many steps, so that none slips through between two milliseconds."""
_LOWEST = ("speed_min", "altitude_min")


def dense_check(
    paths: Paths,
    case: PlanCase,
    arrival_times: Float[np.ndarray, " aircraft"],
    step: float = 1e-3,
    tolerances: Tolerances | None = None,
) -> PlanReport:
    """Check delivered paths against everything that was asked.

    Parameters
    ----------
    paths
        The plan.
    case
        What was asked.
    arrival_times
        When each aircraft is said to arrive, s.
    step
        Time between samples, s; every knot, and points within shorter cells, are looked at besides.
    tolerances
        What still passes.

    Returns
    -------
    Extremes, margins, and every breach. A plan with a number that is not finite, times that fall, or no cell has one
    breach, "unusable", and no figures.

    Raises
    ------
    ValueError
        If there is not one path and one arrival time per aircraft.
    """
    allowed = tolerances or Tolerances()
    if paths.times.shape[0] != case.size or arrival_times.size != case.size:
        raise ValueError(
            f"plan: arrived {paths.times.shape[0]} paths and {arrival_times.size} arrival times; "
            f"expected {case.size} of each"
        )
    unusable = _unusable(paths, arrival_times)
    if unusable:
        return PlanReport({}, {}, _no_pairs(), np.empty((0, 0)), np.empty(0), np.empty(0), unusable)
    ground = paths.air_n + paths.drift_n
    breaches: list[Breach] = []
    cells = [path_cells(t, k) for t, k in zip(paths.times, ground, strict=True)]
    rows = [
        _Aircraft(who, cell, path_cells(t, drift), case, step)
        for who, (cell, t, drift) in enumerate(zip(cells, paths.times, paths.drift_n, strict=True))
    ]
    extremes = {limit: np.array([row.extremes[limit][0] for row in rows]) for limit in LIMITS}
    excess = {limit: _excess(limit, extremes[limit], case.limits) for limit in LIMITS}
    for limit, unit in LIMITS.items():
        for who in np.flatnonzero(~(excess[limit] <= allowed.of_limit(limit))):
            moment = rows[who].extremes[limit][1]
            breaches.append(Breach(limit, (int(who),), float(excess[limit][who]), unit, moment))
    for who, row in enumerate(rows):
        for which in np.flatnonzero(~(row.keep_out[:, 0] >= -allowed.position)):
            inside, moment = row.keep_out[which]
            breaches.append(Breach("keep_out", (who, int(which)), float(-inside), "m", float(moment)))
    pairs = least_clearances(
        cells,
        [row.blocks for row in rows],
        paths.times[:, -1],
        (case.separation_horizontal, case.separation_vertical),
        float(case.starts.time),
        step,
    )
    for k in np.flatnonzero(~(pairs.clearance >= -allowed.position)):
        who = (int(pairs.first[k]), int(pairs.second[k]))
        breaches.append(Breach("separation", who, float(-pairs.clearance[k]), "m", float(pairs.time[k])))
    breaches += _start_breaches(paths.times[:, 0], ground[:, 0], case, allowed)
    breaches += _jumps(paths.times, ground, allowed)
    miss, late = _arrival(paths.times[:, -1], ground[:, -1], case, arrival_times, allowed)
    breaches += late + check_rule(case.rule, arrival_times, allowed.time)
    clearances = np.array([row.keep_out[:, 0] for row in rows])
    wind_error = np.array([row.wind_error for row in rows])
    return PlanReport(extremes, excess, pairs, clearances, miss, wind_error, tuple(breaches))


def _no_pairs() -> PairReport:
    return least_clearances([], [], np.empty(0), (0.0, 0.0), 0.0, 1.0)


def _unusable(paths: Paths, arrival_times: Float[np.ndarray, " aircraft"]) -> tuple[Breach, ...]:
    finite = [np.isfinite(paths.times), np.isfinite(paths.air_n), np.isfinite(paths.drift_n)]
    good: Bool[np.ndarray, " aircraft"] = np.isfinite(arrival_times)
    for values in finite:
        good = good & values.reshape(values.shape[0], -1).all(axis=1)
    good = good & (np.diff(paths.times, axis=1) >= 0.0).all(axis=1) & (paths.times[:, -1] > paths.times[:, 0])
    return tuple(Breach("unusable", (int(who),), np.inf, "-", np.nan) for who in np.flatnonzero(~good))


class _Aircraft:
    """Samples of one aircraft boiled down: extremes with their times, keep-outs, and chords for separation."""

    def __init__(self, who: int, cells: PathCells, drift: PathCells, case: PlanCase, step: float) -> None:
        begin, end = cells.begin[0], cells.end[-1]
        count = int(np.floor((end - begin) / step + 1e-9)) + 1
        grid = np.minimum(begin + step * np.arange(count), end)
        samples = cells.at(grid)
        self.blocks = chord_blocks(samples[:3])
        self.extremes = {limit: (np.inf if limit in _LOWEST else -np.inf, np.nan) for limit in LIMITS}
        self.keep_out = np.full((case.keep_outs.radius.size, 2), np.inf)
        self.wind_error = 0.0
        self._case = case
        for first in range(0, count, _CHUNK):
            part = slice(first, first + _CHUNK)
            self._look(grid[part], samples[:, part])
        extra = _between(cells, step)
        at_extra = cells.at(extra)
        self._look(extra, at_extra)
        wind = case.wind.at(-at_extra[2])
        self.wind_error = float(np.max(np.linalg.norm(drift.at(extra)[3:6] - wind, axis=0)))

    def _look(self, time: Float[np.ndarray, " time"], motion: Float[np.ndarray, "9 time"]) -> None:
        case, altitude = self._case, -motion[2]
        asked = path_demands(motion[3:6], motion[6:9], case.wind.at(altitude), case.gravity)
        values = {
            "speed_min": asked.speed,
            "speed_max": asked.speed,
            "bank_max": np.abs(np.arctan2(asked.side, asked.normal)),
            "load_factor_max": np.hypot(asked.side, asked.normal) / case.gravity,
            "climb_rate_max": np.abs(asked.climb_rate),
            "altitude_min": altitude,
            "altitude_max": altitude,
            "acceleration_max": asked.along,
            "deceleration_max": -asked.along,
        }
        for limit, series in values.items():
            lowest = limit in _LOWEST
            at = int(np.argmin(series) if lowest else np.argmax(series))
            now, worst = float(series[at]), self.extremes[limit][0]
            # Written so that NaN, which argmin and argmax point at, is kept and then breaks the limit.
            if not np.isnan(worst) and not (now >= worst if lowest else now <= worst):
                self.extremes[limit] = (now, float(time[at]))
        for which in range(self.keep_out.shape[0]):
            clearance = case.keep_outs.clearance(which, time, motion[:3])
            at = int(np.argmin(clearance))
            if clearance[at] < self.keep_out[which, 0]:
                self.keep_out[which] = clearance[at], time[at]


def _between(cells: PathCells, step: float) -> Float[np.ndarray, " time"]:
    """Knots, and instants within cells too short for the grid, s."""
    short = cells.end - cells.begin < _CELL_SAMPLES * step
    share = np.arange(1, _CELL_SAMPLES) / _CELL_SAMPLES
    inside = cells.begin[short, None] + share * (cells.end - cells.begin)[short, None]
    return np.sort(np.concatenate([cells.begin, cells.end[-1:], inside.ravel()]))


def _excess(limit: str, extreme: Float[np.ndarray, " aircraft"], limits: FleetLimits) -> Float[np.ndarray, " aircraft"]:
    bound = getattr(limits, limit)
    return bound - extreme if limit in _LOWEST else extreme - bound


def _start_breaches(
    begin: Float[np.ndarray, " aircraft"],
    first: Float[np.ndarray, "aircraft 3 3"],
    case: PlanCase,
    allowed: Tolerances,
) -> list[Breach]:
    wanted = np.stack([case.starts.position_n, case.starts.velocity_n, case.starts.acceleration_n], axis=1)
    off = np.linalg.norm(first - wanted, axis=2)
    breaches = [
        Breach("start_time", (int(who),), float(abs(begin[who] - case.starts.time)), "s", float(begin[who]))
        for who in np.flatnonzero(~(np.abs(begin - case.starts.time) <= allowed.time))
    ]
    kinds = (("position", "m", allowed.position), ("velocity", "m/s", allowed.velocity))
    for order, (kind, unit, most) in enumerate((*kinds, ("acceleration", "m/s^2", allowed.acceleration))):
        for who in np.flatnonzero(~(off[:, order] <= most)):
            breaches.append(Breach(f"start_{kind}", (int(who),), float(off[who, order]), unit, float(begin[who])))
    return breaches


def _jumps(
    times: Float[np.ndarray, "aircraft knot"], ground: Float[np.ndarray, "aircraft knot 3 3"], allowed: Tolerances
) -> list[Breach]:
    """Jumps across empty cells: both ends of every other cell are shared with its neighbours."""
    empty = np.diff(times, axis=1) <= EMPTY_S
    jump = np.linalg.norm(np.diff(ground, axis=1), axis=3) * empty[:, :, None]
    breaches = []
    kinds = (("position", "m", allowed.position), ("velocity", "m/s", allowed.velocity))
    for order, (kind, unit, most) in enumerate((*kinds, ("acceleration", "m/s^2", allowed.acceleration))):
        at = np.argmax(jump[:, :, order], axis=1)
        worst = np.take_along_axis(jump[:, :, order], at[:, None], axis=1)[:, 0]
        for who in np.flatnonzero(~(worst <= most)):
            breaches.append(Breach(f"jump_{kind}", (int(who),), float(worst[who]), unit, float(times[who, at[who]])))
    return breaches


def _arrival(
    end: Float[np.ndarray, " aircraft"],
    last: Float[np.ndarray, "aircraft 3 3"],
    case: PlanCase,
    arrival_times: Float[np.ndarray, " aircraft"],
    allowed: Tolerances,
) -> tuple[Float[np.ndarray, " aircraft"], list[Breach]]:
    """Distance from each rendezvous, and everything that is wrong about the arrivals."""
    breaches, miss = [], np.empty(end.size)
    for who in range(end.size):
        claimed = float(arrival_times[who])

        def note(kind: str, amount: float, unit: str, most: float, who: int = who, time: float = claimed) -> None:
            if not amount <= most:
                breaches.append(Breach(kind, (who,), amount, unit, time))

        meeting = case.goals.meeting_n(who, arrival_times[who : who + 1])[0]
        miss[who] = np.linalg.norm(last[who, 0] - meeting)
        note("arrival_time", float(abs(end[who] - claimed)), "s", allowed.time)
        note("arrival_position", float(miss[who]), "m", allowed.position)
        north, east, down = last[who, 1]
        course, path_angle = case.goals.course[who], case.goals.path_angle[who]
        if np.isfinite(course):
            turned = np.remainder(np.arctan2(east, north) - course + np.pi, 2.0 * np.pi) - np.pi
            note("arrival_course", float(abs(turned)), "rad", allowed.angle)
        if np.isfinite(path_angle):
            note(
                "arrival_path_angle",
                float(abs(np.arctan2(-down, np.hypot(north, east)) - path_angle)),
                "rad",
                allowed.angle,
            )
    return miss, breaches


def check_rule(rule: ArrivalRule, arrival_times: Float[np.ndarray, " aircraft"], tolerance: float) -> list[Breach]:
    """Breaches of the fleet's arrival rule by arrival times, s; that "earliest" is the earliest is not looked at."""
    if rule.name in ("together", "earliest"):
        off = arrival_times - arrival_times[0]
    elif rule.name in ("at", "times"):
        off = arrival_times - rule.times
    elif rule.name == "sequence":
        in_order = arrival_times - rule.spacing * rule.ranks()
        off = in_order - in_order[rule.order[0]]
    else:
        early, late = rule.windows.T
        off = np.maximum(np.maximum(early - arrival_times, arrival_times - late), 0.0)
    return [
        Breach("arrival_rule", (int(who),), float(abs(off[who])), "s", float(arrival_times[who]))
        for who in np.flatnonzero(~(np.abs(off) <= tolerance))
    ]
