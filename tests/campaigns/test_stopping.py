"""The rule that stops a campaign: as early as asked, whatever the order, and what it costs in coverage."""

import numpy as np
import pytest

from anser.campaigns import flights
from anser.campaigns.flights import create_store, fly_campaign
from anser.campaigns.store import count_converged_chunks
from anser.config import ScenarioError
from anser.results.sampling_statistics import wilson_interval
from campaigns.study_cases import THREE, made_up, study_of

UNTIL = {"statistic": "met", "width": 0.1, "at_least": 100}


def test_it_stops_at_the_first_chunk_that_is_enough():
    study, met = study_of(until=UNTIL), np.ones(1000, dtype=bool)
    found = count_converged_chunks(study, np.ones(100, dtype=bool), 10, met)
    assert found == 10  # at_least
    met[::5] = False
    found = count_converged_chunks(study, np.ones(100, dtype=bool), 10, met)
    widths = [np.subtract(*wilson_interval(int(met[: 10 * k].sum()), 10 * k)[::-1]) for k in (found - 1, found)]
    assert widths[1] <= 0.1 < widths[0]


def test_chunks_count_in_their_order():
    study, done = study_of(until=UNTIL), np.ones(100, dtype=bool)
    done[5] = False
    assert count_converged_chunks(study, done, 10, np.ones(1000, dtype=bool)) is None
    assert count_converged_chunks(study_of(), done, 10, np.zeros(0)) is None


def test_a_miss_that_is_not_known_is_the_worst():
    study = study_of(until={"statistic": "miss_m", "share": 0.5, "width": 0.5, "at_least": 10})
    values = np.ones(100)
    assert count_converged_chunks(study, np.ones(10, dtype=bool), 10, values) == 1
    values[::2] = np.inf
    values[1::4] = np.inf
    assert count_converged_chunks(study, np.ones(10, dtype=bool), 10, values) is None


def test_a_campaign_ends_when_it_is_enough(tmp_path, monkeypatch):
    monkeypatch.setattr(flights, "fly_many", made_up)
    monkeypatch.setattr(flights, "BATCH", 8)
    study = study_of(sampling={"flights": 400}, until={"width": 0.3, "at_least": 20})
    store = create_store(tmp_path, study, THREE, {})
    fly_campaign(store)
    flown = store.flown.size
    assert 20 <= flown < 100
    low, high = wilson_interval(int(store.dataset()["met"].sum()), flown)
    assert high - low <= 0.3
    fly_campaign(store)  # there is nothing left to do
    assert store.flown.size == flown
    # a chunk that another process had under way does not count
    flights.fly_chunk(tmp_path, store.converged_chunks)
    assert store.flown.size == flown


def test_looking_often_costs_little_coverage():
    """Measured: 4,000 campaigns of probability 0.9, looked at every 10 flights, with intervals of 95 %."""
    study, truth, rng = study_of(until=UNTIL), 0.9, np.random.default_rng(5)
    covered = 0
    for _ in range(4000):
        met = rng.random(600) < truth
        count = 10 * count_converged_chunks(study, np.ones(60, dtype=bool), 10, met)
        low, high = wilson_interval(int(met[:count].sum()), count)
        covered += low <= truth <= high
    # 95.9 % with this seed; four standard deviations of the estimate are 1.3 %
    assert 0.946 <= covered / 4000 <= 0.972


def test_a_rule_for_a_sample_that_is_even_as_a_whole_is_refused():
    with pytest.raises(ScenarioError, match="only of plain Monte Carlo"):
        study_of(sampling={"method": "sobol", "flights": 64}, until=UNTIL)
