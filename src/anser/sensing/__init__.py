"""Sensing: what an aircraft measures of itself and of its goal, and what it estimates."""

from anser.sensing.delayed import DelayedSensors
from anser.sensing.direct import DirectEstimator, goal_seen
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

__all__ = [
    "GOAL_DIVERGED",
    "GOAL_KNOWN",
    "GOAL_NEVER_SEEN",
    "AbstractEstimator",
    "AbstractSensors",
    "Belief",
    "DelayedSensors",
    "DirectEstimator",
    "Fix",
    "GoalReading",
    "GoalState",
    "IdealSensors",
    "Instant",
    "Reading",
    "Truth",
    "Uncertainty",
    "goal_seen",
    "line_of_sight",
    "velocity_over_ground_n",
]
