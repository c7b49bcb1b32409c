"""Verification: figures that others published, and the same figures computed here.

>>> from anser.verification import verify
>>> all(outcome.passes for outcome in verify(["ussa76", "wgs84"]))
True
"""

from anser.verification.check import NOT_JUDGED, Check, Comparison, Outcome
from anser.verification.document import FORMAT_VERSION, to_document
from anser.verification.running import CHECKS, select_checks, verify

__all__ = [
    "CHECKS",
    "FORMAT_VERSION",
    "NOT_JUDGED",
    "Check",
    "Comparison",
    "Outcome",
    "select_checks",
    "to_document",
    "verify",
]
