from .actions import AbstractActionLevel, RateLevel, SurfaceLevel, VelocityLevel
from .cases import Case, FlightRange, Situation
from .environment import AircraftEnvironment, EpisodeState, Parameters
from .experts import Expert, Score, score
from .fleet import FleetEnvironment
from .planned_tasks import AbstractPlannedTask, Arrival, FleetArrival, PathTracking
from .registry import TASKS, make
from .spaces import Box, Entry
from .tasks import AbstractTask, AltitudeChange, AttitudeHold, UpsetRecovery, VelocityCommand

__all__ = [
    "TASKS",
    "AbstractActionLevel",
    "AbstractPlannedTask",
    "AbstractTask",
    "AircraftEnvironment",
    "AltitudeChange",
    "Arrival",
    "AttitudeHold",
    "Box",
    "Case",
    "Entry",
    "EpisodeState",
    "Expert",
    "FleetArrival",
    "FleetEnvironment",
    "FlightRange",
    "Parameters",
    "PathTracking",
    "RateLevel",
    "Score",
    "Situation",
    "SurfaceLevel",
    "UpsetRecovery",
    "VelocityCommand",
    "VelocityLevel",
    "make",
    "score",
]
