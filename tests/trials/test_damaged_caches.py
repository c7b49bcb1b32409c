"""A sample of the trial of damaged caches, with every kind of damage, and the trial's detection of faults."""

from collections import Counter

import pytest

import trials.damaged_caches as damaged_caches
from anser.compiling.store import FolderStore
from trials.damaged_caches import DAMAGES, run_trial


@pytest.mark.long
def test_damaged_programs_are_rebuilt_and_untrusted_folders_ignored(tmp_path):
    outcomes = run_trial(len(DAMAGES), tmp_path)
    assert Counter(outcome.kind for outcome in outcomes) == dict.fromkeys(DAMAGES, 1)
    assert [outcome for outcome in outcomes if outcome.fault] == []


def test_a_store_without_checks_is_detected(tmp_path, monkeypatch):
    monkeypatch.setattr(damaged_caches, "DAMAGES", {"of another program": DAMAGES["of another program"]})
    monkeypatch.setattr(FolderStore, "load", _unchecked)
    (outcome,) = run_trial(1, tmp_path)
    assert outcome.fault


def _unchecked(store, key):
    try:
        return (store.folder / f"{key}.program").read_bytes()[48:]
    except OSError:
        return None


_unchecked.__module__ = "anser.compiling.store"  # or nothing would be kept


@pytest.mark.long
def test_a_thousand_mutations(tmp_path):
    assert [outcome for outcome in run_trial(1000, tmp_path) if outcome.fault] == []
