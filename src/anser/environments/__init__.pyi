from .actions import AbstractActionLevel, RateLevel, SurfaceLevel, VelocityLevel
from .agent_dictionaries import AgentDictionaries
from .cases import Case, FlightRange, Situation
from .environment import AircraftEnvironment, EpisodeState, Parameters
from .experts import Expert, Score, score
from .fleet import FleetEnvironment
from .planned_tasks import AbstractPlannedTask, Arrival, FleetArrival, PathTracking
from .recording import Episode, fly_episodes, record_flight
from .registry import TASKS, make
from .spaces import Box, Entry
from .tasks import AbstractTask, AltitudeChange, AttitudeHold, UpsetRecovery, VelocityCommand

__all__ = [
    "TASKS",
    "AbstractActionLevel",
    "AbstractPlannedTask",
    "AbstractTask",
    "AgentDictionaries",
    "AircraftEnvironment",
    "AltitudeChange",
    "Arrival",
    "AttitudeHold",
    "Box",
    "Case",
    "Entry",
    "Episode",
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
    "fly_episodes",
    "make",
    "record_flight",
    "score",
]
