"""What an aircraft knows of its goal: the reading of its sensor, and the goal's motion recovered from it."""

import equinox as eqx
import jax.numpy as jnp

from anser.environment import AbstractEarth
from anser.planning import GoalMotion, LineOfSight, measure, recover
from anser.shapes import ScalarLike, Vector3


class Sensed(eqx.Module):
    """The sensor's reading, and the goal's place (m) and velocity (m/s) in the Earth's chart recovered from it."""

    sight: LineOfSight
    goal_position_n: Vector3
    goal_velocity_n: Vector3


def sense(earth: AbstractEarth, goal: GoalMotion, time: ScalarLike, position_n: Vector3, velocity_n: Vector3) -> Sensed:
    """Read the line-of-sight sensor of one aircraft and recover the goal's motion (theory section 7).

    The sensor looks along a straight line through space and gives its direction and rates in the NED axes of the
    aircraft's place.

    Parameters
    ----------
    earth
        The Earth with its chart.
    goal
        True motion of the goal, in the chart.
    time
        s.
    position_n, velocity_n
        Own place in the chart (3,), m, and velocity over ground (3,), NED, m/s.
    """
    line_n, goal_over_ground_n = earth.sight(position_n, goal.position_n(time), goal.velocity_n(time))
    here_n = jnp.zeros(3)
    sight = measure(here_n, velocity_n, line_n, goal_over_ground_n)
    seen_line_n, seen_velocity_n = recover(sight, here_n, velocity_n)
    return Sensed(sight, *earth.charted(position_n, seen_line_n, seen_velocity_n))
