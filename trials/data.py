"""A planning task and its answer in plain numbers, for the independent checker without code of the planner."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

__all__ = ["ArrivalRule", "FleetLimits", "Goals", "KeepOutCylinders", "Paths", "PlanCase", "Starts", "WindProfile"]

RULES = ("together", "earliest", "at", "sequence", "times", "windows")


@dataclass(frozen=True)
class FleetLimits:
    """Flight limits of each aircraft; see `trials.motion.path_demands` for the quantities."""

    speed_min: Float[np.ndarray, " aircraft"]
    """True airspeed, m/s."""
    speed_max: Float[np.ndarray, " aircraft"]
    """True airspeed, m/s."""
    bank_max: Float[np.ndarray, " aircraft"]
    """Bank angle, rad."""
    climb_rate_max: Float[np.ndarray, " aircraft"]
    """Up or down, relative to the air, m/s."""
    altitude_min: Float[np.ndarray, " aircraft"]
    """Altitude, m."""
    altitude_max: Float[np.ndarray, " aircraft"]
    """m."""
    load_factor_max: Float[np.ndarray, " aircraft"]
    """-."""
    acceleration_max: Float[np.ndarray, " aircraft"]
    """Along the path, including gravity's component, m/s^2."""
    deceleration_max: Float[np.ndarray, " aircraft"]
    """Along the path, including gravity's component, positive, m/s^2."""


@dataclass(frozen=True)
class WindProfile:
    """Wind by altitude: linear between layers, constant beyond the end layers; one layer is steady wind."""

    altitudes: Float[np.ndarray, " layer"]
    """m, rising."""
    velocities_n: Float[np.ndarray, "layer 3"]
    """Velocity of the air, NED, m/s."""

    def at(self, altitude: Float[np.ndarray, "..."]) -> Float[np.ndarray, "3 ..."]:
        """Velocity of the air, NED, m/s, components first, at altitudes, m."""
        if self.altitudes.size == 1:
            return np.broadcast_to(self.velocities_n[0].reshape((3,) + (1,) * altitude.ndim), (3, *altitude.shape))
        return np.stack([np.interp(altitude, self.altitudes, self.velocities_n[:, k]) for k in range(3)])


@dataclass(frozen=True)
class Goals:
    """Motion of the goals (straight legs between timed waypoints, then constant velocity) and arrival conditions."""

    times: Float[np.ndarray, "aircraft waypoint"]
    """s, not decreasing."""
    positions_n: Float[np.ndarray, "aircraft waypoint 3"]
    """NED, m."""
    velocity_after_n: Float[np.ndarray, "aircraft 3"]
    """NED, m/s."""
    stand_off_n: Float[np.ndarray, "aircraft 3"]
    """From the goal to the rendezvous, NED, m."""
    course: Float[np.ndarray, " aircraft"]
    """Course over the ground at arrival, rad; NaN where free."""
    path_angle: Float[np.ndarray, " aircraft"]
    """Path angle over the ground at arrival, up positive, rad; NaN where free."""

    def meeting_n(self, aircraft: int, time: Float[np.ndarray, " time"]) -> Float[np.ndarray, "time 3"]:
        """Rendezvous of one aircraft at times (s): position of its goal plus stand-off, NED, m."""
        stamps, positions = self.times[aircraft], self.positions_n[aircraft]
        later = np.maximum(time - stamps[-1], 0.0)[:, None] * self.velocity_after_n[aircraft]
        inside = np.stack([np.interp(time, stamps, positions[:, k]) for k in range(3)], axis=1)
        return inside + later + self.stand_off_n[aircraft]

    def speed_max(self, aircraft: int) -> float:
        """Greatest speed of one goal over time, m/s."""
        spans = np.diff(self.times[aircraft])
        legs = np.linalg.norm(np.diff(self.positions_n[aircraft], axis=0), axis=1)
        moving = legs[spans > 0.0] / spans[spans > 0.0]
        return float(max([np.linalg.norm(self.velocity_after_n[aircraft]), *moving]))


@dataclass(frozen=True)
class KeepOutCylinders:
    """Upright cylinders to avoid, at rest or moving steadily."""

    position_n: Float[np.ndarray, "keep_out 2"]
    """North and east at time 0, m."""
    velocity_n: Float[np.ndarray, "keep_out 2"]
    """m/s."""
    radius: Float[np.ndarray, " keep_out"]
    """m."""
    bottom: Float[np.ndarray, " keep_out"]
    """Altitude, m."""
    top: Float[np.ndarray, " keep_out"]
    """Altitude, m."""

    def clearance(
        self, volume: int, time: Float[np.ndarray, "..."], position_n: Float[np.ndarray, "3 ..."]
    ) -> Float[np.ndarray, "..."]:
        """Distance of a point from a cylinder, m; negative inside. The components of the position come first."""
        centre = [self.position_n[volume, k] + self.velocity_n[volume, k] * time for k in range(2)]
        outside = np.hypot(position_n[0] - centre[0], position_n[1] - centre[1]) - self.radius[volume]
        altitude = -position_n[2]
        return np.maximum(outside, np.maximum(self.bottom[volume] - altitude, altitude - self.top[volume]))


@dataclass(frozen=True)
class Starts:
    """Initial state of each aircraft."""

    time: float
    """s."""
    position_n: Float[np.ndarray, "aircraft 3"]
    """NED, m."""
    velocity_n: Float[np.ndarray, "aircraft 3"]
    """Over the ground, NED, m/s."""
    acceleration_n: Float[np.ndarray, "aircraft 3"]
    """NED, m/s^2."""


@dataclass(frozen=True)
class ArrivalRule:
    """Arrival rule; unused fields are NaN or empty."""

    name: str
    """One of RULES."""
    times: Float[np.ndarray, " aircraft"]
    """Rules "at" and "times", s."""
    windows: Float[np.ndarray, "aircraft 2"]
    """Rule "windows", s."""
    spacing: float
    """Rule "sequence", s."""
    order: Int[np.ndarray, " aircraft"]
    """Rule "sequence": aircraft in order of arrival."""

    def __post_init__(self) -> None:
        if self.name not in RULES:
            raise ValueError(f"arrival rule: arrived {self.name!r}; expected one of {', '.join(RULES)}")

    def ranks(self) -> Int[np.ndarray, " aircraft"]:
        """Position of each aircraft in the sequence, starting at 0."""
        return np.argsort(self.order)


@dataclass(frozen=True)
class PlanCase:
    """A planning task."""

    starts: Starts
    goals: Goals
    limits: FleetLimits
    wind: WindProfile
    keep_outs: KeepOutCylinders
    separation_horizontal: float
    """m; 0: not asked."""
    separation_vertical: float
    """m; 0: not asked."""
    rule: ArrivalRule
    speed: float
    """Preferred airspeed of the fleet, m/s; used by the rules "together" and "windows"."""
    gravity: float
    """m/s^2."""
    seed: int = -1
    """Seed of a random case; -1 for other cases."""

    @property
    def size(self) -> int:
        """Number of aircraft."""
        return self.starts.position_n.shape[0]


@dataclass(frozen=True)
class Paths:
    """Delivered paths, as in `planning.TimedPath`: quintic between knots in every cell."""

    times: Float[np.ndarray, "aircraft knot"]
    """s, not decreasing."""
    air_n: Float[np.ndarray, "aircraft knot 3 3"]
    """[.., order of the derivative, NED axis]: path relative to the air, m, m/s, m/s^2."""
    drift_n: Float[np.ndarray, "aircraft knot 3 3"]
    """The same of the drift of the air; both together are the path over the ground."""
