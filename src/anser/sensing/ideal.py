"""Sensors that tell the truth at once."""

import jax.numpy as jnp

from anser.environment import AbstractEarth
from anser.planning import LineOfSight, measure
from anser.sensing.interface import AbstractSensors, Instant, Reading, Truth, velocity_over_ground_n


class IdealSensors(AbstractSensors):
    """Neither noise nor delay; the goal is seen along a straight line through space (theory section 7)."""

    def init(self, truth: Truth, instant: Instant) -> None:
        """Nothing is kept."""

    def read(self, memory: None, truth: Truth, instant: Instant) -> tuple[Reading, None]:
        """The truth."""
        return true_reading(truth, instant.environment.earth), None


def true_reading(truth: Truth, earth: AbstractEarth) -> Reading:
    """What ideal sensors tell."""
    return Reading(
        truth.state,
        truth.now,
        truth.now.wrench.force_b / truth.airframe.mass_properties.mass,
        true_sight(truth, earth),
    )


def true_sight(truth: Truth, earth: AbstractEarth) -> LineOfSight | None:
    """Line of sight to the goal: its direction and rates in the NED axes of the aircraft's place."""
    if truth.goal is None:
        return None
    line_n, goal_over_ground_n = earth.sight(truth.state.position_n, truth.goal.position_n, truth.goal.velocity_n)
    return measure(jnp.zeros(3), velocity_over_ground_n(truth.now, truth.state), line_n, goal_over_ground_n)
