"""What came of many trials: counts by rule of arrival, and everything in which planner and judges disagree."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from trials.data import RULES
from trials.runner import VERDICTS, Trial

__all__ = ["CONTRADICTED_MOST", "Tally", "tally"]

CONTRADICTED_MOST = 0.02
"""Part of the refusals for which the search may find a plan: issue 5."""


@dataclass(frozen=True)
class Tally:
    """Counts of trials."""

    by_rule: dict[str, Counter[str]]
    """By rule, how many trials have each verdict; rules that occur, in their usual order."""
    disagreements: tuple[str, ...]
    """One line for each trial that fails, is contradicted or broken, in the order of the seeds."""

    def count(self, *verdicts: str) -> int:
        """Trials with one of some verdicts; without any, all."""
        return sum(found[one] for found in self.by_rule.values() for one in verdicts or VERDICTS)

    def of_rule(self, rule: str) -> "Tally":
        """Counts of one rule, without its disagreements."""
        return Tally({rule: self.by_rule[rule]}, ())

    @property
    def planned(self) -> int:
        """Plans returned."""
        return self.count("passes", "fails")

    @property
    def refused(self) -> int:
        """Refusals."""
        return self.count("proved", "not found", "found")

    @property
    def passes(self) -> bool:
        """Whether all plans pass, the search contradicts few enough refusals, and nothing broke."""
        contradicted = self.count("found") <= CONTRADICTED_MOST * self.refused
        return self.count("fails") == 0 and self.count("broken") == 0 and contradicted


def tally(trials: Iterable[Trial]) -> Tally:
    """Count trials."""
    ordered = sorted(trials, key=lambda one: one.seed)
    rules = [rule for rule in RULES if any(one.rule == rule for one in ordered)]
    by_rule = {rule: Counter(one.verdict for one in ordered if one.rule == rule) for rule in rules}
    return Tally(by_rule, tuple(_line(one) for one in ordered if one.verdict in ("fails", "found", "broken")))


def _line(trial: Trial) -> str:
    about = f"seed {trial.seed} ({trial.size} aircraft, {trial.rule})"
    if trial.verdict == "fails":
        return f"{about}: the plan breaks {'; '.join(_breach(one) for one in trial.breaches)}"
    if trial.verdict == "broken":
        return f"{about}: {'; '.join(trial.reasons)}"
    lacks = "; ".join(f"{what} of {_listed(who)}" for what, who in trial.closest.items())
    nearest = f" (its closest try lacks {lacks})" if lacks else ""
    return f"{about}: refused{nearest}, but there is a plan: {', '.join(_way(row) for row in trial.found)}"


def _breach(breach: dict[str, Any]) -> str:
    when = "" if breach["time"] is None else f" at {breach['time']:.3f} s"
    amount = "" if breach["amount"] is None else f" by {breach['amount']:.4g} {breach['unit']}"
    return f"{breach['kind']} of {_listed(breach['who'])}{amount}{when}"


def _listed(who: Sequence[int]) -> str:
    return ", ".join(map(str, who))


def _way(row: dict[str, float]) -> str:
    """One aircraft of a plan that was found."""
    height = max(row["above_ends_m"], -row["below_ends_m"], key=abs)
    beside = f", {abs(height):.0f} m {'above' if height > 0.0 else 'below'} its ends" if abs(height) > 30.0 else ""
    return (
        f"{row['arrival_s']:.1f} s by {row['length_of_straight']:.2f} of the straight line at "
        f"{row['speed_least_m_s']:.0f} to {row['speed_greatest_m_s']:.0f} m/s{beside}"
    )
