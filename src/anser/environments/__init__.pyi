from .actions import AbstractActionLevel, RateLevel, SurfaceLevel, VelocityLevel
from .cases import Case, FlightRange, Situation
from .environment import AircraftEnvironment, EpisodeState, Parameters
from .experts import Expert, Score, score
from .registry import make
from .spaces import Box, Entry
from .tasks import AbstractTask, AltitudeChange, AttitudeHold, UpsetRecovery, VelocityCommand

__all__ = [
    "AbstractActionLevel",
    "AbstractTask",
    "AircraftEnvironment",
    "AltitudeChange",
    "AttitudeHold",
    "Box",
    "Case",
    "Entry",
    "EpisodeState",
    "Expert",
    "FlightRange",
    "Parameters",
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
