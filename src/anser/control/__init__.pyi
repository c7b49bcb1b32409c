from .dave_ml_laws import DaveMlLaw, NamedCommands, dave_ml_law
from .gains import AutopilotGains, automatic_gains, published_gains
from .guidance import FollowPlan, GuidanceSettings
from .inversion_autopilot import InversionAutopilot, LoopCommand
from .limits import FlightLimits, default_limits

__all__ = [
    "AutopilotGains",
    "DaveMlLaw",
    "FlightLimits",
    "FollowPlan",
    "GuidanceSettings",
    "InversionAutopilot",
    "LoopCommand",
    "NamedCommands",
    "automatic_gains",
    "dave_ml_law",
    "default_limits",
    "published_gains",
]
