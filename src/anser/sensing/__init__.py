"""Sensors and estimators: implementations of the interfaces of `anser.parts.perception`.

The sets of sensors are `IdealSensors` and `DelayedSensors` (ideal_sensors) and `NoisySensors` (noisy_sensors), which is
made of the vehicle sensors (vehicle_sensors) and a goal sensor (goal_sensors). The estimators (estimators) use the
filters of the aircraft's motion (navigation) and of the goal (goal_filters, with motion_models and kalman).
`anser.scenario.build_sensing` builds them from a scenario.

A new sensor needs: a field of `Reading` (`anser.parts.perception`); an error model with `init`, `read` and a state
(like `VehicleSensors`), used by `NoisySensors`; a part number for its random numbers (`anser.numerics.randomness`); an
estimator that uses the field; a field of `Belief` if guidance or controller use a new quantity; scenario keys
(`anser.scenario.schema_sensing`), their construction and the test for exact sensors (`build_sensing`), and the rule for
keys without effect (`unused_keys`); recorded variables (`anser.simulation.recorders`, `anser.variables`). A new filter
of the goal also needs its state in `hand_over_goal` (goal_filters).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
