from .again import departures
from .answering import Answer, Answers, answers
from .campaigning import Campaign, campaign
from .comparing import CampaignComparison, Difference, compare_campaigns
from .flying import flight_of, fly_campaign, prepare
from .influencing import Influence, Influences, influences
from .keeping import keep_worst
from .reporting import REPORT, write_campaign
from .store import CampaignStore, StoreError
from .study import Study, load_study

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
    "StoreError",
    "Study",
    "answers",
    "campaign",
    "compare_campaigns",
    "departures",
    "flight_of",
    "fly_campaign",
    "influences",
    "keep_worst",
    "load_study",
    "prepare",
    "write_campaign",
]
