"""What a dense check of a plan found."""

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
    """By how much a plan may miss and still pass.

    A plan is computed in float64 with positions up to 1e5 m: rounding is 1e-11 m, and 1e-5 m/s^2 in the second
    derivative of a cell of 10 ms. Each figure is a hundred times that or more, and below what any sensor resolves, so
    that nothing passes but what a limit met exactly leaves to rounding and to solvers stopped at 1e-9.
    """

    position: float = 1e-3
    """Start, jumps, floor, ceiling, separation, keep-outs and arrival, m: issue 5 asks for 1 mm."""
    velocity: float = 1e-3
    """Speed window, climb rate, start and jumps, m/s."""
    acceleration: float = 1e-3
    """Along the path, start and jumps, m/s^2."""
    angle: float = 1e-4
    """Bank, course and path angle at arrival, rad: 1e-3 m/s^2 across g, 1e-3 m/s across 100 m/s with room."""
    load_factor: float = 1e-4
    """1e-3 m/s^2 of g."""
    time: float = 1e-3
    """Arrival, s: issue 5 asks for 1 ms."""

    def of_limit(self, limit: str) -> float:
        """Tolerance of one of LIMITS, in its unit."""
        kinds = {"rad": self.angle, "-": self.load_factor, "m/s": self.velocity, "m": self.position}
        return kinds.get(LIMITS[limit], self.acceleration)


@dataclass(frozen=True)
class Breach:
    """One thing that a plan breaks."""

    kind: str
    """A limit's name, or "separation", "keep_out", "start_position", "jump_velocity", "arrival_time", ..."""
    who: tuple[int, ...]
    """Aircraft, or both of a pair, or aircraft and keep-out."""
    amount: float
    """By how much, in `unit`; more than the tolerance. Infinite where the numbers are not finite."""
    unit: str
    time: float
    """When it is worst, s; NaN where it belongs to no instant."""

    def __str__(self) -> str:
        when = "" if np.isnan(self.time) else f" at {self.time:.3f} s"
        return f"{self.kind} of {', '.join(map(str, self.who))}: {self.amount:.6g} {self.unit}{when}"


@dataclass(frozen=True)
class PlanReport:
    """Figures of a plan; `breaches` is empty exactly where it passes."""

    extremes: dict[str, Float[np.ndarray, " aircraft"]]
    """By limit: the least or greatest value that the path asks for, in the limit's unit."""
    excess: dict[str, Float[np.ndarray, " aircraft"]]
    """By limit: how far the extreme lies beyond it; negative is the margin left."""
    pairs: PairReport
    keep_out_clearance: Float[np.ndarray, "aircraft keep_out"]
    """Least distance from being inside, m."""
    arrival_miss: Float[np.ndarray, " aircraft"]
    """Distance from the rendezvous at the arrival time, m."""
    wind_error: Float[np.ndarray, " aircraft"]
    """Greatest difference of the drift's slope from the wind at the aircraft, m/s: no limit, a figure of the fit."""
    breaches: tuple[Breach, ...]

    @property
    def passes(self) -> bool:
        """Whether nothing is broken."""
        return not self.breaches
