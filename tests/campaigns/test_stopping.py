"""The stopping rule of a campaign: earliest satisfied chunk, independence of the order, and cost in coverage."""

import numpy as np
import pytest

from anser.campaigns import flights
from anser.campaigns.flights import create_store, fly_campaign
from anser.campaigns.store import count_converged_chunks
from anser.config import ScenarioError
from anser.results.sampling_statistics import wilson_interval
from campaigns.study_cases import THREE, made_up, study_of

UNTIL = {"statistic": "met", "width": 0.1, "at_least": 100}


def test_the_rule_stops_at_the_first_sufficient_chunk():
    study, is_met = study_of(until=UNTIL), np.ones(1000, dtype=bool)
    count = count_converged_chunks(study, np.ones(100, dtype=bool), 10, is_met)
    assert count == 10  # at_least
    is_met[::5] = False
    count = count_converged_chunks(study, np.ones(100, dtype=bool), 10, is_met)
    widths = [np.subtract(*wilson_interval(int(is_met[: 10 * k].sum()), 10 * k)[::-1]) for k in (count - 1, count)]
    assert widths[1] <= 0.1 < widths[0]


def test_the_rule_requires_chunks_without_a_gap():
    study, is_complete = study_of(until=UNTIL), np.ones(100, dtype=bool)
    is_complete[5] = False
    assert count_converged_chunks(study, is_complete, 10, np.ones(1000, dtype=bool)) is None
    assert count_converged_chunks(study_of(), is_complete, 10, np.zeros(0)) is None


def test_an_unknown_miss_counts_as_the_worst():
    study = study_of(until={"statistic": "miss_m", "share": 0.5, "width": 0.5, "at_least": 10})
    values = np.ones(100)
    assert count_converged_chunks(study, np.ones(10, dtype=bool), 10, values) == 1
    values[::2] = np.inf
    values[1::4] = np.inf
    assert count_converged_chunks(study, np.ones(10, dtype=bool), 10, values) is None


def test_a_campaign_ends_when_the_rule_is_satisfied(tmp_path, monkeypatch):
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


@pytest.mark.long
def test_repeated_evaluation_costs_little_coverage():
    """Measured with 4,000 campaigns of probability 0.9, evaluated every 10 flights, with intervals of 95 %."""
    study, truth, rng = study_of(until=UNTIL), 0.9, np.random.default_rng(5)
    covered = 0
    for _ in range(4000):
        is_met = rng.random(600) < truth
        count = 10 * count_converged_chunks(study, np.ones(60, dtype=bool), 10, is_met)
        low, high = wilson_interval(int(is_met[:count].sum()), count)
        covered += low <= truth <= high
    # 95.9 % with this seed; four standard deviations of the estimate are 1.3 %
    assert 0.946 <= covered / 4000 <= 0.972


def test_the_arrival_spread_of_one_aircraft_is_no_rule(tmp_path):
    alone = THREE.replace("aircraft", [THREE.aircraft[0]], "goal", [THREE.goal[0]])
    study = study_of(until={"statistic": "arrival_spread_s", "share": 0.5, "width": 1.0})
    with pytest.raises(ScenarioError, match=r'until\.statistic: arrived "arrival_spread_s" of one aircraft'):
        create_store(tmp_path, study, alone, {})


def test_a_rule_for_low_discrepancy_samples_is_refused():
    with pytest.raises(ScenarioError, match="only of plain Monte Carlo"):
        study_of(sampling={"method": "sobol", "flights": 64}, until=UNTIL)
