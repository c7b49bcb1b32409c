"""Sensing: what an aircraft measures of itself and of its goal, and what it estimates."""

from anser.sensing.delayed import DelayedSensors
from anser.sensing.direct import DirectEstimator, goal_seen
from anser.sensing.ideal import IdealSensors, line_of_sight
from anser.sensing.interface import (
    AbstractEstimator,
    AbstractSensors,
    Belief,
    GoalState,
    Instant,
    Reading,
    Truth,
    velocity_over_ground_n,
)

__all__ = [
    "AbstractEstimator",
    "AbstractSensors",
    "Belief",
    "DelayedSensors",
    "DirectEstimator",
    "GoalState",
    "IdealSensors",
    "Instant",
    "Reading",
    "Truth",
    "goal_seen",
    "line_of_sight",
    "velocity_over_ground_n",
]
