"""Outcomes as plain data for JSON: the contract that pages and other programs read."""

import math
from collections.abc import Sequence
from typing import Any

from anser.results import versions
from anser.verification.check import Comparison, Outcome

FORMAT_VERSION = 2
"""Raised when a name is taken away or changes its meaning."""


def to_document(outcomes: Sequence[Outcome], seconds: float) -> dict[str, Any]:
    """All that was compared, with the software that computed it; numbers are finite or None.

    `passed` is None of what has no published figure: it was flown, not judged.

    `seconds` is the time that all took together; checks are computed side by side. A figure that came out as NaN or
    infinite is None and its comparison's `problem` says what it was.
    """
    return {
        "format_version": FORMAT_VERSION,
        "provenance": versions(),
        "passed": _passed(
            any(outcome.judged for outcome in outcomes), not outcomes or any(outcome.fails for outcome in outcomes)
        ),
        "seconds": seconds,
        "checks": [_outcome(outcome) for outcome in outcomes],
    }


def _passed(judged: bool, fails: bool) -> bool | None:
    return False if fails else True if judged else None


def _outcome(outcome: Outcome) -> dict[str, Any]:
    check = outcome.check
    return {
        "key": check.key,
        "title": check.title,
        "source": check.source,
        "why": check.why,
        "explanation": check.explanation,
        "seconds": outcome.seconds,
        "passed": _passed(outcome.judged, outcome.fails),
        "verdict": outcome.verdict,
        "problem": outcome.problem,
        "comparisons": [_comparison(comparison, check.why) for comparison in outcome.comparisons],
    }


def _comparison(comparison: Comparison, why: str) -> dict[str, Any]:
    finite = math.isfinite(comparison.obtained)
    return {
        "group": comparison.group,
        "where": comparison.where,
        "unit": comparison.unit,
        "expected": comparison.expected,
        "obtained": comparison.obtained if finite else None,
        "error": comparison.error if finite else None,
        "tolerance": comparison.tolerance,
        "why": comparison.why or why,
        "time_s": comparison.time_s,
        "reference": comparison.reference,
        "passed": _passed(comparison.judged, comparison.fails),
        "problem": None if finite else f"obtained {comparison.obtained}",
    }
