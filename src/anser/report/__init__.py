"""Reports, drawn from datasets alone: a flight as one self-contained page; figures of an envelope survey."""

from anser.report.envelope_figures import draw_envelope
from anser.report.page import write_report

__all__ = ["draw_envelope", "write_report"]
