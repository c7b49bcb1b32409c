"""Running a check of `anser verify` as a test."""

from anser.verification import Check, verify
from anser.verification.checks import Comparison


def assert_passes(check: Check, count: int) -> tuple[Comparison, ...]:
    """Fail with all that falls short; return the comparisons, of which there must be `count`."""
    (outcome,) = verify(checks=[check])
    assert outcome.problem is None
    short = [f"{c.group}, {c.point}: {c.obtained} not {c.expected}" for c in outcome.comparisons if not c.passes]
    assert short == []
    assert len(outcome.comparisons) == count
    assert outcome.passes
    return outcome.comparisons
