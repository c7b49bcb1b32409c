from .controllers import AbstractController, AbstractGuidance
from .paths import AbstractReference, PathCommand, PathPoint
from .perception import (
    AbstractEstimator,
    AbstractSensors,
    Belief,
    Fix,
    GoalReading,
    GoalState,
    Instant,
    LineOfSight,
    Reading,
    Truth,
    Uncertainty,
    velocity_over_ground_n,
)
from .planners import AbstractPlanner, AircraftPlan, AircraftReport, Performance, Rendezvous, make_rendezvous

__all__ = [
    "AbstractController",
    "AbstractEstimator",
    "AbstractGuidance",
    "AbstractPlanner",
    "AbstractReference",
    "AbstractSensors",
    "AircraftPlan",
    "AircraftReport",
    "Belief",
    "Fix",
    "GoalReading",
    "GoalState",
    "Instant",
    "LineOfSight",
    "PathCommand",
    "PathPoint",
    "Performance",
    "Reading",
    "Rendezvous",
    "Truth",
    "Uncertainty",
    "make_rendezvous",
    "velocity_over_ground_n",
]
