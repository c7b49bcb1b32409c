"""Campaigns: executing scenarios, one by one for now."""

from anser.campaign.execute import CLEARANCE_MIN_M, Flown, Planned, plan, run
from anser.campaign.trimming import FoundTrim, find_trim

__all__ = ["CLEARANCE_MIN_M", "Flown", "FoundTrim", "Planned", "find_trim", "plan", "run"]
