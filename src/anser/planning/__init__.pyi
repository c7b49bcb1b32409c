from .goals import GoalMotion, straight_goal, waypoint_goal
from .limits import PathLimits
from .separation import Separation
from .timed_path import TimedPath

__all__ = [
    "GoalMotion",
    "PathLimits",
    "Separation",
    "TimedPath",
    "straight_goal",
    "waypoint_goal",
]
