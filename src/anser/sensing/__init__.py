"""Sensors and estimators: implementations of the interfaces of `anser.parts.perception`.

The sets of sensors are `IdealSensors` and `DelayedSensors` (ideal_sensors) and `NoisySensors` (goal_sensors), which is
made of the vehicle sensors (vehicle_sensors) and a goal sensor (goal_sensors). The estimators (estimators) use the
filters of the aircraft's motion (navigation) and of the goal (goal_filters, with motion_models and kalman).
`anser.scenario.build_sensing` builds them from a scenario.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
