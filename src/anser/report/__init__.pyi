from .airframe_figure import draw_airframe
from .campaign_data import CampaignShown, FlownAgain
from .campaign_figure import draw_campaign
from .campaign_page import write_campaign_report
from .campaign_series import SeriesBands
from .deep_stall_figure import draw_deep_stall
from .envelope_figures import draw_envelope
from .flight_plots import FlightPlots
from .margin_figures import BODE_SUFFIXES, draw_bode, draw_margin_maps
from .page import write_comparison, write_report
from .paired_figure import draw_paired
from .plan_figure import draw_plan
from .rare_figure import draw_rare
from .robustness_figures import draw_robustness
from .sweep_figure import draw_sweep

__all__ = [
    "BODE_SUFFIXES",
    "CampaignShown",
    "FlightPlots",
    "FlownAgain",
    "SeriesBands",
    "draw_airframe",
    "draw_bode",
    "draw_campaign",
    "draw_deep_stall",
    "draw_envelope",
    "draw_margin_maps",
    "draw_paired",
    "draw_plan",
    "draw_rare",
    "draw_robustness",
    "draw_sweep",
    "write_campaign_report",
    "write_comparison",
    "write_report",
]
