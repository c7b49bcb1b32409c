from .campaign_figures import draw_campaign
from .envelope_figures import draw_bode, draw_envelope
from .flight_figures import FlightPlots, draw_flight
from .flight_page import write_comparison, write_report
from .plan_figures import draw_plan
from .robustness_figures import draw_robustness

__all__ = [
    "FlightPlots",
    "draw_bode",
    "draw_campaign",
    "draw_envelope",
    "draw_flight",
    "draw_plan",
    "draw_robustness",
    "write_comparison",
    "write_report",
]
