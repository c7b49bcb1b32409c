"""The report of a flight as one self-contained page, drawn from a dataset and its summary alone."""

from anser.report.page import write_report

__all__ = ["write_report"]
