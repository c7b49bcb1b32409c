"""The certified planner: paths that keep limits, distances and closed volumes, with bounds that prove it."""

from anser.planning.certified.arrivals import arrival_sets
from anser.planning.certified.certificate import PathBounds, path_bounds
from anser.planning.certified.certified_plan import Certificate, CertifiedPlan, certify, plan_at, ticks_for
from anser.planning.certified.relaxing import RELAXED, relaxed
from anser.planning.certified.renewal import ANEW, FIRST, RENEWAL_MESSAGES, Renewed, renew_certified
from anser.planning.certified.request import Airspace, KeepOuts, Traveller, no_keep_outs
from anser.planning.certified.ruled_out import apart_at_arrival, crowded
from anser.planning.certified.search import (
    RULES,
    ArrivalRequest,
    Outcome,
    common_times,
    possible_times,
    search,
    stacked,
)
from anser.planning.separation import Separation

__all__ = [
    "ANEW",
    "FIRST",
    "RELAXED",
    "RENEWAL_MESSAGES",
    "RULES",
    "Airspace",
    "ArrivalRequest",
    "Certificate",
    "CertifiedPlan",
    "KeepOuts",
    "Outcome",
    "PathBounds",
    "Renewed",
    "Separation",
    "Traveller",
    "apart_at_arrival",
    "arrival_sets",
    "certify",
    "common_times",
    "crowded",
    "no_keep_outs",
    "path_bounds",
    "plan_at",
    "possible_times",
    "relaxed",
    "renew_certified",
    "search",
    "stacked",
    "ticks_for",
]
