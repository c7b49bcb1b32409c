"""Running a check of `anser verify` as a test."""

from anser.verification import Check, verify
from anser.verification.checks import Comparison


def assert_passes(check: Check, count: int) -> tuple[Comparison, ...]:
    """Verify a check and list the failed comparisons; return the comparisons, exactly `count`."""
    (outcome,) = verify(checks=[check])
    assert outcome.problem is None
    short = [f"{c.group}, {c.point}: {c.obtained} not {c.expected}" for c in outcome.comparisons if c.fails]
    assert short == []
    assert len(outcome.comparisons) == count
    assert outcome.passes
    return outcome.comparisons
