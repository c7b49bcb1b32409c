from .network import Network
from .planner import DecentralisedPlanner

__all__ = ["DecentralisedPlanner", "Network"]
