"""Report of a dense check of a plan."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from trials.separation import PairReport

__all__ = ["LIMITS", "Breach", "PlanReport", "Tolerances"]

LIMITS = {
    "speed_min": "m/s",
    "speed_max": "m/s",
    "bank_max": "rad",
    "load_factor_max": "-",
    "climb_rate_max": "m/s",
    "altitude_min": "m",
    "altitude_max": "m",
    "acceleration_max": "m/s^2",
    "deceleration_max": "m/s^2",
}
"""Limits of an aircraft, named as in `FleetLimits`, with their units."""


@dataclass(frozen=True)
class Tolerances:
    """Accepted deviations of a plan.

    A plan is computed in float64 with positions up to 1e5 m: rounding is 1e-11 m, and 1e-5 m/s^2 in the second
    derivative of a cell of 10 ms. Each tolerance is at least a hundred times that, and below the resolution of any
    sensor: it covers only rounding and the solvers' tolerance of 1e-9 at a limit that is met exactly.
    """

    position: float = 1e-3
    """Start, jumps, floor, ceiling, separation, keep-outs and arrival, m: 1 mm by issue 5."""
    velocity: float = 1e-3
    """Speed window, climb rate, start and jumps, m/s."""
    acceleration: float = 1e-3
    """Along the path, start and jumps, m/s^2."""
    angle: float = 1e-4
    """Bank, course and path angle at arrival, rad: 1e-3 m/s^2 across g, 1e-3 m/s across 100 m/s with room."""
    load_factor: float = 1e-4
    """1e-3 m/s^2 of g."""
    time: float = 1e-3
    """Arrival, s: 1 ms by issue 5."""

    def of_limit(self, limit: str) -> float:
        """Tolerance of one of LIMITS, in its unit."""
        kinds = {"rad": self.angle, "-": self.load_factor, "m/s": self.velocity, "m": self.position}
        return kinds.get(LIMITS[limit], self.acceleration)


@dataclass(frozen=True)
class Breach:
    """One violated requirement of a plan."""

    kind: str
    """A limit's name, or "separation", "keep_out", "start_position", "jump_velocity", "arrival_time", ..."""
    who: tuple[int, ...]
    """Aircraft, or both aircraft of a pair, or aircraft and keep-out."""
    amount: float
    """Excess in `unit`, above the tolerance. Infinite for non-finite numbers."""
    unit: str
    time: float
    """When it is worst, s; NaN where it belongs to no instant."""

    def __str__(self) -> str:
        when = "" if np.isnan(self.time) else f" at {self.time:.3f} s"
        return f"{self.kind} of {', '.join(map(str, self.who))}: {self.amount:.6g} {self.unit}{when}"


@dataclass(frozen=True)
class PlanReport:
    """Figures of a plan; `breaches` is empty if and only if the plan passes."""

    extremes: dict[str, Float[np.ndarray, " aircraft"]]
    """By limit: least or greatest value along the path, in the limit's unit."""
    excess: dict[str, Float[np.ndarray, " aircraft"]]
    """By limit: excess of the extreme over the limit; negative: margin."""
    pairs: PairReport
    keep_out_clearance: Float[np.ndarray, "aircraft keep_out"]
    """Least distance from each keep-out, m."""
    arrival_miss: Float[np.ndarray, " aircraft"]
    """Distance from the rendezvous at the arrival time, m."""
    wind_error: Float[np.ndarray, " aircraft"]
    """Greatest difference between the drift's slope and the wind at the aircraft, m/s; unlimited, measures the fit."""
    breaches: tuple[Breach, ...]

    @property
    def passes(self) -> bool:
        """Whether every requirement is satisfied."""
        return not self.breaches
