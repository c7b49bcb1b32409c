from .planner import PublishedPlanner
from .trajectory import Trajectory, fit_trajectory

__all__ = ["PublishedPlanner", "Trajectory", "fit_trajectory"]
