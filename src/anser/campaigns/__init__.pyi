from .campaign_folder import Campaign, campaign, load_campaign
from .comparison import CampaignComparison, compare_campaigns
from .estimates import CampaignEstimates
from .rare_events import RareEvent, rare, read_rare
from .sensitivity import Influences
from .store_integrity import StoreError
from .study import Study, load_study
from .subset import SubsetEstimate, subset_simulation

__all__ = [
    "Campaign",
    "CampaignComparison",
    "CampaignEstimates",
    "Influences",
    "RareEvent",
    "StoreError",
    "Study",
    "SubsetEstimate",
    "campaign",
    "compare_campaigns",
    "load_campaign",
    "load_study",
    "rare",
    "read_rare",
    "subset_simulation",
]
