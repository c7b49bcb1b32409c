from .hold_around_goal import HoldAroundGoal
from .hold_paths import HoldCircle, PlannedHolds

__all__ = ["HoldAroundGoal", "HoldCircle", "PlannedHolds"]
