from .estimators import TrackingEstimator
from .goal_filters import GoalFilter
from .goal_sensors import FieldOfView, NoisyGoalSensor
from .ideal_sensors import DelayedSensors, IdealSensors
from .noisy_sensors import NoisySensors
from .vehicle_sensors import VehicleSensors

__all__ = [
    "DelayedSensors",
    "FieldOfView",
    "GoalFilter",
    "IdealSensors",
    "NoisyGoalSensor",
    "NoisySensors",
    "TrackingEstimator",
    "VehicleSensors",
]
