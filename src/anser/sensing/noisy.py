"""Sensors with errors: of the aircraft itself, of its goal, or of both."""

from typing import Any

import equinox as eqx

from anser.sensing.goal_sensors import GoalSensor
from anser.sensing.ideal import true_sight
from anser.sensing.interface import AbstractSensors, Instant, Reading, Truth
from anser.sensing.own_sensors import OwnSensors


class NoisySensors(AbstractSensors):
    """Satellite navigation, inertial sensors and air data, and the sensor of the goal.

    Attributes
    ----------
    own
        Of the aircraft itself; None: its state is known exactly, and so is the air about it.
    goal
        Of its goal; None: its line of sight is known exactly.
    """

    own: OwnSensors | None = None
    goal: GoalSensor | None = None

    def init(self, truth: Truth, instant: Instant) -> tuple[Any, Any]:
        """State of both."""
        own = None if self.own is None else self.own.init(truth, instant)
        return own, None if self.goal is None else self.goal.init(truth, instant)

    def read(self, memory: tuple[Any, Any], truth: Truth, instant: Instant) -> tuple[Reading, tuple[Any, Any]]:
        """What both give."""
        own, goal = memory
        force_b = truth.now.wrench.force_b / truth.airframe.mass_properties.mass
        sight = true_sight(truth, instant.environment.earth) if self.goal is None else None
        reading = Reading(truth.state, truth.now, force_b, sight, goal_sensor_works=truth.goal_sensor_works)
        if self.goal is not None:
            seen, goal = self.goal.read(goal, truth, instant)
            reading = eqx.tree_at(lambda r: r.goal, reading, seen, is_leaf=lambda leaf: leaf is None)
        if self.own is not None:
            found, own = self.own.read(own, truth, instant)
            state = eqx.tree_at(
                lambda s: (s.position_n, s.quaternion, s.rates_b),
                truth.state,
                (found.fix.position_n, found.quaternion, found.rates_b),
            )
            reading = eqx.tree_at(
                lambda r: (r.state, r.specific_force_b, r.fix, r.velocity_air_b),
                reading,
                (state, found.specific_force_b, found.fix, found.velocity_air_b),
                is_leaf=lambda leaf: leaf is None,
            )
        return reading, (own, goal)
