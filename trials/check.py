"""Dense check of a plan: every limit, separation and arrival at every millisecond, by independent formulas."""

import numpy as np
from jaxtyping import Bool, Float

from trials.data import ArrivalRule, FleetLimits, Paths, PlanCase
from trials.motion import EMPTY_S, PathCells, path_cells, path_demands
from trials.report import LIMITS, Breach, PlanReport, Tolerances
from trials.separation import PairReport, chord_blocks, least_clearances

__all__ = ["check_rule", "dense_check"]

_CHUNK = 16384
"""Samples per step of the computation: they fit the processor's cache."""
_CELL_SAMPLES = 8
"""Samples within a cell shorter than this number of steps, so that no cell lies between two grid times unchecked."""
_LOWEST = ("speed_min", "altitude_min")


def dense_check(
    paths: Paths,
    case: PlanCase,
    arrival_times: Float[np.ndarray, " aircraft"],
    step: float = 1e-3,
    tolerances: Tolerances | None = None,
) -> PlanReport:
    """Check delivered paths against every requirement of the task.

    Parameters
    ----------
    paths
        The plan.
    case
        Planning task.
    arrival_times
        Stated arrival time of each aircraft, s.
    step
        Time between samples, s; every knot, and points within shorter cells, are checked additionally.
    tolerances
        Accepted deviations.

    Returns
    -------
    Extremes, margins, and every breach. A plan with a non-finite number, decreasing times or no cell has one breach,
    "unusable", and no figures.

    Raises
    ------
    ValueError
        If the numbers of paths and arrival times differ from the number of aircraft.
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
    samples = [
        _Aircraft(aircraft, cell, path_cells(t, drift), case, step)
        for aircraft, (cell, t, drift) in enumerate(zip(cells, paths.times, paths.drift_n, strict=True))
    ]
    extremes = {limit: np.array([sample.extremes[limit][0] for sample in samples]) for limit in LIMITS}
    excess = {limit: _excess(limit, extremes[limit], case.limits) for limit in LIMITS}
    for limit, unit in LIMITS.items():
        for aircraft in np.flatnonzero(~(excess[limit] <= allowed.of_limit(limit))):
            worst_time = samples[aircraft].extremes[limit][1]
            breaches.append(Breach(limit, (int(aircraft),), float(excess[limit][aircraft]), unit, worst_time))
    for aircraft, sample in enumerate(samples):
        for volume in np.flatnonzero(~(sample.keep_out[:, 0] >= -allowed.position)):
            inside, worst_time = sample.keep_out[volume]
            breaches.append(Breach("keep_out", (aircraft, int(volume)), float(-inside), "m", float(worst_time)))
    pairs = least_clearances(
        cells,
        [sample.blocks for sample in samples],
        paths.times[:, -1],
        (case.separation_horizontal, case.separation_vertical),
        float(case.starts.time),
        step,
    )
    for k in np.flatnonzero(~(pairs.clearance >= -allowed.position)):
        aircraft = (int(pairs.first[k]), int(pairs.second[k]))
        breaches.append(Breach("separation", aircraft, float(-pairs.clearance[k]), "m", float(pairs.time[k])))
    breaches += _start_breaches(paths.times[:, 0], ground[:, 0], case, allowed)
    breaches += _jumps(paths.times, ground, allowed)
    miss, late = _arrival(paths.times[:, -1], ground[:, -1], case, arrival_times, allowed)
    breaches += late + check_rule(case.rule, arrival_times, allowed.time)
    clearances = np.array([sample.keep_out[:, 0] for sample in samples])
    wind_error = np.array([sample.wind_error for sample in samples])
    return PlanReport(extremes, excess, pairs, clearances, miss, wind_error, tuple(breaches))


def _no_pairs() -> PairReport:
    return least_clearances([], [], np.empty(0), (0.0, 0.0), 0.0, 1.0)


def _unusable(paths: Paths, arrival_times: Float[np.ndarray, " aircraft"]) -> tuple[Breach, ...]:
    finite = [np.isfinite(paths.times), np.isfinite(paths.air_n), np.isfinite(paths.drift_n)]
    good: Bool[np.ndarray, " aircraft"] = np.isfinite(arrival_times)
    for values in finite:
        good = good & values.reshape(values.shape[0], -1).all(axis=1)
    good = good & (np.diff(paths.times, axis=1) >= 0.0).all(axis=1) & (paths.times[:, -1] > paths.times[:, 0])
    return tuple(Breach("unusable", (int(aircraft),), np.inf, "-", np.nan) for aircraft in np.flatnonzero(~good))


class _Aircraft:
    """Reduced samples of one aircraft: extremes with their times, keep-out distances, and chords for the separation."""

    def __init__(self, aircraft: int, cells: PathCells, drift: PathCells, case: PlanCase, step: float) -> None:
        begin, end = cells.begin[0], cells.end[-1]
        count = int(np.floor((end - begin) / step + 1e-9)) + 1
        grid = np.minimum(begin + step * np.arange(count), end)
        samples = cells.at(grid)
        self.blocks = chord_blocks(samples[:3])
        self.extremes = {limit: (np.inf if limit in _LOWEST else -np.inf, np.nan) for limit in LIMITS}
        self.keep_out = np.full((case.keep_outs.radius.size, 2), np.inf)
        self.wind_error = 0.0
        self._case = case
        for start in range(0, count, _CHUNK):
            part = slice(start, start + _CHUNK)
            self._look(grid[part], samples[:, part])
        extra = _between(cells, step)
        at_extra = cells.at(extra)
        self._look(extra, at_extra)
        wind = case.wind.at(-at_extra[2])
        self.wind_error = float(np.max(np.linalg.norm(drift.at(extra)[3:6] - wind, axis=0)))

    def _look(self, time: Float[np.ndarray, " time"], motion: Float[np.ndarray, "9 time"]) -> None:
        case, altitude = self._case, -motion[2]
        demands = path_demands(motion[3:6], motion[6:9], case.wind.at(altitude), case.gravity)
        values = {
            "speed_min": demands.speed,
            "speed_max": demands.speed,
            "bank_max": np.abs(np.arctan2(demands.side, demands.normal)),
            "load_factor_max": np.hypot(demands.side, demands.normal) / case.gravity,
            "climb_rate_max": np.abs(demands.climb_rate),
            "altitude_min": altitude,
            "altitude_max": altitude,
            "acceleration_max": demands.along,
            "deceleration_max": -demands.along,
        }
        for limit, series in values.items():
            lowest = limit in _LOWEST
            at = int(np.argmin(series) if lowest else np.argmax(series))
            value, worst = float(series[at]), self.extremes[limit][0]
            # Written so that NaN, which argmin and argmax return, is stored and then violates the limit.
            if not np.isnan(worst) and not (value >= worst if lowest else value <= worst):
                self.extremes[limit] = (value, float(time[at]))
        for volume in range(self.keep_out.shape[0]):
            clearance = case.keep_outs.clearance(volume, time, motion[:3])
            at = int(np.argmin(clearance))
            if clearance[at] < self.keep_out[volume, 0]:
                self.keep_out[volume] = clearance[at], time[at]


def _between(cells: PathCells, step: float) -> Float[np.ndarray, " time"]:
    """Knots, and additional times within cells too short for the grid, s."""
    short = cells.end - cells.begin < _CELL_SAMPLES * step
    share = np.arange(1, _CELL_SAMPLES) / _CELL_SAMPLES
    inside = cells.begin[short, None] + share * (cells.end - cells.begin)[short, None]
    return np.sort(np.concatenate([cells.begin, cells.end[-1:], inside.ravel()]))


def _excess(limit: str, extreme: Float[np.ndarray, " aircraft"], limits: FleetLimits) -> Float[np.ndarray, " aircraft"]:
    bound = getattr(limits, limit)
    return bound - extreme if limit in _LOWEST else extreme - bound


def _start_breaches(
    begin: Float[np.ndarray, " aircraft"],
    first_states: Float[np.ndarray, "aircraft 3 3"],
    case: PlanCase,
    allowed: Tolerances,
) -> list[Breach]:
    required_states = np.stack([case.starts.position_n, case.starts.velocity_n, case.starts.acceleration_n], axis=1)
    deviation = np.linalg.norm(first_states - required_states, axis=2)
    breaches = [
        Breach(
            "start_time", (int(aircraft),), float(abs(begin[aircraft] - case.starts.time)), "s", float(begin[aircraft])
        )
        for aircraft in np.flatnonzero(~(np.abs(begin - case.starts.time) <= allowed.time))
    ]
    kinds = (("position", "m", allowed.position), ("velocity", "m/s", allowed.velocity))
    for order, (kind, unit, tolerance) in enumerate((*kinds, ("acceleration", "m/s^2", allowed.acceleration))):
        for aircraft in np.flatnonzero(~(deviation[:, order] <= tolerance)):
            breaches.append(
                Breach(
                    f"start_{kind}", (int(aircraft),), float(deviation[aircraft, order]), unit, float(begin[aircraft])
                )
            )
    return breaches


def _jumps(
    times: Float[np.ndarray, "aircraft knot"], ground: Float[np.ndarray, "aircraft knot 3 3"], allowed: Tolerances
) -> list[Breach]:
    """Jumps across empty cells; both ends of a non-empty cell are shared with its neighbours."""
    empty = np.diff(times, axis=1) <= EMPTY_S
    jump = np.linalg.norm(np.diff(ground, axis=1), axis=3) * empty[:, :, None]
    breaches = []
    kinds = (("position", "m", allowed.position), ("velocity", "m/s", allowed.velocity))
    for order, (kind, unit, tolerance) in enumerate((*kinds, ("acceleration", "m/s^2", allowed.acceleration))):
        at = np.argmax(jump[:, :, order], axis=1)
        worst = np.take_along_axis(jump[:, :, order], at[:, None], axis=1)[:, 0]
        for aircraft in np.flatnonzero(~(worst <= tolerance)):
            breaches.append(
                Breach(
                    f"jump_{kind}", (int(aircraft),), float(worst[aircraft]), unit, float(times[aircraft, at[aircraft]])
                )
            )
    return breaches


def _arrival(
    end: Float[np.ndarray, " aircraft"],
    last_states: Float[np.ndarray, "aircraft 3 3"],
    case: PlanCase,
    arrival_times: Float[np.ndarray, " aircraft"],
    allowed: Tolerances,
) -> tuple[Float[np.ndarray, " aircraft"], list[Breach]]:
    """Distance from each rendezvous, and the breaches at the arrivals."""
    breaches, miss = [], np.empty(end.size)
    for aircraft in range(end.size):
        claimed = float(arrival_times[aircraft])

        def note(
            kind: str, amount: float, unit: str, tolerance: float, aircraft: int = aircraft, time: float = claimed
        ) -> None:
            if not amount <= tolerance:
                breaches.append(Breach(kind, (aircraft,), amount, unit, time))

        meeting = case.goals.meeting_n(aircraft, arrival_times[aircraft : aircraft + 1])[0]
        miss[aircraft] = np.linalg.norm(last_states[aircraft, 0] - meeting)
        note("arrival_time", float(abs(end[aircraft] - claimed)), "s", allowed.time)
        note("arrival_position", float(miss[aircraft]), "m", allowed.position)
        north, east, down = last_states[aircraft, 1]
        course, path_angle = case.goals.course[aircraft], case.goals.path_angle[aircraft]
        if np.isfinite(course):
            course_error = np.remainder(np.arctan2(east, north) - course + np.pi, 2.0 * np.pi) - np.pi
            note("arrival_course", float(abs(course_error)), "rad", allowed.angle)
        if np.isfinite(path_angle):
            note(
                "arrival_path_angle",
                float(abs(np.arctan2(-down, np.hypot(north, east)) - path_angle)),
                "rad",
                allowed.angle,
            )
    return miss, breaches


def check_rule(rule: ArrivalRule, arrival_times: Float[np.ndarray, " aircraft"], tolerance: float) -> list[Breach]:
    """Breaches of the fleet's arrival rule by arrival times, s; for "earliest", optimality is not checked."""
    if rule.name in ("together", "earliest"):
        deviation = arrival_times - arrival_times[0]
    elif rule.name in ("at", "times"):
        deviation = arrival_times - rule.times
    elif rule.name == "sequence":
        in_order = arrival_times - rule.spacing * rule.ranks()
        deviation = in_order - in_order[rule.order[0]]
    else:
        early, late = rule.windows.T
        deviation = np.maximum(np.maximum(early - arrival_times, arrival_times - late), 0.0)
    return [
        Breach("arrival_rule", (int(aircraft),), float(abs(deviation[aircraft])), "s", float(arrival_times[aircraft]))
        for aircraft in np.flatnonzero(~(np.abs(deviation) <= tolerance))
    ]
