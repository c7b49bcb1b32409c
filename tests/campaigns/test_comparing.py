"""Campaigns with paired seeds: counts, differences, and refusal of unpaired campaigns."""

import numpy as np
import pytest

import anser
from anser.campaigns import Campaign, StoreError, flights
from anser.campaigns.flights import create_store, fly_campaign
from anser.report.campaign_figures import draw_paired
from campaigns.study_cases import THREE, WIND, made_up, study_of

FLIGHTS = 60


@pytest.fixture(autouse=True)
def made_up_flights(monkeypatch):
    monkeypatch.setattr(flights, "fly_many", made_up)
    monkeypatch.setattr(flights, "BATCH", 20)


def flown(folder, scenario=THREE, **changes):
    folder.mkdir()
    store = create_store(folder, study_of(**{"sampling": {"flights": FLIGHTS}, **changes}), scenario, {})
    fly_campaign(store)
    return Campaign(store)


def test_pairs_are_counted_and_differences_are_listed(tmp_path):
    campaign_1 = flown(tmp_path / "one")
    campaign_2 = flown(
        tmp_path / "other", THREE.replace("fleet.speed_m_s", 151.0), vary=[{**WIND, "high": 6.0}], precision="float32"
    )
    comparison = anser.compare_campaigns(campaign_1, tmp_path / "other")
    is_met = [campaign.dataset["met"].values for campaign in (campaign_1, campaign_2)]
    assert comparison.flights == FLIGHTS
    assert (comparison.first_only, comparison.second_only) == (
        int((is_met[0] & ~is_met[1]).sum()),
        int((~is_met[0] & is_met[1]).sum()),
    )
    assert comparison.both + comparison.first_only + comparison.second_only + comparison.neither == FLIGHTS
    assert 0.0 < comparison.p_value <= 1.0
    # made up: the greatest miss of the three, infinite where a flight could not begin
    worst = [campaign.dataset["miss_m"].max("aircraft").fillna(np.inf).values for campaign in (campaign_1, campaign_2)]
    (miss, spread) = comparison.differences
    assert miss.second_better == int((worst[1] < worst[0]).sum())
    assert miss.first_better == int((worst[1] > worst[0]).sum())
    assert miss.alike == int((worst[1] == worst[0]).sum())
    assert miss.low < miss.share == miss.second_better / FLIGHTS < miss.high
    assert (spread.name, spread.unit) == ("arrival_spread_s", "s")
    (median,) = [quantile for quantile in miss.quantiles if quantile[0] == 0.5]
    assert median[2] < median[1] < median[3]
    assert comparison.applied == {"wind.speed_m_s": FLIGHTS}
    assert comparison.scenario == (("fleet.speed_m_s", 150.0, 151.0),)
    assert comparison.precision == ("float64", "float32")
    document = comparison.as_dict()
    assert document["differences"][0]["quantiles"][0]["share"] == 0.5
    assert document["scenario"] == [{"path": "fleet.speed_m_s", "first": 150.0, "second": 151.0}]
    assert {path.name for path in draw_paired(comparison.dataset, tmp_path)} == {"comparison.svg", "comparison.png"}


def test_a_campaign_compared_with_itself_has_no_differences(tmp_path):
    campaign = flown(tmp_path / "one")
    comparison = anser.compare_campaigns(campaign, campaign)
    assert (comparison.first_only, comparison.second_only, comparison.p_value) == (0, 0, 1.0)
    assert all(difference.alike == FLIGHTS and difference.share == 0.0 for difference in comparison.differences)
    assert all(value == 0.0 for difference in comparison.differences for _, value, *_ in difference.quantiles)
    assert comparison.applied == {}
    assert comparison.scenario == ()


def test_unpaired_campaigns_are_refused(tmp_path):
    campaign = flown(tmp_path / "one")
    with pytest.raises(ValueError, match="arrived campaigns of 60 and 20 flights"):
        anser.compare_campaigns(campaign, flown(tmp_path / "few", sampling={"flights": 20}))
    with pytest.raises(ValueError, match=r"60 of 60 flights have other seeds .*of the seeds 1 and 2"):
        anser.compare_campaigns(campaign, flown(tmp_path / "seed", seed=2))
    (tmp_path / "begun").mkdir()
    create_store(tmp_path / "begun", study_of(sampling={"flights": FLIGHTS}), THREE, {})
    with pytest.raises(ValueError, match="without a flight that was flown in both"):
        anser.compare_campaigns(campaign, tmp_path / "begun")
    with pytest.raises(StoreError, match="a folder without"):
        anser.compare_campaigns(campaign, tmp_path)
