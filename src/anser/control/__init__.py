"""Control: the three inversion loops, allocation, guidance."""

from anser.control.allocation import allocate, deflection_for_moment, surface_moments
from anser.control.authority import surface_authority
from anser.control.automatic_gains import Bandwidths, automatic_gains, own_bandwidths
from anser.control.autopilot import AutopilotSignals
from anser.control.dave_ml_law import DaveMlLaw, dave_ml_law
from anser.control.excitation import Excitation
from anser.control.feedback import Differentiator, advanced_integral, brakeable, virtual_control, wrapped
from anser.control.gain_design import SEPARATION_MIN, designed_gains, loop_bandwidth, separations
from anser.control.gains import AutopilotGains, LoopGains, published_gains
from anser.control.ground_clearance import GroundClearance, ground_clearance, levelled_off
from anser.control.guidance import (
    FollowPlan,
    GuidanceSettings,
    chart_velocities,
    crosses_centre,
    follow,
    hold,
    hold_point,
    over_ground,
)
from anser.control.interface import AbstractController, AbstractGuidance, signal_variables
from anser.control.inversion import InversionAutopilot, Loop, LoopCommand
from anser.control.limits import FlightLimits, default_limits
from anser.control.memory import AutopilotState, initial_autopilot_state
from anser.control.model_residual import ModelResidual, no_residual
from anser.control.named_commands import NamedCommands
from anser.control.named_signals import named_signals
from anser.control.onboard_model import OnboardModel
from anser.control.path_motion import PathMotion, path_motion

__all__ = [
    "SEPARATION_MIN",
    "AbstractController",
    "AbstractGuidance",
    "AutopilotGains",
    "AutopilotSignals",
    "AutopilotState",
    "Bandwidths",
    "DaveMlLaw",
    "Differentiator",
    "Excitation",
    "FlightLimits",
    "FollowPlan",
    "GroundClearance",
    "GuidanceSettings",
    "InversionAutopilot",
    "Loop",
    "LoopCommand",
    "LoopGains",
    "ModelResidual",
    "NamedCommands",
    "OnboardModel",
    "PathMotion",
    "advanced_integral",
    "allocate",
    "automatic_gains",
    "brakeable",
    "chart_velocities",
    "crosses_centre",
    "dave_ml_law",
    "default_limits",
    "deflection_for_moment",
    "designed_gains",
    "follow",
    "ground_clearance",
    "hold",
    "hold_point",
    "initial_autopilot_state",
    "levelled_off",
    "loop_bandwidth",
    "named_signals",
    "no_residual",
    "over_ground",
    "own_bandwidths",
    "path_motion",
    "published_gains",
    "separations",
    "signal_variables",
    "surface_authority",
    "surface_moments",
    "virtual_control",
    "wrapped",
]
