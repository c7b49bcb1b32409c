from .actions import AbstractActionLevel, RateLevel, SurfaceLevel, VelocityLevel
from .cases import Case, FlightRange, Situation
from .environment import AircraftEnvironment, EpisodeState, Parameters
from .episodes import Episode, Expert, Score, fly_episodes, record_flight, score
from .fleet import AgentDictionaries, FleetEnvironment
from .planned_tasks import AbstractPlannedTask, Arrival, FleetArrival, PathTracking
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
