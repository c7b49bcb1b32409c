from .airframe_figures import draw_airframe, draw_deep_stall
from .campaign_figures import draw_campaign, draw_paired, draw_rare, draw_sweep
from .campaign_page import write_campaign_report
from .envelope_figures import draw_envelope
from .flight_figures import FlightPlots, draw_flight
from .flight_page import write_comparison, write_report
from .margin_figures import BODE_SUFFIXES, draw_bode, draw_margin_maps
from .plan_figures import draw_plan
from .robustness_figures import draw_robustness

__all__ = [
    "BODE_SUFFIXES",
    "FlightPlots",
    "draw_airframe",
    "draw_bode",
    "draw_campaign",
    "draw_deep_stall",
    "draw_envelope",
    "draw_flight",
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
