"""Summary of many trials: counts by arrival rule, and every disagreement between planner and checker."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from trials.data import RULES
from trials.runner import VERDICTS, Trial

__all__ = ["CONTRADICTED_MOST", "Tally", "tally"]

CONTRADICTED_MOST = 0.02
"""Accepted fraction of contradicted refusals: issue 5."""


@dataclass(frozen=True)
class Tally:
    """Counts of trials."""

    by_rule: dict[str, Counter[str]]
    """Number of trials per verdict, by rule, in the usual order of the rules."""
    disagreements: tuple[str, ...]
    """One line per failed, contradicted or broken trial, in the order of the seeds."""

    def count(self, *verdicts: str) -> int:
        """Number of trials with any of the given verdicts; without an argument, of every verdict."""
        return sum(counts[verdict] for counts in self.by_rule.values() for verdict in verdicts or VERDICTS)

    def of_rule(self, rule: str) -> "Tally":
        """Counts of one rule, without its disagreements."""
        return Tally({rule: self.by_rule[rule]}, ())

    @property
    def planned(self) -> int:
        """Number of plans."""
        return self.count("passes", "fails")

    @property
    def refused(self) -> int:
        """Number of refusals."""
        return self.count("proved", "not found", "found")

    @property
    def passes(self) -> bool:
        """Whether every plan passes, few enough refusals are contradicted, and no trial is broken."""
        contradicted = self.count("found") <= CONTRADICTED_MOST * self.refused
        return self.count("fails") == 0 and self.count("broken") == 0 and contradicted


def tally(trials: Iterable[Trial]) -> Tally:
    """Count trials."""
    ordered = sorted(trials, key=lambda trial: trial.seed)
    rules = [rule for rule in RULES if any(trial.rule == rule for trial in ordered)]
    by_rule = {rule: Counter(trial.verdict for trial in ordered if trial.rule == rule) for rule in rules}
    return Tally(by_rule, tuple(_line(trial) for trial in ordered if trial.verdict in ("fails", "found", "broken")))


def _line(trial: Trial) -> str:
    label = f"seed {trial.seed} ({trial.size} aircraft, {trial.rule})"
    if trial.verdict == "fails":
        return f"{label}: the plan breaks {'; '.join(_breach(breach) for breach in trial.breaches)}"
    if trial.verdict == "broken":
        return f"{label}: {'; '.join(trial.reasons)}"
    violations = "; ".join(f"{constraint} of {_listed(aircraft)}" for constraint, aircraft in trial.closest.items())
    nearest = f" (its closest try lacks {violations})" if violations else ""
    return (
        f"{label}: refused{nearest}, but there is a plan: {', '.join(_way(description) for description in trial.found)}"
    )


def _breach(breach: dict[str, Any]) -> str:
    when = "" if breach["time"] is None else f" at {breach['time']:.3f} s"
    amount = "" if breach["amount"] is None else f" by {breach['amount']:.4g} {breach['unit']}"
    return f"{breach['kind']} of {_listed(breach['who'])}{amount}{when}"


def _listed(aircraft: Sequence[int]) -> str:
    return ", ".join(map(str, aircraft))


def _way(description: dict[str, float]) -> str:
    """Description of one aircraft's path."""
    height = max(description["above_ends_m"], -description["below_ends_m"], key=abs)
    height_text = f", {abs(height):.0f} m {'above' if height > 0.0 else 'below'} its ends" if abs(height) > 30.0 else ""
    return (
        f"{description['arrival_s']:.1f} s by {description['length_of_straight']:.2f} of the straight line at "
        f"{description['speed_least_m_s']:.0f} to {description['speed_greatest_m_s']:.0f} m/s{height_text}"
    )
