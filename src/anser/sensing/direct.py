"""An estimator that believes its sensors as they are."""

import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, condition
from anser.environment import AbstractEarth
from anser.planning import LineOfSight, recover
from anser.sensing.interface import AbstractEstimator, Belief, GoalState, Instant, Reading, velocity_over_ground_n
from anser.shapes import Vector3


class DirectEstimator(AbstractEstimator):
    """No filter: the state is the reading, the goal's motion is recovered from the line of sight (theory section 7).

    Attributes
    ----------
    model
        What the aircraft believes of its airframe; None: the airframe itself.
    """

    model: AbstractAirframe | None = None

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> None:
        """Nothing is kept."""

    def estimate(
        self, memory: None, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, None]:
        """Believe the reading."""
        now, model = reading.now, airframe if self.model is None else self.model
        if self.model is not None:
            now = condition(self.model, instant.environment, instant.time, reading.state)
        goal = None
        if reading.sight is not None:
            velocity_n = velocity_over_ground_n(reading.now, reading.state)
            goal = goal_seen(instant.environment.earth, reading.sight, reading.state.position_n, velocity_n)
        return Belief(model, reading.state, now, reading.specific_force_b, reading.sight, goal), None


def goal_seen(earth: AbstractEarth, sight: LineOfSight, position_n: Vector3, velocity_n: Vector3) -> GoalState:
    """Place and velocity of a goal in the Earth's chart, recovered from the line of sight and the own motion.

    `position_n` is the own place in the chart (3,), m, `velocity_n` the own velocity over ground (3,), NED, m/s.
    """
    line_n, goal_velocity_n = recover(sight, jnp.zeros(3), velocity_n)
    return GoalState(*earth.charted(position_n, line_n, goal_velocity_n))
