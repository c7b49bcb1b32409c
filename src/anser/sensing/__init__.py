"""Sensing: what an aircraft measures of itself and of its goal, and what it estimates."""

from anser.sensing.delayed import DelayedSensors
from anser.sensing.direct import DirectEstimator, goal_seen
from anser.sensing.dropouts import Dropouts
from anser.sensing.goal_filters import AbstractGoalFilter, GoalFilter
from anser.sensing.goal_sensors import FieldOfView, GoalSensor, slots_for
from anser.sensing.ideal import IdealSensors, line_of_sight
from anser.sensing.interface import (
    GOAL_DIVERGED,
    GOAL_KNOWN,
    GOAL_NEVER_SEEN,
    AbstractEstimator,
    AbstractSensors,
    Belief,
    Fix,
    GoalReading,
    GoalState,
    Instant,
    Reading,
    Truth,
    Uncertainty,
    velocity_over_ground_n,
)
from anser.sensing.motion_models import AbstractMotion, CoordinatedTurn, SteadyMotion
from anser.sensing.navigation import AirFilter, NavigationFilter
from anser.sensing.noisy import NoisySensors
from anser.sensing.own_sensors import AirDataSensors, InertialSensors, OwnSensors, SatelliteNavigation
from anser.sensing.tracking import Briefing, TrackingEstimator

__all__ = [
    "GOAL_DIVERGED",
    "GOAL_KNOWN",
    "GOAL_NEVER_SEEN",
    "AbstractEstimator",
    "AbstractGoalFilter",
    "AbstractMotion",
    "AbstractSensors",
    "AirDataSensors",
    "AirFilter",
    "Belief",
    "Briefing",
    "CoordinatedTurn",
    "DelayedSensors",
    "DirectEstimator",
    "Dropouts",
    "FieldOfView",
    "Fix",
    "GoalFilter",
    "GoalReading",
    "GoalSensor",
    "GoalState",
    "IdealSensors",
    "InertialSensors",
    "Instant",
    "NavigationFilter",
    "NoisySensors",
    "OwnSensors",
    "Reading",
    "SatelliteNavigation",
    "SteadyMotion",
    "TrackingEstimator",
    "Truth",
    "Uncertainty",
    "goal_seen",
    "line_of_sight",
    "slots_for",
    "velocity_over_ground_n",
]
