"""Motion of a goal: straight legs between timed waypoints."""

from collections.abc import Sequence
from types import ModuleType

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.arrays import as_array, namespace
from anser.shapes import ScalarLike, Vector3


class GoalMotion(eqx.Module):
    """Motion of a goal: at rest at the first waypoint, straight from waypoint to waypoint, then at steady velocity."""

    #: Time at each waypoint, s, in ascending order; waypoints repeated for padding have equal times.
    times: Float[Array, " waypoints"]
    positions_n: Float[Array, "waypoints 3"]  #: Waypoints, NED, m.
    velocity_after_n: Vector3  #: Velocity after the last waypoint, NED, m/s.

    def _arrays(self, time: ScalarLike) -> tuple[ModuleType, Array, Array, Array, Array]:
        """Return the array module of fields and `time`, the fields as its arrays, and each leg's velocity, m/s."""
        xp = namespace(self, time)
        times, positions_n, velocity_after_n = map(xp.asarray, (self.times, self.positions_n, self.velocity_after_n))
        spans, steps = times[1:] - times[:-1], positions_n[1:] - positions_n[:-1]
        leg_velocities = xp.where(spans > 0.0, 1.0 / xp.where(spans > 0.0, spans, 1.0), 0.0)[:, None] * steps
        return xp, times, positions_n, velocity_after_n, leg_velocities

    def position_n(self, time: ScalarLike) -> Vector3:
        """Return the position at a time (s), NED, m; before the first time, the first waypoint."""
        # Sum of the travelled parts of the legs: no search, and padded legs contribute 0.
        xp, times, positions_n, velocity_after_n, leg_velocities = self._arrays(time)
        covered = xp.clip(time - times[:-1], 0.0, times[1:] - times[:-1])
        travelled = xp.sum(covered[:, None] * leg_velocities, axis=0)
        return positions_n[0] + travelled + xp.maximum(time - times[-1], 0.0) * velocity_after_n

    def velocity_n(self, time: ScalarLike) -> Vector3:
        """Return the velocity at a time (s), NED, m/s; 0 before the first time; at a waypoint, the next leg counts."""
        xp, times, _, velocity_after_n, leg_velocities = self._arrays(time)
        on_leg = (time >= times[:-1]) & (time < times[1:])
        on_path = xp.sum(xp.where(on_leg[:, None], leg_velocities, 0.0), axis=0)
        return xp.where(time >= times[-1], velocity_after_n, on_path)


def straight_goal(position_n: Vector3, velocity_n: Vector3, time: ScalarLike = 0.0) -> GoalMotion:
    """Return the motion of a goal at rest at `position_n` (NED, m) until `time` (s), then at `velocity_n` (m/s)."""
    xp = namespace(position_n, time)
    return GoalMotion(as_array(xp.asarray(time)[None]), as_array(xp.asarray(position_n)[None]), velocity_n)


def waypoint_goal(
    times: Sequence[float] | Float[np.ndarray, " waypoints"] | Float[Array, " waypoints"],
    positions_n: Float[Array, "waypoints 3"],
    velocity_after_n: Vector3 | None = None,
) -> GoalMotion:
    """Return the motion of a goal that passes each waypoint at its time.

    Parameters
    ----------
    times
        Concrete strictly increasing times, s, one per waypoint.
    positions_n
        Waypoints, NED, m.
    velocity_after_n
        Velocity after the last waypoint, NED, m/s; None: the goal stops.

    Raises ValueError if there is no waypoint, the counts differ, or the times do not increase.
    """
    stamps = np.asarray(times, dtype=float)
    if stamps.ndim != 1 or stamps.size == 0 or stamps.size != positions_n.shape[0]:
        raise ValueError(
            f"{stamps.size} times and {positions_n.shape[0]} positions given; a goal needs one time per waypoint "
            "and at least one waypoint"
        )
    if not np.all(np.diff(stamps) > 0.0):
        raise ValueError(f"waypoint times {stamps.tolist()} do not strictly increase")
    final_velocity_n = as_array([0.0] * 3) if velocity_after_n is None else velocity_after_n
    return GoalMotion(as_array(stamps), positions_n, final_velocity_n)


def pad_waypoints(goal: GoalMotion, count: int) -> GoalMotion:
    """Repeat the last waypoint of a goal up to `count` waypoints; raise ValueError if the goal has more waypoints."""
    missing = count - goal.times.shape[0]
    if missing < 0:
        raise ValueError(f"the goal has {goal.times.shape[0]} waypoints, more than the {count} to pad it to")
    xp = namespace(goal)
    times, positions_n = (
        as_array(xp.concatenate([values, xp.repeat(values[-1:], missing, axis=0)]))
        for values in map(xp.asarray, (goal.times, goal.positions_n))
    )
    return GoalMotion(times, positions_n, goal.velocity_after_n)
