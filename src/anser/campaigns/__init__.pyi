from .campaign_folder import Campaign, campaign
from .comparison import CampaignComparison, compare_campaigns
from .estimates import CampaignEstimates
from .rare_events import RareEvent, rare, read_rare
from .sensitivity import Influences
from .store import CampaignStore
from .store_integrity import StoreError
from .study import Study, load_study
from .subset import Normals, SubsetEstimate, SubsetPlan, estimate, subset_simulation

__all__ = [
    "Campaign",
    "CampaignComparison",
    "CampaignEstimates",
    "CampaignStore",
    "Influences",
    "Normals",
    "RareEvent",
    "StoreError",
    "Study",
    "SubsetEstimate",
    "SubsetPlan",
    "campaign",
    "compare_campaigns",
    "estimate",
    "load_study",
    "rare",
    "read_rare",
    "subset_simulation",
]
