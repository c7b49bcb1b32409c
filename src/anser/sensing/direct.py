"""An estimator that believes its sensors as they are."""

import jax
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

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> GoalState | None:
        """The goal as it is seen; None without one."""
        if reading.sight is None:
            return None
        velocity_n = velocity_over_ground_n(reading.now, reading.state)
        return goal_seen(instant.environment.earth, reading.sight, reading.state.position_n, velocity_n)

    def estimate(
        self, memory: GoalState | None, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, GoalState | None]:
        """Believe the reading; a goal that is no longer seen is taken to move on steadily."""
        now, model = reading.now, airframe if self.model is None else self.model
        if self.model is not None:
            now = condition(self.model, instant.environment, instant.time, reading.state)
        goal = self.init(reading, airframe, instant)
        if goal is not None and memory is not None:
            goal = seen_or_ahead(goal, memory, reading, instant)
        return Belief(model, reading.state, now, reading.specific_force_b, reading.sight, goal), goal


def seen_or_ahead(seen: GoalState, last: GoalState, reading: Reading, instant: Instant) -> GoalState:
    """A goal as it is seen; where its sensor has failed it is taken to have moved on steadily since the last sample."""
    ahead = GoalState(last.position_n + instant.step * last.velocity_n, last.velocity_n)
    return jax.tree.map(lambda new, old: jnp.where(reading.goal_sensor_works, new, old), seen, ahead)


def goal_seen(earth: AbstractEarth, sight: LineOfSight, position_n: Vector3, velocity_n: Vector3) -> GoalState:
    """Place and velocity of a goal in the Earth's chart, recovered from the line of sight and the own motion.

    `position_n` is the own place in the chart (3,), m, `velocity_n` the own velocity over ground (3,), NED, m/s.
    """
    line_n, goal_velocity_n = recover(sight, jnp.zeros_like(velocity_n), velocity_n)
    return GoalState(*earth.charted(position_n, line_n, goal_velocity_n))
