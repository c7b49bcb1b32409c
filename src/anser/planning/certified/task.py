"""The planning problem: each aircraft's start, goal and limits, the shared airspace, and the arrival rule."""

from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from anser.environment.environment import AbstractWind
from anser.numerics.arrays import namespace
from anser.parts.planners import Rendezvous
from anser.planning.limits import PathLimits
from anser.planning.separation import Separation
from anser.shapes import Scalar, ScalarLike, Vector3


class AircraftTask(eqx.Module):
    """Planning problem of one aircraft: start, goal and flight limits; with a leading axis, of a fleet."""

    # start: position, velocity relative to the air and its rate; NED, m, m/s, m/s^2
    position_n: Vector3
    air_velocity_n: Vector3
    air_acceleration_n: Vector3
    # goal at the start of the plan, which moves at constant velocity; NED, m, m/s
    goal_position_n: Vector3
    goal_velocity_n: Vector3
    rendezvous: Rendezvous  # stand-off and arrival conditions at the goal
    speed: Scalar  # preferred mean airspeed, m/s
    side: Int[Array, ""]  # side of detours: positive right, negative left, 0 either
    limits: PathLimits  # flight limits of the path
    roll_rate_max: Scalar  # rad/s
    active: Scalar  # 1; 0 for an aircraft that gets no plan and does not constrain the other aircraft

    @property
    def rendezvous_n(self) -> Vector3:
        """Position of the rendezvous at the start of the plan, NED, m."""
        xp = namespace(self)
        return xp.asarray(self.goal_position_n) + xp.asarray(self.rendezvous.stand_off_n)

    def meeting_n(self, elapsed: ScalarLike) -> Vector3:
        """Return the position of the rendezvous `elapsed` seconds after the start of the plan, NED, m."""
        return self.goal_position_n + self.goal_velocity_n * elapsed + self.rendezvous.stand_off_n


class KeepOuts(eqx.Module):
    """Vertical cylinders, at rest or at a steady velocity, that no certified path enters; the arrays may be empty."""

    position_n: Float[Array, "volumes 2"]  #: Position of the axis at time 0, north and east, m.
    velocity_n: Float[Array, "volumes 2"]  #: Velocity of the axis, north and east, m/s.
    radius: Float[Array, " volumes"]  #: Radius, m.
    bottom: Float[Array, " volumes"]  #: Altitude of the bottom, m.
    top: Float[Array, " volumes"]  #: Altitude of the top, m.


class Airspace(eqx.Module):
    """Wind, gravity, required separation and keep-outs, shared by the aircraft of a fleet."""

    wind: AbstractWind  #: Steady or layered wind, or layers fitted to a field.
    gravity: Scalar  #: Acceleration of gravity, m/s^2.
    separation: Separation  #: Required distances between the aircraft.
    keep_outs: KeepOuts  #: Volumes that no path may enter.

    def at_start(self, time: ScalarLike) -> "Airspace":
        """Return the airspace with the keep-outs moved to their positions at a time (s), the start of a plan."""
        volumes = self.keep_outs
        return eqx.tree_at(lambda a: a.keep_outs.position_n, self, volumes.position_n + time * volumes.velocity_n)


ArrivalTimes = Float[np.ndarray, " aircraft"]
Intervals = list[tuple[float, float]]
"""Intervals of time as pairs (first, last), s."""


@dataclass(frozen=True)
class ArrivalRequest:
    """Arrival rule of a fleet, and its times in s after the start of the plan."""

    #: "together": a common time, preferably the time at which the last aircraft can arrive at its preferred airspeed,
    #: or later. "earliest": the earliest feasible common time. "at": a prescribed common time. "sequence": prescribed
    #: delays after the first arrival, whose time is chosen as for "together". "times": a prescribed time per aircraft.
    #: "windows": a window per aircraft.
    rule: str
    latest_s: float  #: Latest allowed arrival time, s after the start of the plan.
    times_s: ArrivalTimes | None = None  #: For "at" and "times": arrival time per aircraft, s.
    offsets_s: ArrivalTimes | None = None  #: For "sequence": delay after the first arrival per aircraft, s.
    #: For "windows": earliest and latest arrival time per aircraft, shape (aircraft, 2), s.
    windows_s: Float[np.ndarray, "aircraft 2"] | None = None

    def offsets(self, count: int) -> ArrivalTimes:
        """Return the required delay of each of `count` aircraft after the first arrival, s; 0 except for "sequence"."""
        return np.zeros(count) if self.offsets_s is None else self.offsets_s
