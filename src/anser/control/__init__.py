"""Control: the three inversion loops, allocation, guidance."""

from anser.control.allocation import SurfaceDemand, allocate
from anser.control.autopilot import (
    AutopilotSignals,
    AutopilotState,
    Plant,
    attitude_control,
    initial_autopilot_state,
    make_plant,
    rate_control,
    velocity_control,
)
from anser.control.beyond_model import BeyondModel, nothing_beyond
from anser.control.feedback import Differentiator, advanced_integral, virtual_control, wrapped
from anser.control.gain_design import SEPARATION_MIN, Separation, designed_gains, loop_bandwidth, separations
from anser.control.gains import AutopilotGains, LoopGains, loop_gains, published_gains
from anser.control.guidance import GuidanceSettings, follow, hold, hold_point
from anser.control.limits import FlightLimits, default_limits
from anser.control.path_motion import PathMotion, path_motion
from anser.control.velocity_loop import AttitudeDemand, ThrustDemand, attitude_demand, thrust_demand

__all__ = [
    "SEPARATION_MIN",
    "AttitudeDemand",
    "AutopilotGains",
    "AutopilotSignals",
    "AutopilotState",
    "BeyondModel",
    "Differentiator",
    "FlightLimits",
    "GuidanceSettings",
    "LoopGains",
    "PathMotion",
    "Plant",
    "Separation",
    "SurfaceDemand",
    "ThrustDemand",
    "advanced_integral",
    "allocate",
    "attitude_control",
    "attitude_demand",
    "default_limits",
    "designed_gains",
    "follow",
    "hold",
    "hold_point",
    "initial_autopilot_state",
    "loop_bandwidth",
    "loop_gains",
    "make_plant",
    "nothing_beyond",
    "path_motion",
    "published_gains",
    "rate_control",
    "separations",
    "thrust_demand",
    "velocity_control",
    "virtual_control",
    "wrapped",
]
