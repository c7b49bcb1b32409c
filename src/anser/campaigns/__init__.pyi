from .again import departures
from .answers import Answer, Answers, answers
from .campaign import Campaign, campaign
from .flying import flight_of, fly_campaign, prepare
from .rare_event import RareEvent, rare, read_rare
from .rare_store import RareStore
from .store import CampaignStore, StoreError
from .study import Study, load_study
from .subset import Normals, SubsetEstimate, SubsetPlan, estimate, subset_simulation

__all__ = [
    "Answer",
    "Answers",
    "Campaign",
    "CampaignStore",
    "Normals",
    "RareEvent",
    "RareStore",
    "StoreError",
    "Study",
    "SubsetEstimate",
    "SubsetPlan",
    "answers",
    "campaign",
    "departures",
    "estimate",
    "flight_of",
    "fly_campaign",
    "load_study",
    "prepare",
    "rare",
    "read_rare",
    "subset_simulation",
]
