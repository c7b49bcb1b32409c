"""One aircraft's path as a cubic spline in time: what the second search varies."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from anser.verification.plan_data import PlanCase
from anser.verification.plan_motion import path_demands

__all__ = ["SplineFlight", "StepTerms", "Unknowns"]

_SEEN_PER_CELL = 4
"""Instants per spline cell at which limits are looked at; doubled where a path breaks one in between."""
_SEEN_MOST = 8
_SCALES = (5.0, 5.0, 1.0, 1.0, 2.0, 50.0, 50.0, 0.3)
"""Violations that weigh the same: speed low and high (m/s), bank and load (m/s^2), climb (m/s), floor and ceiling (m),
along the path (m/s^2)."""
_DISTANCE_SCALE = 200.0
"""The same for keep-outs and separation, m."""
_MARGINS = (0.03, 0.03, 0.005, 0.005, 0.02, 0.5, 0.5, 0.005)
"""How far inside each limit the search aims, units as _SCALES: between samples nothing then reaches the limit."""
_EXCESS_SHARE = 1.3
"""Margin added where a path broke a limit between samples, as a share of the excess."""
_DISTANCE_MARGIN = 2.0
"""The same for keep-outs, m."""
_NUDGE = 1e-5
"""Step of the difference quotients, in m/s and m/s^2; of altitude 100 times that, m."""

Unknowns = Float[np.ndarray, " unknown"]
StepTerms = tuple[float, Float[np.ndarray, "row unknown"], Float[np.ndarray, " row"]]
"""Cost, Jacobian and residual of what is violated."""


class Rows(NamedTuple):
    """How positions, velocities or accelerations at some times follow from the unknowns."""

    slope: Float[np.ndarray, "3 time unknown"]
    basis: Float[np.ndarray, "coefficient time"]


class SplineFlight:
    """Paths of one aircraft that start as it does and end at its rendezvous at a given time, whatever the unknowns.

    Parameters
    ----------
    case, who, arrival
        The task, the aircraft, and its arrival time, s.
    stamps
        Times at which keep-outs are looked at and separation may be, s, from the start on; those after the arrival are
        left out.

    Notes
    -----
    Uniform cubic B-splines: position, velocity and acceleration at both ends are linear in three coefficients each.
    Those of the start are given, as is the last position; the velocity (with a prescribed course: its size along it
    and, if the path angle is free, its climb) and acceleration at arrival are unknowns beside the coefficients
    between.
    """

    def __init__(
        self,
        case: PlanCase,
        who: int,
        arrival: float,
        stamps: Float[np.ndarray, " time"],
        seen_per_cell: int = _SEEN_PER_CELL,
    ) -> None:
        self.case, self.who, self.arrival = case, who, arrival
        self.seen_per_cell = seen_per_cell
        begin = case.starts.time
        limits = case.limits
        cruise = 0.5 * (limits.speed_min[who] + limits.speed_max[who])
        whole_turn = 2.0 * np.pi * cruise / (case.gravity * np.tan(min(float(limits.bank_max[who]), 1.5)))
        flown = arrival - begin
        self.cells = int(np.clip(np.ceil(flown / np.clip(whole_turn / 12.0, 2.5, 8.0)), 8, 72))
        self.width = flown / self.cells
        count = self.cells * seen_per_cell
        self.seen = begin + flown * np.arange(count + 1) / count
        self.stamps = stamps[stamps <= arrival]
        self._join(case.goals.meeting_n(who, np.array([arrival]))[0])
        self._whiten()
        self.P, self.V, self.A = (self._rows(self.seen, order) for order in range(3))
        self.S = self._rows(self.stamps, 0)
        tan_bank, load = float(np.tan(limits.bank_max[who])), float(limits.load_factor_max[who])
        share = min(1.0, float(limits.speed_max[who] - limits.speed_min[who]))
        self.margins = np.array(_MARGINS) * np.array([share, share, tan_bank * case.gravity, case.gravity, 1, 1, 1, 1])
        self.margins[3] = min(self.margins[3], 0.2 * (load - 1.0) * case.gravity)
        self._flatten = np.array([
            limits.speed_min[who], limits.speed_max[who], np.tan(limits.bank_max[who]), limits.load_factor_max[who],
            limits.climb_rate_max[who], limits.altitude_min[who], limits.altitude_max[who],
            limits.acceleration_max[who], limits.deceleration_max[who],
        ])  # fmt: skip

    def _join(self, meeting: Float[np.ndarray, "3"]) -> None:
        """Linear maps from unknowns to B-spline coefficients per axis."""
        n, h, who = self.cells, self.width, self.who
        ends = np.array([[1 / 6, 4 / 6, 1 / 6], [-0.5 / h, 0.0, 0.5 / h], [1 / h**2, -2 / h**2, 1 / h**2]])
        back = np.linalg.inv(ends)
        starts = self.case.starts
        fixed = np.zeros((n + 3, 3))
        fixed[:3] = back @ np.stack([starts.position_n[who], starts.velocity_n[who], starts.acceleration_n[who]])
        fixed[n:] = back[:, :1] * meeting
        per_axis = np.zeros((n + 3, n - 1))
        per_axis[3:n, : n - 3] = np.eye(n - 3)
        per_axis[n:, n - 3 :] = back[:, 1:] / np.array([h, h**2])
        course, angle = self.case.goals.course[who], self.case.goals.path_angle[who]
        free = np.eye(3 * (n - 1))
        if np.isfinite(course) or np.isfinite(angle):
            last = np.array([n - 3, 2 * (n - 1) - 2, 3 * (n - 1) - 2])
            chi = course if np.isfinite(course) else float(np.arctan2(*(meeting - starts.position_n[who])[1::-1]))
            gamma = angle if np.isfinite(angle) else 0.0
            along = np.array([np.cos(gamma) * np.cos(chi), np.cos(gamma) * np.sin(chi), -np.sin(gamma)])
            kept = np.zeros((3 * (n - 1), 2))
            kept[last, 0] = along
            kept[last[2], 1] = 1.0
            others = np.delete(free, last, axis=1)
            free = np.concatenate([others, kept[:, : 1 if np.isfinite(angle) else 2]], axis=1)
        self.coefficients = (np.kron(np.eye(3), per_axis) @ free).reshape(3, n + 3, free.shape[1])
        self.fixed = fixed.T

    def _rows(self, times: Float[np.ndarray, " time"], order: int) -> Rows:
        """Slope of position, velocity or acceleration at times with the unknowns, and the splines' own values."""
        share = (times - self.case.starts.time) / self.width
        cell = np.clip(np.floor(share).astype(int), 0, self.cells - 1)
        u = share - cell
        v = 1.0 - u
        shapes = (
            [v**3 / 6, (3 * u**3 - 6 * u**2 + 4) / 6, (3 * v**3 - 6 * v**2 + 4) / 6, u**3 / 6],
            [-(v**2) / 2, (3 * u**2 - 4 * u) / 2, -(3 * v**2 - 4 * v) / 2, u**2 / 2],
            [v, 3 * u - 2, 3 * v - 2, u],
        )
        basis = np.zeros((times.size, self.cells + 3))
        for k in range(4):
            basis[np.arange(times.size), cell + k] = shapes[order][k] / self.width**order
        return Rows(basis @ self.coefficients, basis.T)

    def _whiten(self) -> None:
        """Scale and mix the unknowns so that a step's size is what an aircraft feels of it.

        The size of a step is the root mean square of its changes of place by 3,000 m, velocity by 30 m/s and
        acceleration by 3 m/s^2: a step damped by its size bends the whole path smoothly.
        """
        # At instants that do not depend on how closely limits are looked at: the unknowns then mean the same.
        count = self.cells * _SEEN_PER_CELL
        times = self.case.starts.time + self.width * self.cells * np.arange(count + 1) / count
        metric = np.zeros((self.coefficients.shape[2],) * 2)
        for order, weight in enumerate((3000.0, 30.0, 3.0)):
            slope = self._rows(times, order).slope / weight
            flat = slope.reshape(-1, slope.shape[2])
            metric += flat.T @ flat / times.size
        self.coefficients = self.coefficients @ np.linalg.inv(np.linalg.cholesky(metric)).T

    def positions(self, x: Unknowns, rows: Rows | None = None) -> Float[np.ndarray, "3 time"]:
        """Position at the stamps, NED, m; or what other rows stand for."""
        return (self.fixed + self.coefficients @ x) @ (self.S if rows is None else rows).basis

    def _violations(
        self, height: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> Float[np.ndarray, "limit ..."]:
        """Scaled excess over each limit with its margin; positive is violated."""
        low, high, tan_bank, load, climb, floor, ceiling, faster, slower = self._flatten
        g = self.case.gravity
        asked = path_demands(velocity, acceleration, self.case.wind.at(height), g)
        excess = [
            low - asked.speed,
            asked.speed - high,
            np.abs(asked.side) - tan_bank * asked.normal,
            np.hypot(asked.side, asked.normal) - load * g,
            np.abs(asked.climb_rate) - climb,
            floor - height,
            height - ceiling,
            np.maximum(asked.along - faster, -asked.along - slower),
        ]
        each = zip(excess, self.margins, _SCALES, strict=True)
        return np.stack([(part + margin) / scale for part, margin, scale in each])

    def residual(self, x: Unknowns) -> float:
        """Half the sum of squares of what is violated."""
        now = self._violations(-self.positions(x, self.P)[2], self.positions(x, self.V), self.positions(x, self.A))
        return 0.5 * float(np.sum(np.maximum(now, 0.0) ** 2)) + 0.5 * float(np.sum(self._keep_out(x)[0] ** 2))

    def linearize(self, x: Unknowns) -> StepTerms:
        """Cost, Jacobian and residual of all that is violated."""
        p, v, a = (self.positions(x, rows) for rows in (self.P, self.V, self.A))
        height = -p[2]
        nudge = np.zeros((7, 8, 1))
        nudge[np.arange(7), np.arange(1, 8), 0] = [100.0 * _NUDGE] + [_NUDGE] * 6
        all_violations = self._violations(height + nudge[0], v[:, None] + nudge[1:4], a[:, None] + nudge[4:7])
        now = all_violations[:, 0]
        slope = (all_violations[:, 1:] - now[:, None]) / nudge[np.arange(7), np.arange(1, 8)]
        kind, at = np.nonzero(now > 0.0)
        by = slope[kind, :, at]
        rows = -by[:, :1] * self.P.slope[2, at]
        for axis in range(3):
            rows += by[:, 1 + axis, None] * self.V.slope[axis, at] + by[:, 4 + axis, None] * self.A.slope[axis, at]
        depth, stamp, direction = self._keep_out(x)
        rows = np.concatenate([rows, np.einsum("ka,aku->ku", direction, self.S.slope[:, stamp])])
        values = np.concatenate([now[kind, at], depth])
        return 0.5 * float(values @ values), rows, values

    def _keep_out(self, x: Unknowns) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Scaled depth inside keep-outs, the stamps at which, and its slope with position."""
        zones, limits, who = self.case.keep_outs, self.case.limits, self.who
        depths, stamps, slopes = [np.empty(0)], [np.empty(0, dtype=int)], [np.empty((0, 3))]
        if zones.radius.size == 0:
            return depths[0], stamps[0], slopes[0]
        p, margin = self.positions(x), _DISTANCE_MARGIN
        for k in range(zones.radius.size):
            far = np.stack([p[i] - zones.position_n[k, i] - zones.velocity_n[k, i] * self.stamps for i in range(2)])
            at = np.flatnonzero(
                (far[0] ** 2 + far[1] ** 2 < (zones.radius[k] + margin) ** 2)
                & (-p[2] > zones.bottom[k] - margin)
                & (-p[2] < zones.top[k] + margin)
            )
            if at.size == 0:
                continue
            flat = np.maximum(np.hypot(far[0, at], far[1, at]), 1e-6)
            below = zones.bottom[k] > limits.altitude_min[who] + 50.0
            above = zones.top[k] < limits.altitude_max[who] - 50.0
            ways = np.full((3, at.size), np.inf)
            ways[0] = zones.radius[k] + margin - flat
            ways[1] = -p[2, at] - zones.bottom[k] + margin if below else np.inf
            ways[2] = zones.top[k] + p[2, at] + margin if above else np.inf
            # Height is dearer than width: three metres aside for one up.
            way = np.argmin(ways * np.array([[1.0], [3.0], [3.0]]), axis=0)
            out = np.zeros((at.size, 3))
            out[:, :2] = np.where(way == 0, -far[:, at] / flat, 0.0).T
            out[:, 2] = np.array([0.0, -1.0, 1.0])[way]
            depths.append(ways[way, np.arange(at.size)] / _DISTANCE_SCALE)
            stamps.append(at)
            slopes.append(out / _DISTANCE_SCALE)
        return np.concatenate(depths), np.concatenate(stamps), np.concatenate(slopes)

    def tightened(self, excess: dict[str, float]) -> "SplineFlight":
        """Return the same flight, looked at more closely, with more margin where a path broke a limit between samples.

        Parameters
        ----------
        excess
            By limit, as in `PlanReport.excess`: how far the path went beyond.
        """
        beyond = {limit: _EXCESS_SHARE * max(value, 0.0) for limit, value in excess.items()}
        gravity, tan_bank = self.case.gravity, self._flatten[2]
        more = [
            beyond["speed_min"], beyond["speed_max"], beyond["bank_max"] * gravity * (1.0 + tan_bank**2),
            beyond["load_factor_max"] * gravity, beyond["climb_rate_max"], beyond["altitude_min"],
            beyond["altitude_max"], max(beyond["acceleration_max"], beyond["deceleration_max"]),
        ]  # fmt: skip
        halves = np.sort(np.concatenate([self.stamps, 0.5 * (self.stamps[1:] + self.stamps[:-1])]))
        closer = min(2 * self.seen_per_cell, _SEEN_MOST)
        other = SplineFlight(self.case, self.who, self.arrival, halves, closer)
        other.margins = self.margins + np.array(more)
        return other

    def knots(self, x: Unknowns) -> tuple[Float[np.ndarray, " knot"], Float[np.ndarray, "knot 3 3"]]:
        """Times and [order, axis] of the path at the spline's knots: cubic between them, so exact as quintic cells."""
        times = self.seen[:: self.seen_per_cell]
        motion = np.stack([self.positions(x, rows)[:, :: self.seen_per_cell] for rows in (self.P, self.V, self.A)])
        return times, motion.transpose(2, 0, 1)
