"""Command verify: comparison of computed with published values."""

import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from anser.cli.app import help_epilog
from anser.cli.console import (
    columns,
    print_document,
    print_line,
    print_problem,
    print_table,
    progress_bar,
    refuse_on,
)

if TYPE_CHECKING:
    from anser.verification.checks import Check, Comparison, Outcome


@help_epilog(
    "anser verify",
    "anser verify --case nesc-11 --case f16-trim --json",
    "anser verify --list",
    unmet="a comparison fails",
)
def verify(
    case: Annotated[list[str] | None, typer.Option(help="Run this check only; may be given several times.")] = None,
    only_list: Annotated[bool, typer.Option("--list", help="Print the checks there are and stop.")] = False,
) -> None:
    """Recompute published numbers and compare: NASA's check-cases, Stevens & Lewis, the standards."""
    from anser.compiling.options import enable_compilation_cache
    from anser.verification.checks import to_document
    from anser.verification.suite import select_checks
    from anser.verification.suite import verify as run

    with refuse_on(ValueError, "--case: "):
        checks = select_checks(case or None)
    if only_list:
        listed = [{"key": check.key, "title": check.title, "source": check.source} for check in checks]
        print_document(lambda: {"format_version": 1, "checks": listed})
        _print_checks(checks)
        return
    enable_compilation_cache()
    start = time.perf_counter()
    with progress_bar() as tell:
        outcomes = run(case or None, tell)
    seconds = time.perf_counter() - start
    print_document(lambda: to_document(outcomes, seconds))
    _print_outcomes(outcomes)
    _print_count(outcomes, seconds)
    for text in [text for outcome in outcomes for text in _shortfalls(outcome)]:
        print_problem(text)
    if any(outcome.fails for outcome in outcomes):
        raise typer.Exit(1)


def _print_count(outcomes: Sequence["Outcome"], seconds: float) -> None:
    comparisons = [comparison for outcome in outcomes for comparison in outcome.comparisons]
    judged = sum(comparison.judged for comparison in comparisons)
    passed = sum(comparison.passes for comparison in comparisons)
    broken = sum(outcome.problem is not None for outcome in outcomes)
    failure_note = f"; {broken} of {len(outcomes)} checks could not be computed" if broken else ""
    listed = len(comparisons) - judged
    unjudged_note = f"; {listed} more flown, not judged" if listed else ""
    print_line(f"{passed} of {judged} comparisons passed{unjudged_note}{failure_note}, {seconds:.1f} s")
    unjudged = [outcome.check.key for outcome in outcomes if not outcome.judged and not outcome.fails]
    if unjudged:
        print_line(f"Nothing is judged in {', '.join(unjudged)}: no published figures come with this package.")


def _print_checks(checks: Sequence["Check"]) -> None:
    headings = [*columns("check", overflow="fold", no_wrap=True), *columns("title", "source", overflow="fold")]
    print_table("checks", headings, [(check.key, check.title, check.source) for check in checks])


def _print_outcomes(outcomes: Sequence["Outcome"]) -> None:
    from anser.verification.checks import NOT_JUDGED

    rows, styles = [], []
    for outcome in outcomes:
        check = outcome.check
        if outcome.problem is not None:
            rows.append([check.key, outcome.problem, *"-----", check.source])
            styles.append("red")
        for worst in _worst(outcome.comparisons):
            reason = (worst.tolerance_reason or check.tolerance_reason) if worst.judged else NOT_JUDGED
            errors = _short(worst.error), _short(worst.tolerance)
            rows.append([check.key, _quantity(worst), *_figures(worst), *errors, reason, check.source])
            styles.append("red" if worst.fails else None)
    headings = [
        *columns("check", no_wrap=True),
        *columns("quantity", overflow="fold"),
        *columns("expected", "obtained", "error", "tolerance", justify="right", overflow="fold"),
        *columns("why that tolerance", "source", overflow="fold"),
    ]
    print_table("worst point of each quantity", headings, rows, styles)


def _worst(comparisons: Sequence["Comparison"]) -> list["Comparison"]:
    """Return, for each group, the comparison with the greatest `severity`, or the last one if no value is published."""
    worst: dict[str, Comparison] = {}
    for comparison in comparisons:
        current = worst.get(comparison.group)
        is_tie = comparison.expected is None and current is not None and comparison.severity == current.severity
        if current is None or comparison.severity > current.severity or is_tie:
            worst[comparison.group] = comparison
    return list(worst.values())


def _shortfalls(outcome: "Outcome") -> list[str]:
    """Return the error messages of a failed check: why the computation failed, or a line for each failing quantity."""
    key = outcome.check.key
    if outcome.problem is not None:
        return [f"falls short: {key}: could not be computed: {outcome.problem}"]
    lines = []
    for worst in _worst(outcome.comparisons):
        if not worst.fails:
            continue
        expected, obtained = _figures(worst)
        of_group = [comparison for comparison in outcome.comparisons if comparison.group == worst.group]
        short = sum(comparison.fails for comparison in of_group)
        lines.append(
            f"falls short: {key}: {_quantity(worst)}: expected {expected}, obtained {obtained}, error "
            f"{_short(worst.error)}, tolerance {_short(worst.tolerance)} ({short} of {len(of_group)} points fall short)"
        )
    return lines


def _quantity(comparison: "Comparison") -> str:
    """Return quantity, unit and point of a comparison as text; a unit that the quantity's name contains is left out."""
    unit = comparison.unit
    in_name = "_" + unit.translate(str.maketrans({"/": "_", "^": None, " ": None}))
    shown = "" if unit in ("", "1") or f"{in_name}_" in f"{comparison.group}_" else f" {unit}"
    return f"{comparison.group}{shown} ({comparison.point})"


def _figures(comparison: "Comparison") -> tuple[str, str]:
    """Return the expected and computed value as text, with enough digits to show the difference; "-" if missing."""
    expected, obtained, tolerance = comparison.expected, comparison.obtained, comparison.tolerance
    if not math.isfinite(obtained):
        return ("-" if expected is None else f"{expected:.10g}"), str(obtained)
    if expected is None or tolerance is None:
        return "-", f"{obtained:.7g}"
    # bounds are printed as tolerances about 0
    resolution = 0.01 * tolerance if expected == 0.0 and tolerance else max(abs(obtained - expected), 0.01 * tolerance)
    largest = max(abs(expected), abs(obtained))
    if largest == 0.0 or resolution == 0.0:
        return f"{expected:.10g}", f"{obtained:.10g}"
    decimals = 1 - math.floor(math.log10(resolution))
    magnitude = math.floor(math.log10(largest))
    digits = min(max(magnitude + decimals, 1), 15)  # after the first; a float has sixteen
    form = f".{max(digits - magnitude, 0)}f" if -4 <= magnitude <= 9 else f".{digits}e"
    return _number(expected, form), _number(obtained, form)


def _number(value: float, form: str) -> str:
    return "0" if value == 0.0 else format(value, form)


def _short(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.2g}"
