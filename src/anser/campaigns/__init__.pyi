from .again import departures
from .answering import Answer, Answers, answers
from .campaigning import Campaign, campaign
from .comparing import CampaignComparison, Difference, compare_campaigns
from .flying import flight_of, fly_campaign, prepare
from .influencing import Influence, Influences, influences
from .keeping import keep_worst
from .rare_event import RareEvent, rare, read_rare
from .rare_store import RareStore
from .reporting import REPORT, write_campaign
from .store import CampaignStore, StoreError
from .study import Study, load_study
from .subset import Normals, SubsetEstimate, SubsetPlan, estimate, subset_simulation

__all__ = [
    "REPORT",
    "Answer",
    "Answers",
    "Campaign",
    "CampaignComparison",
    "CampaignStore",
    "Difference",
    "Influence",
    "Influences",
    "Normals",
    "RareEvent",
    "RareStore",
    "StoreError",
    "Study",
    "SubsetEstimate",
    "SubsetPlan",
    "answers",
    "campaign",
    "compare_campaigns",
    "departures",
    "estimate",
    "flight_of",
    "fly_campaign",
    "influences",
    "keep_worst",
    "load_study",
    "prepare",
    "rare",
    "read_rare",
    "subset_simulation",
    "write_campaign",
]
