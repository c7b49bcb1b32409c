"""A check: figures somebody published, and the same figures computed here."""

import math
from collections.abc import Callable
from dataclasses import dataclass

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
    where: str
    unit: str
    expected: float | None
    obtained: float
    tolerance: float | None
    time_s: float | None = None
    reference: str = ""
    why: str = ""

    def __post_init__(self) -> None:
        if (self.expected is None) != (self.tolerance is None):
            raise ValueError(
                f"{self.group}, {self.where}: arrived expected {self.expected} with tolerance {self.tolerance}; "
                "a published figure needs a tolerance and a missing one has none"
            )
        if self.tolerance is not None and not (math.isfinite(self.tolerance) and self.tolerance >= 0.0):
            raise ValueError(f"{self.group}, {self.where}: arrived tolerance {self.tolerance}; expected one >= 0")
        if self.expected is not None and not math.isfinite(self.expected):
            raise ValueError(f"{self.group}, {self.where}: arrived expected {self.expected}; expected a finite figure")

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
    why: str
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
