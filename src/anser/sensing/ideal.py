"""Ideal sensors: the true state without delay or error."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.environment import AbstractEarth
from anser.planning import LineOfSight, measure
from anser.sensing.interface import AbstractSensors, GoalState, Instant, Reading, Truth, velocity_over_ground_n
from anser.shapes import Vector3


class IdealSensors(AbstractSensors):
    """Neither noise nor delay; the goal is seen along a straight line through space (theory section 7)."""

    def init(self, truth: Truth, instant: Instant) -> None:
        """Nothing is kept."""

    def read(self, memory: None, truth: Truth, instant: Instant) -> tuple[Reading, None]:
        """The truth."""
        specific_force_b = truth.now.wrench.force_b / truth.airframe.mass_properties.mass
        sight = true_sight(truth, instant.environment.earth)
        return Reading(truth.state, truth.now, specific_force_b, sight, goal_sensor_works=truth.goal_sensor_works), None


def true_sight(truth: Truth, earth: AbstractEarth) -> LineOfSight | None:
    """Line of sight to the goal; None for an aircraft without one."""
    if truth.goal is None:
        return None
    velocity_n = velocity_over_ground_n(truth.now, truth.state)
    return line_of_sight(earth, truth.state.position_n, velocity_n, truth.goal)


def line_of_sight(earth: AbstractEarth, position_n: Vector3, velocity_n: Vector3, goal: GoalState) -> LineOfSight:
    """Straight line through space to a goal in the chart: its direction and rates in the NED axes of the own place.

    `position_n` is the own place in the chart (3,), m, `velocity_n` the own velocity over ground (3,), NED, m/s.
    """
    line_n, goal_over_ground_n = earth.sight(position_n, goal.position_n, goal.velocity_n)
    return measure(jnp.zeros_like(velocity_n), velocity_n, line_n, goal_over_ground_n)


def sight_values(sight: LineOfSight) -> Float[Array, "6"]:
    """Range (m), azimuth and elevation (rad), and their rates, in the order of `GoalReading`."""
    return jnp.stack(
        [
            sight.range,
            sight.azimuth,
            sight.elevation,
            sight.range_rate,
            sight.azimuth_rate,
            sight.elevation_rate,
        ]
    )
