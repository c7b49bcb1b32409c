"""Checks: a published figure, the same figure computed here, and the tolerance between them.

The published data that come with the package, and the JSON document of the outcomes.
"""

import functools
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

from anser.results.documents import software_versions

NOT_JUDGED = "flown, not judged"
"""Verdict on what has no published figure."""


@dataclass(frozen=True)
class Comparison:
    """One figure and its published value.

    Attributes
    ----------
    group
        The quantity, `alpha_dot`; a table shows the worst comparison of each group.
    where
        The point, `V 300 ft/s`.
    unit
        Unit of expected, obtained and tolerance; empty for a pure number.
    expected
        The published figure; None where the definition is published and the figure is not.
    obtained
        The figure computed here.
    tolerance
        Largest absolute difference that agrees; None exactly where `expected` is.
    time_s
        Time of the point, for plots over time.
    reference
        Which of several published figures, `sim_05`.
    why
        Reason of the tolerance where it is another than the check's.
    """

    group: str
    point: str
    unit: str
    expected: float | None
    obtained: float
    tolerance: float | None
    time_s: float | None = None
    reference: str = ""
    tolerance_reason: str = ""

    def __post_init__(self) -> None:
        if (self.expected is None) != (self.tolerance is None):
            raise ValueError(
                f"{self.group}, {self.point}: arrived expected {self.expected} with tolerance {self.tolerance}; "
                "a published figure needs a tolerance and a missing one has none"
            )
        if self.tolerance is not None and not (math.isfinite(self.tolerance) and self.tolerance >= 0.0):
            raise ValueError(f"{self.group}, {self.point}: arrived tolerance {self.tolerance}; expected one >= 0")
        if self.expected is not None and not math.isfinite(self.expected):
            raise ValueError(f"{self.group}, {self.point}: arrived expected {self.expected}; expected a finite figure")

    @property
    def error(self) -> float | None:
        """Obtained minus expected; None where no figure is given."""
        return None if self.expected is None else self.obtained - self.expected

    @property
    def judged(self) -> bool:
        """Whether there is a published figure."""
        return self.expected is not None

    @property
    def fails(self) -> bool:
        """Whether the figure is not finite, or differs from the published one by more than the tolerance."""
        return not self._agrees

    @property
    def passes(self) -> bool:
        """Whether there is a published figure and it agrees."""
        return self.judged and self._agrees

    @property
    def _agrees(self) -> bool:
        if not math.isfinite(self.obtained):
            return False
        return self.expected is None or self.tolerance is None or abs(self.obtained - self.expected) <= self.tolerance

    @property
    def severity(self) -> float:
        """Size of the error in tolerances, for finding the worst of a group; infinite for NaN and infinity."""
        if not math.isfinite(self.obtained):
            return math.inf
        if self.expected is None or self.tolerance is None:
            return 0.0
        size = abs(self.obtained - self.expected)
        if self.tolerance == 0.0:
            return 0.0 if size == 0.0 else math.inf
        return size / self.tolerance


@dataclass(frozen=True)
class Check:
    """Published figures of one source, and how they are computed here.

    Attributes
    ----------
    key
        Name on the command line, `f16-derivatives`.
    title
        Name on the page.
    source
        Citation short enough for the cell of a table, `[SL] tab. 3.5-2`.
    why
        Reason of the tolerance, as short: `half the last digit`.
    explanation
        Sentences for the page: conventions, discrepancies and their cause.
    measure
        Compute all comparisons.
    long
        Whether it takes so long that it is computed beside the others.
    """

    key: str
    title: str
    source: str
    tolerance_reason: str
    explanation: str
    measure: Callable[[], tuple[Comparison, ...]]
    long: bool = False


@dataclass(frozen=True)
class Outcome:
    """What a check found.

    Attributes
    ----------
    check
        The check.
    comparisons
        All its comparisons; empty if it could not be computed.
    seconds
        How long it took, compilation included.
    problem
        Why it could not be computed; None if it could.
    """

    check: Check
    comparisons: tuple[Comparison, ...]
    seconds: float
    problem: str | None = None

    @property
    def passes(self) -> bool:
        """Whether it could be computed, judges something, and all that it judges agrees."""
        return self.judged and not self.fails

    @property
    def fails(self) -> bool:
        """Whether it could not be computed, has no comparisons, or one of them fails."""
        return self.problem is not None or not self.comparisons or any(c.fails for c in self.comparisons)

    @property
    def judged(self) -> bool:
        """Whether any of its comparisons has a published figure."""
        return any(comparison.judged for comparison in self.comparisons)

    @property
    def verdict(self) -> str:
        """`passed`, `failed` or `NOT_JUDGED`."""
        return "failed" if self.fails else "passed" if self.judged else NOT_JUDGED


@functools.cache
def load_published(name: str) -> dict[str, Any]:
    """Read a file of published figures by its name without ending; its `about` says where the figures come from."""
    text = resources.files("anser.verification").joinpath(f"data/{name}.json").read_text(encoding="utf-8")
    return json.loads(text)


def half_of_last_digit(printed: str) -> float:
    """Half a unit of the last digit of a figure as it is printed, `2.6499e4`: by so much rounding may have moved it."""
    mantissa, _, exponent = printed.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)


def half_of_significant(figure: float, digits: int) -> float:
    """Half a unit of the last of so many significant digits of a figure, for a file that does not keep final zeros."""
    return 0.5 * 10.0 ** (math.floor(math.log10(abs(figure))) - digits + 1)


def compare_as_printed(group: str, where: str, unit: str, printed: str, obtained: float) -> Comparison:
    """Compare with a figure as it is printed, to half a unit of its last digit."""
    return Comparison(group, where, unit, float(printed), float(obtained), half_of_last_digit(printed))


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
        "provenance": software_versions(),
        "passed": _verdict_flag(
            any(outcome.judged for outcome in outcomes), not outcomes or any(outcome.fails for outcome in outcomes)
        ),
        "seconds": seconds,
        "checks": [_outcome(outcome) for outcome in outcomes],
    }


def _verdict_flag(judged: bool, fails: bool) -> bool | None:
    return False if fails else True if judged else None


def _outcome(outcome: Outcome) -> dict[str, Any]:
    check = outcome.check
    return {
        "key": check.key,
        "title": check.title,
        "source": check.source,
        "why": check.tolerance_reason,
        "explanation": check.explanation,
        "seconds": outcome.seconds,
        "passed": _verdict_flag(outcome.judged, outcome.fails),
        "verdict": outcome.verdict,
        "problem": outcome.problem,
        "comparisons": [_comparison(comparison, check.tolerance_reason) for comparison in outcome.comparisons],
    }


def _comparison(comparison: Comparison, tolerance_reason: str) -> dict[str, Any]:
    finite = math.isfinite(comparison.obtained)
    return {
        "group": comparison.group,
        "where": comparison.point,
        "unit": comparison.unit,
        "expected": comparison.expected,
        "obtained": comparison.obtained if finite else None,
        "error": comparison.error if finite else None,
        "tolerance": comparison.tolerance,
        "why": comparison.tolerance_reason or tolerance_reason,
        "time_s": comparison.time_s,
        "reference": comparison.reference,
        "passed": _verdict_flag(comparison.judged, comparison.fails),
        "problem": None if finite else f"obtained {comparison.obtained}",
    }
