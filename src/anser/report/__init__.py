"""Reports, drawn from datasets alone: a flight as one self-contained page; figures of plans, surveys and studies.

Functions that draw into files never overwrite one: they raise FileExistsError, and ImportError without matplotlib. The
folder that they draw into must exist.
"""

from anser.report.envelope_figures import draw_envelope
from anser.report.margin_figures import BODE_SUFFIXES, draw_bode, draw_margin_maps
from anser.report.page import write_comparison, write_report
from anser.report.plan_figure import draw_plan
from anser.report.robustness_figures import draw_robustness

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
