"""An estimator that believes its sensors as they are."""

import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, condition
from anser.planning import recover
from anser.sensing.interface import AbstractEstimator, Belief, GoalState, Instant, Reading, velocity_over_ground_n


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
        goal = goal_seen(reading, instant)
        return Belief(model, reading.state, now, reading.specific_force_b, reading.sight, goal), None


def goal_seen(reading: Reading, instant: Instant) -> GoalState | None:
    """Place and velocity of the goal in the Earth's chart, recovered from the line of sight and the own motion."""
    if reading.sight is None:
        return None
    here_n = jnp.zeros(3)
    line_n, velocity_n = recover(reading.sight, here_n, velocity_over_ground_n(reading.now, reading.state))
    return GoalState(*instant.environment.earth.charted(reading.state.position_n, line_n, velocity_n))
