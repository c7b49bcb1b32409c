from .controllers import AbstractController, AbstractGuidance
from .input_signals import InputSignal
from .paths import AbstractReference, PathCommand, PathPoint, StraightPath
from .perception import (
    AbstractEstimator,
    AbstractSensors,
    Belief,
    GoalReading,
    GoalState,
    Instant,
    LineOfSight,
    Reading,
    Truth,
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
    "GoalReading",
    "GoalState",
    "InputSignal",
    "Instant",
    "LineOfSight",
    "PathCommand",
    "PathPoint",
    "Performance",
    "Reading",
    "Rendezvous",
    "StraightPath",
    "Truth",
    "make_rendezvous",
]
