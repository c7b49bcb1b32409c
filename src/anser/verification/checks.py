"""Checks: comparisons of published values with the values that anser computes, each with a tolerance."""

import functools
import json
import math
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

from anser.results.documents import software_versions

NOT_JUDGED = "flown, not judged"
"""Verdict on a computed value for which no value is published."""


@dataclass(frozen=True)
class Comparison:
    """Comparison of a computed value with its published value.

    Attributes
    ----------
    group
        Quantity, such as `alpha_dot`; a table shows the worst comparison of each group.
    point
        Condition of the comparison, such as `V 300 ft/s`.
    unit
        Unit of both values and of the tolerance.
    expected, obtained
        Published value (None: no value is published), and value computed here.
    tolerance
        Largest accepted absolute difference; None if, and only if, `expected` is None.
    time_s
        Time of the values in a flight, s; None if the values do not belong to a time.
    reference
        Name of the published source, such as `sim_05`; empty if there is only one.
    tolerance_reason
        Reason for the tolerance; empty if the reason of the whole check applies.
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
        """Obtained minus expected value; None without a published value."""
        return None if self.expected is None else self.obtained - self.expected

    @property
    def judged(self) -> bool:
        """Whether a published value exists."""
        return self.expected is not None

    @property
    def fails(self) -> bool:
        """Whether the computed value is not finite, or differs from the published value by more than the tolerance."""
        if self.expected is None or self.tolerance is None:
            return not math.isfinite(self.obtained)
        return not (math.isfinite(self.obtained) and abs(self.obtained - self.expected) <= self.tolerance)

    @property
    def passes(self) -> bool:
        """Whether a published value exists and agrees with the computed value within the tolerance."""
        return self.judged and not self.fails

    @property
    def severity(self) -> float:
        """Absolute error divided by the tolerance; 0 without a published value, infinite if the value is not finite."""
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
    """Check of the package against the published values of one source.

    Attributes
    ----------
    key, title
        Name on the command line, such as `f16-derivatives`, and title on the page.
    source, tolerance_reason
        Short citation, such as `[SL] tab. 3.5-2`, and reason for the tolerance, such as `half the last digit`.
    explanation
        Sentences for the page about conventions, discrepancies and the causes of discrepancies.
    measure
        Function that computes the values and returns their comparisons with the published values.
    long
        True for a slow check; slow checks run one after the other in a second thread.
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
    """Outcome of a check: comparisons, duration `seconds` (s) and, if the computation failed, the `problem`."""

    check: Check
    comparisons: tuple[Comparison, ...]
    seconds: float
    problem: str | None = None

    @property
    def passes(self) -> bool:
        """Whether the computation succeeded, a published value exists, and every published value agrees."""
        return self.judged and not self.fails

    @property
    def fails(self) -> bool:
        """Whether the computation failed, there are no comparisons, or a comparison fails."""
        return self.problem is not None or not self.comparisons or any(c.fails for c in self.comparisons)

    @property
    def judged(self) -> bool:
        """Whether at least one comparison has a published value."""
        return any(comparison.judged for comparison in self.comparisons)

    @property
    def verdict(self) -> str:
        """Verdict on the check as text: `passed`, `failed`, or `NOT_JUDGED` if no published value exists."""
        return "failed" if self.fails else "passed" if self.judged else NOT_JUDGED


@functools.cache
def load_published(name: str) -> dict[str, Any]:
    """Read the JSON file `name` (without suffix) of published values in `verification/data`."""
    return json.loads(read_data_file(f"{name}.json"))


@functools.cache
def load_definitions(name: str) -> dict[str, Any]:
    """Read the TOML file `name` (without suffix) of definitions in `verification/data`."""
    return tomllib.loads(read_data_file(f"{name}.toml"))


def read_data_file(name: str) -> str:
    """Return the text of a file in `verification/data`."""
    return resources.files("anser.verification").joinpath(f"data/{name}").read_text(encoding="utf-8")


def make_check(key: str, measure: Callable[[], Iterable[Comparison]], *, long: bool = False) -> Check:
    """Return the check `key` with the texts (title, source, tolerance reason, explanation) of `data/checks.toml`."""
    texts = {name: " ".join(text.split()) for name, text in load_definitions("checks")[key].items()}
    return Check(key=key, **texts, measure=lambda: tuple(measure()), long=long)


def half_of_last_digit(printed: str) -> float:
    """Return half a unit of the last digit of a printed number such as "2.6499e4": the greatest rounding error."""
    mantissa, _, exponent = printed.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)


def half_of_significant(figure: float, digit_count: int) -> float:
    """Return half a unit of the last of `digit_count` significant digits of a nonzero number.

    The function is for data formats that drop final zeros, such that printed digits cannot be counted.
    """
    return 0.5 * 10.0 ** (math.floor(math.log10(abs(figure))) - digit_count + 1)


def compare_as_printed(group: str, point: str, unit: str, printed: str, obtained: float) -> Comparison:
    """Compare a computed value, `obtained`, with a printed number; the tolerance is half a unit of the last digit."""
    return Comparison(group, point, unit, float(printed), float(obtained), half_of_last_digit(printed))


FORMAT_VERSION = 2
"""Version of the JSON document's format; increased when a name is removed or changes its meaning."""


def to_document(outcomes: Sequence[Outcome], seconds: float) -> dict[str, Any]:
    """Return the outcomes of the checks as plain data for JSON, with software versions and wall time `seconds`.

    `passed` is None if no published value exists. A computed value that is not finite is None, and the `problem` of its
    comparison gives the value.
    """
    return {
        "format_version": FORMAT_VERSION,
        "provenance": software_versions(),
        "passed": _verdict_flag(
            any(outcome.judged for outcome in outcomes), not outcomes or any(outcome.fails for outcome in outcomes)
        ),
        "seconds": seconds,
        "checks": [_outcome_document(outcome) for outcome in outcomes],
    }


def _verdict_flag(judged: bool, fails: bool) -> bool | None:
    return False if fails else True if judged else None


def _outcome_document(outcome: Outcome) -> dict[str, Any]:
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
        "comparisons": [_comparison_document(comparison, check.tolerance_reason) for comparison in outcome.comparisons],
    }


def _comparison_document(comparison: Comparison, tolerance_reason: str) -> dict[str, Any]:
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
