from .envelope_figures import draw_envelope
from .margin_figures import BODE_SUFFIXES, draw_bode, draw_margin_maps
from .page import write_comparison, write_report
from .plan_figure import draw_plan
from .robustness_figures import draw_robustness

__all__ = [
    "BODE_SUFFIXES",
    "draw_bode",
    "draw_envelope",
    "draw_margin_maps",
    "draw_plan",
    "draw_robustness",
    "write_comparison",
    "write_report",
]
