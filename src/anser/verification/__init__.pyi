from .checks import Check, Comparison, Outcome, to_document
from .suite import CHECKS, select_checks, verify

__all__ = [
    "CHECKS",
    "Check",
    "Comparison",
    "Outcome",
    "select_checks",
    "to_document",
    "verify",
]
