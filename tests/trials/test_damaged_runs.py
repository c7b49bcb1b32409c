"""A sample of the trial of damaged files: every file is refused, repaired or read correctly."""

import pytest

from anser.campaigns import flights, rare_flights
from trials.damaged_runs import TRIALS, tried


@pytest.mark.long
@pytest.mark.parametrize("kind", TRIALS)
def test_no_damage_passes_silently(kind, tmp_path, monkeypatch):
    # the trial puts made-up flights in their places
    for module in (flights, rare_flights):
        monkeypatch.setattr(module, "fly_many", module.fly_many)
    monkeypatch.setattr(flights, "BATCH", flights.BATCH)
    counts, failures = tried(TRIALS[kind](tmp_path), range(1000, 1022))
    assert failures == []
    assert sum(counts.values()) == 22
    assert counts["repaired" if kind in ("store", "rare") else "refused"] > 10
