"""What is asked of the planner: where each aircraft is, where it must be, and within which limits."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from anser.environment.environment import AbstractWind
from anser.numerics.arrays import namespace
from anser.parts.planners import Rendezvous
from anser.planning.limits import PathLimits
from anser.planning.separation import Separation
from anser.shapes import Scalar, ScalarLike, Vector3


class AircraftTask(eqx.Module):
    """One aircraft that is to be planned; stacked, a fleet.

    Attributes
    ----------
    position_n
        Where its plan begins, NED, m.
    air_velocity_n, air_acceleration_n
        Velocity relative to the air there and its rate, NED, m/s and m/s^2.
    goal_position_n, goal_velocity_n
        Its goal at the start of the plan, foreseen at steady velocity, NED, m and m/s over the ground.
    rendezvous
        How it meets the goal.
    speed
        Mean airspeed that it prefers, m/s.
    side
        Side of its detours: positive right, negative left, 0 either.
    limits
        What its path may ask.
    roll_rate_max
        How fast its path changes the bank angle in a level turn, on the mean, rad/s; `limits` may ask for less.
    active
        0 for one that has stopped, or is there only to fill up a fleet to a size: nobody keeps clear of it, and
        whatever becomes of its path is no reason to refuse a plan.
    """

    position_n: Vector3
    air_velocity_n: Vector3
    air_acceleration_n: Vector3
    goal_position_n: Vector3
    goal_velocity_n: Vector3
    rendezvous: Rendezvous
    speed: Scalar
    side: Int[Array, ""]
    limits: PathLimits
    roll_rate_max: Scalar
    active: Scalar

    @property
    def rendezvous_n(self) -> Vector3:
        """Its rendezvous at the start of the plan, NED, m."""
        xp = namespace(self)
        return xp.asarray(self.goal_position_n) + xp.asarray(self.rendezvous.stand_off_n)

    def meeting_n(self, elapsed: ScalarLike) -> Vector3:
        """Its rendezvous after a time (s), NED, m."""
        return self.goal_position_n + self.goal_velocity_n * elapsed + self.rendezvous.stand_off_n


def stack_tasks(tasks: Sequence[AircraftTask]) -> AircraftTask:
    """A fleet of single tasks."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *tasks)


class KeepOuts(eqx.Module):
    """Cylinders that no aircraft enters, standing or moving at a steady velocity; stacked, possibly none.

    Attributes
    ----------
    position_n, velocity_n
        Axis at time 0, north and east, m and m/s.
    radius, bottom, top
        m; altitudes.
    """

    position_n: Float[Array, "volumes 2"]
    velocity_n: Float[Array, "volumes 2"]
    radius: Float[Array, " volumes"]
    bottom: Float[Array, " volumes"]
    top: Float[Array, " volumes"]


def no_keep_outs() -> KeepOuts:
    """None."""
    return KeepOuts(jnp.zeros((0, 2)), jnp.zeros((0, 2)), jnp.zeros(0), jnp.zeros(0), jnp.zeros(0))


class Airspace(eqx.Module):
    """What all aircraft share.

    Attributes
    ----------
    wind
        Steady or layered.
    gravity
        m/s^2.
    separation, keep_outs
        See there.
    """

    wind: AbstractWind
    gravity: Scalar
    separation: Separation
    keep_outs: KeepOuts


ARRIVAL_RULES = ("together", "earliest", "at", "sequence", "times", "windows")
ArrivalTimes = Float[np.ndarray, " aircraft"]
Intervals = list[tuple[float, float]]
"""Of times, s."""


@dataclass(frozen=True)
class ArrivalRequest:
    """When a fleet is to arrive.

    Attributes
    ----------
    rule
        One of `RULES`: "together" (one time: when the farthest can be there at its preferred speed, or as soon after it
        as a plan is found), "earliest" (the first that is found, see `anser.planning.certified.arrival_times`), "at" (a
        given one), "sequence" (one after another, as soon as for "together"), "times" (each at its own), "windows"
        (each within its own, as soon as it can be there at its preferred speed or a plan is found).
    latest_s
        No arrival is later than this, s.
    times_s
        For "at" and "times", one per aircraft, s after the start of the plan.
    offsets_s
        For "sequence": how long after the first each arrives, s; else None.
    windows_s
        For "windows": (aircraft, 2), s.
    """

    rule: str
    latest_s: float
    times_s: ArrivalTimes | None = None
    offsets_s: ArrivalTimes | None = None
    windows_s: Float[np.ndarray, "aircraft 2"] | None = None

    def offsets(self, count: int) -> ArrivalTimes:
        """How long after the first each of so many aircraft arrives, s."""
        return np.zeros(count) if self.offsets_s is None else self.offsets_s
