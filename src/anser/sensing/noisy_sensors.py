"""Complete set of one aircraft's sensors with errors: vehicle sensors and goal sensor."""

from typing import Any

import equinox as eqx

from anser.parts.perception import AbstractSensors, Instant, Reading, Truth
from anser.sensing.goal_sensors import NoisyGoalSensor
from anser.sensing.ideal_sensors import true_line_of_sight
from anser.sensing.vehicle_sensors import VehicleSensors


class NoisySensors(AbstractSensors):
    """Sensors of an aircraft with errors: satellite navigation, inertial sensors, air data, and goal sensor.

    In a reading, `condition`, and velocity, actuators and engine in `state`, are true. The measured velocities are in
    `fix` (over the ground) and `velocity_air_b` (relative to the air).
    """

    vehicle: VehicleSensors | None = None  #: Vehicle sensors; None: exact state and air data.
    goal: NoisyGoalSensor | None = None  #: Goal sensor; None: exact line of sight.

    def init(self, truth: Truth, instant: Instant) -> tuple[Any, Any]:
        """Return the initial states of vehicle sensors and goal sensor; None for exact sensors."""
        vehicle = None if self.vehicle is None else self.vehicle.init(truth, instant)
        return vehicle, None if self.goal is None else self.goal.init(truth, instant)

    def read(self, sensor_state: tuple[Any, Any], truth: Truth, instant: Instant) -> tuple[Reading, tuple[Any, Any]]:
        """Return the reading of this sample, and the new states of vehicle sensors and goal sensor."""
        vehicle, goal = sensor_state
        force_b = truth.condition.wrench.force_b / truth.airframe.mass_properties.mass
        sight = true_line_of_sight(truth, instant.environment.earth) if self.goal is None else None
        reading = Reading(truth.state, truth.condition, force_b, sight, goal_sensor_works=truth.goal_sensor_works)
        if self.goal is not None:
            goal_reading, goal = self.goal.read(goal, truth, instant)
            reading = eqx.tree_at(lambda r: r.goal, reading, goal_reading, is_leaf=lambda leaf: leaf is None)
        if self.vehicle is not None:
            vehicle_reading, vehicle = self.vehicle.read(vehicle, truth, instant)
            state = eqx.tree_at(
                lambda s: (s.position_n, s.quaternion, s.rates_b),
                truth.state,
                (vehicle_reading.fix.position_n, vehicle_reading.quaternion, vehicle_reading.rates_b),
            )
            reading = eqx.tree_at(
                lambda r: (r.state, r.specific_force_b, r.fix, r.velocity_air_b),
                reading,
                (state, vehicle_reading.specific_force_b, vehicle_reading.fix, vehicle_reading.velocity_air_b),
                is_leaf=lambda leaf: leaf is None,
            )
        return reading, (vehicle, goal)
