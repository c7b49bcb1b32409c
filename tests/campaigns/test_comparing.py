"""Two campaigns with paired seeds: counted by hand, told what differs, refused where they are no pairs."""

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


def test_pairs_are_counted_and_what_differs_is_named(tmp_path):
    one = flown(tmp_path / "one")
    other = flown(
        tmp_path / "other", THREE.replace("fleet.speed_m_s", 151.0), vary=[{**WIND, "high": 6.0}], precision="float32"
    )
    found = anser.compare_campaigns(one, tmp_path / "other")
    met = [each.dataset["met"].values for each in (one, other)]
    assert found.flights == FLIGHTS
    assert (found.first_only, found.second_only) == (int((met[0] & ~met[1]).sum()), int((~met[0] & met[1]).sum()))
    assert found.both + found.first_only + found.second_only + found.neither == FLIGHTS
    assert 0.0 < found.p_value <= 1.0
    # made up: the greatest miss of the three, infinite where a flight could not begin
    worst = [each.dataset["miss_m"].max("aircraft").fillna(np.inf).values for each in (one, other)]
    (miss, spread) = found.differences
    assert miss.second_better == int((worst[1] < worst[0]).sum())
    assert miss.first_better == int((worst[1] > worst[0]).sum())
    assert miss.alike == int((worst[1] == worst[0]).sum())
    assert miss.low < miss.share == miss.second_better / FLIGHTS < miss.high
    assert (spread.name, spread.unit) == ("arrival_spread_s", "s")
    (median,) = [one for one in miss.quantiles if one[0] == 0.5]
    assert median[2] < median[1] < median[3]
    assert found.applied == {"wind.speed_m_s": FLIGHTS}
    assert found.scenario == (("fleet.speed_m_s", 150.0, 151.0),)
    assert found.precision == ("float64", "float32")
    told = found.as_dict()
    assert told["differences"][0]["quantiles"][0]["share"] == 0.5
    assert told["scenario"] == [{"path": "fleet.speed_m_s", "first": 150.0, "second": 151.0}]
    assert {path.name for path in draw_paired(found.dataset, tmp_path)} == {"comparison.svg", "comparison.png"}


def test_a_campaign_beside_itself_differs_in_nothing(tmp_path):
    one = flown(tmp_path / "one")
    found = anser.compare_campaigns(one, one)
    assert (found.first_only, found.second_only, found.p_value) == (0, 0, 1.0)
    assert all(each.alike == FLIGHTS and each.share == 0.0 for each in found.differences)
    assert all(value == 0.0 for each in found.differences for _, value, *_ in each.quantiles)
    assert found.applied == {}
    assert found.scenario == ()


def test_what_is_no_pair_is_refused(tmp_path):
    one = flown(tmp_path / "one")
    with pytest.raises(ValueError, match="arrived campaigns of 60 and 20 flights"):
        anser.compare_campaigns(one, flown(tmp_path / "few", sampling={"flights": 20}))
    with pytest.raises(ValueError, match=r"60 of 60 flights have other seeds .*of the seeds 1 and 2"):
        anser.compare_campaigns(one, flown(tmp_path / "seed", seed=2))
    (tmp_path / "begun").mkdir()
    create_store(tmp_path / "begun", study_of(sampling={"flights": FLIGHTS}), THREE, {})
    with pytest.raises(ValueError, match="without a flight that was flown in both"):
        anser.compare_campaigns(one, tmp_path / "begun")
    with pytest.raises(StoreError, match="a folder without"):
        anser.compare_campaigns(one, tmp_path)
