"""Sensing: what an aircraft is told of itself and of its goal, and what it believes."""

from anser.sensing.delayed import DelayedSensors
from anser.sensing.direct import DirectEstimator
from anser.sensing.ideal import IdealSensors
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
    "velocity_over_ground_n",
]
