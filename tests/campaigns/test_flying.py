"""Campaigns with synthetic flights: complete, resumed with bit-identical results, and refused for other studies."""

import multiprocessing

import numpy as np
import pytest
import xarray as xr

from anser import campaigns
from anser.campaigns import Campaign, StoreError, flights
from anser.campaigns.estimates import _causes
from anser.campaigns.flights import create_store, dispersed_scenario, flight_scenario, fly_campaign
from anser.campaigns.replay import replay_differences, row_differences
from anser.campaigns.store import _WIDTHS, CampaignStore, shortened
from anser.config import ScenarioError
from anser.simulation.closed_loop import STATUS_MESSAGES
from campaigns.study_cases import THREE, made_up, study_of
from support.wind_files import metric_file

FLIGHTS, CHUNK = 50, 8


@pytest.fixture(autouse=True)
def made_up_flights(monkeypatch):
    monkeypatch.setattr(flights, "fly_many", made_up)
    monkeypatch.setattr(flights, "BATCH", CHUNK)


def new_store(folder, **changes):
    folder.mkdir()
    study = study_of(**{"sampling": {"flights": FLIGHTS}, **changes})
    return create_store(folder, study, THREE, {})


def test_every_flight_has_a_row_with_the_applied_values(tmp_path):
    store = new_store(tmp_path / "out")
    messages = []
    fly_campaign(store, progress=lambda message, part: messages.append((message, part)))
    data = store.dataset()
    assert data["flight"].values.tolist() == list(range(FLIGHTS))
    assert messages[0] == ("0 of 50 flights", 0.0)
    assert messages[-1] == ("50 of 50 flights", 1.0)
    for k in range(FLIGHTS):
        scenario = flight_scenario(store, k)
        assert scenario.wind.speed_m_s == data["wind.speed_m_s"].values[k]
        assert scenario.seed == data["seed"].values[k]
        (flight_row,) = made_up([flights.FlightCase(scenario)])
        assert data["reason"].values[k] == flight_row.reason
        if not flight_row.reason:
            assert data["miss_m"].values[k, 1] == flight_row.aircraft[1]["miss_m"]


def test_an_interrupted_campaign_is_resumed_bit_identically(tmp_path, monkeypatch):
    whole = new_store(tmp_path / "whole")
    fly_campaign(whole)
    rng = np.random.default_rng(3)
    store = new_store(tmp_path / "parts")
    interrupted = 0
    while not store.chunk_is_complete.all():
        remaining = int(rng.integers(0, 3))

        def sometimes(cases, progress=None, batch=None, series=None, precision="float64", outputs=None):
            nonlocal remaining
            if remaining == 0:
                raise KeyboardInterrupt
            remaining -= 1
            return made_up(cases, series=series)

        monkeypatch.setattr(flights, "fly_many", sometimes)
        try:
            fly_campaign(store)
        except KeyboardInterrupt:
            interrupted += 1
            partial = Campaign(store)
            assert partial.estimates().flown == store.flown.size == partial.dataset.sizes["flight"]
    assert interrupted > 2
    xr.testing.assert_identical(store.dataset(), whole.dataset())


def test_a_chunk_without_its_record_is_flown_again(tmp_path):
    store = new_store(tmp_path / "out")
    fly_campaign(store)
    whole = store.dataset()
    store._checksums.forget_chunk(2)
    store._array("miss_m")[16:24] = -1.0  # half written
    store._array("flown")[16:24] = False
    assert store.dataset().sizes["flight"] == FLIGHTS - CHUNK
    fly_campaign(CampaignStore.open(tmp_path / "out"))
    xr.testing.assert_identical(store.dataset(), whole)


def test_an_invalid_scenario_is_a_failed_flight_with_a_reason(tmp_path):
    wide = {"path": "wind.speed_m_s", "distribution": "uniform", "low": -20.0, "high": 20.0}
    store = new_store(tmp_path / "out", vary=[wide])
    fly_campaign(store)
    data, estimates = store.dataset(), Campaign(store).estimates()
    bad = data["wind.speed_m_s"].values < 0.0
    assert 0 < bad.sum() < FLIGHTS
    assert all("wind.speed_m_s: arrived -" in str(reason) for reason in data["reason"].values[bad])
    assert not data["met"].values[bad].any()
    assert estimates.flown == FLIGHTS
    assert estimates.met == int(data["met"].sum())
    assert estimates.high < 1.0 - bad.mean() + 0.2
    with pytest.raises(ScenarioError):
        flight_scenario(store, int(np.flatnonzero(bad)[0]))


def test_estimates_count_failures_as_the_worst(tmp_path):
    store = new_store(tmp_path / "out")
    fly_campaign(store)
    data, estimates = store.dataset(), Campaign(store).estimates()
    began = data["reason"].values == ""
    assert (~began).sum() > 0
    (miss,) = [quantile for quantile in estimates.quantiles if quantile.name == "miss_m" and quantile.share == 0.5]
    worst = np.where(began, data["miss_m"].values.max(axis=1), np.inf)
    assert miss.value == np.sort(worst)[24]
    assert miss.low < miss.value < miss.high
    assert estimates.causes["could not begin: made up: could not begin"] == (~began).sum()
    assert estimates.causes["not met: miss_max_m"] == (~data["met"].values & began).sum()
    assert set(estimates.worst[: int((~began).sum())]) == set(np.flatnonzero(~began).tolist())


def test_a_different_study_scenario_or_version_is_refused(tmp_path, monkeypatch):
    store = new_store(tmp_path / "out")
    study = study_of(sampling={"flights": FLIGHTS})
    values = flights.applied_values(study, THREE, {})
    store.refuse_unless_same(study, THREE)
    store.refuse_other_values(values)
    with pytest.raises(StoreError, match="other values"):
        store.refuse_other_values({"wind.speed_m_s": values["wind.speed_m_s"] + 1.0})
    with pytest.raises(StoreError, match="study"):
        store.refuse_unless_same(study_of(sampling={"flights": FLIGHTS}, seed=2), THREE)
    with pytest.raises(StoreError, match="the precision float64; expected float32, to go on with it"):
        store.refuse_unless_same(study_of(sampling={"flights": FLIGHTS}, precision="float32"), THREE)
    with pytest.raises(StoreError, match="scenario"):
        store.refuse_unless_same(study, THREE.replace("fleet.speed_m_s", 151.0))
    monkeypatch.setattr(campaigns.store_integrity, "version_attributes", lambda: {"version_anser": "9.9"})
    with pytest.raises(StoreError, match=r"expected 9\.9"):
        store.refuse_unless_same(study, THREE)
    with pytest.raises(StoreError, match=r"expected 9\.9"):
        flights.fly_chunk(store.folder, 0)  # a worker of another version
    with pytest.raises(StoreError, match="a folder without"):
        CampaignStore.open(tmp_path)


def test_insufficient_disk_space_is_refused_before_flying(tmp_path, monkeypatch):
    monkeypatch.setattr(campaigns.store.shutil, "disk_usage", lambda folder: type("Free", (), {"free": 1000})())
    with pytest.raises(StoreError, match=r"0\.001 MB free; expected 0\."):
        new_store(tmp_path / "out")


def test_a_replayed_flight_is_compared_with_its_row(tmp_path):
    store = new_store(tmp_path / "out")
    fly_campaign(store)
    number = int(np.flatnonzero(store.dataset()["met"].values)[0])
    (flight_row,) = made_up([flights.FlightCase(flight_scenario(store, number))])
    summary = {"aircraft": flight_row.aircraft, "fleet": flight_row.fleet, "requirements": flight_row.requirements}
    assert replay_differences(store, number, summary, met=True) == {}
    flight_row.aircraft[1]["miss_m"] += 1.0
    assert replay_differences(store, number, summary, met=False) == {"miss_m": pytest.approx(1e-4), "met": "True"}
    with pytest.raises(ValueError, match="arrived 50; expected one from 0 to 49"):
        flight_scenario(store, FLIGHTS)


def test_a_status_that_is_stored_shortened_is_no_difference(tmp_path):
    store = new_store(tmp_path / "out")
    fly_campaign(store)
    data = store.dataset().load()
    number = int(np.flatnonzero(data["met"].values)[0])
    (flight_row,) = made_up([flights.FlightCase(flight_scenario(store, number))])
    status = "the aircraft reached the ground; later samples repeat the last state; then " + 100 * "so on, "
    flight_row.aircraft[0]["status"] = status
    assert set(row_differences(data, number, flight_row)) == {"status"}
    data["status"][{"flight": number, "aircraft": 0}] = shortened(np.array([status]), "status")[0]
    assert row_differences(data, number, flight_row) == {}


def test_stored_statuses_are_distinct():
    compounds = np.array([f"{first}; then {last}" for first in STATUS_MESSAGES for last in STATUS_MESSAGES])
    for texts in (np.array(STATUS_MESSAGES), compounds):
        stored = shortened(texts, "status")
        assert np.unique(stored).size == texts.size
        assert max(map(len, stored.tolist())) <= _WIDTHS["status"]


def test_a_dispersed_start_outside_the_wind_field_is_refused(tmp_path):
    grid = {"north": np.array([-1e4, 1e4]), "east": np.array([-1e4, 1e4]), "altitude": np.array([0.0, 5e3])}
    path = metric_file(tmp_path / "f.nc", lambda t, n, e, h: (0.0 * n, 0.0 * n, 0.0 * n), **grid)
    windy = THREE.replace("wind", {"field": str(path)})
    assert dispersed_scenario(windy, 1, {"aircraft[0].start.north_m": np.array([-8e3])}, 0).seed == 1
    with pytest.raises(ScenarioError, match="wind field"):
        dispersed_scenario(windy, 1, {"aircraft[0].start.north_m": np.array([-2e4])}, 0)


def test_an_aircraft_that_left_the_fleet_is_no_cause_of_a_failure():
    left = "left the fleet and flew its exit path"
    columns = {
        "met": ("flight", [False, False]),
        "reason": ("flight", ["", ""]),
        "status": (("flight", "aircraft"), [["arrived", left], [f"{left}; then the motion diverged", "arrived"]]),
        "unmet": ("flight", ["miss_max_m", ""]),
    }
    assert _causes(xr.Dataset(columns)) == {"not met: miss_max_m": 1, f"{left}; then the motion diverged": 1}


def test_flights_are_flown_in_the_precision_of_the_study(tmp_path, monkeypatch):
    flown = []

    def noted(cases, progress=None, batch=None, series=None, precision="float64", outputs=None):
        flown.append(precision)
        return made_up(cases, series=series)

    monkeypatch.setattr(flights, "fly_many", noted)
    for precision in ("float64", "float32"):
        flown.clear()
        store = new_store(tmp_path / precision, precision=precision)
        fly_campaign(store)
        assert set(flown) == {precision}
        assert store.dataset().attrs["precision"] == precision
        assert (
            xr.open_zarr(store.folder / "flights.zarr", consolidated=False, chunks=None).attrs["precision"] == precision
        )
        # what rounding changes between a flight alone and one in a batch is more in float32
        number = int(np.flatnonzero(store.dataset()["met"].values)[0])
        (flight_row,) = made_up([flights.FlightCase(flight_scenario(store, number))])
        flight_row.aircraft[1]["miss_m"] += 1e-3
        summary = {"aircraft": flight_row.aircraft, "fleet": flight_row.fleet, "requirements": flight_row.requirements}
        assert (replay_differences(store, number, summary, met=True) == {}) == (precision == "float32")


def test_an_unsupported_precision_is_refused_before_flying(tmp_path):
    with pytest.raises(ScenarioError, match='precision: arrived "float32" of a round Earth'):
        create_store(tmp_path, study_of(precision="float32"), THREE.replace("earth", "wgs84"), {})


def test_a_campaign_leaves_no_processes(tmp_path):
    fly_campaign(new_store(tmp_path / "out"))
    assert not multiprocessing.active_children()


KEEP = {"series": ["position_error", "speed_limited"], "series_every_s": 0.5}


def test_series_of_every_flight_are_stored_in_float32(tmp_path):
    store = new_store(tmp_path / "out", keep=KEEP)
    fly_campaign(store)
    data, series = store.dataset(), Campaign(store).series
    assert dict(series.sizes) == {"flight": FLIGHTS, "aircraft": 3, "time": 301}
    assert series["time"].values[[0, 1, -1]].tolist() == [0.0, 0.5, 150.0]
    assert series["aircraft"].values.tolist() == data["aircraft"].values.tolist()
    assert series["position_error_m"].dtype == np.float32
    assert series["position_error_m"].attrs["units"] == "m"
    assert series["speed_limited"].dtype == np.int32
    assert series["speed_limited"].attrs["flag_meanings"] == "free limited"
    for k in range(FLIGHTS):
        (flight_row,) = made_up([flights.FlightCase(flight_scenario(store, k))], series=store.series_selection)
        stored = series["position_error_m"].values[k]
        if flight_row.reason:
            assert np.isnan(stored).all()
            assert (series["speed_limited"].values[k] == -1).all()
        else:
            np.testing.assert_array_equal(stored, flight_row.series["position_error"].astype(np.float32))


def test_series_are_resumed_with_the_campaign(tmp_path):
    whole, store = new_store(tmp_path / "whole", keep=KEEP), new_store(tmp_path / "parts", keep=KEEP)
    fly_campaign(whole)
    flights.fly_chunk(store.folder, 1)
    assert store.series()["flight"].values.tolist() == list(range(CHUNK, 2 * CHUNK))
    store._array("series/position_error_m")[16:24] = -1.0  # half written
    fly_campaign(CampaignStore.open(store.folder))
    xr.testing.assert_identical(store.series().load(), whole.series().load())
    store.refuse_unless_same(study_of(sampling={"flights": FLIGHTS}, keep=KEEP), THREE)
    changed_study = study_of(sampling={"flights": FLIGHTS}, keep={**KEEP, "series_every_s": 1.0})
    with pytest.raises(StoreError, match="study"):
        store.refuse_unless_same(changed_study, THREE)


def test_a_campaign_without_series_raises_an_error(tmp_path):
    store = new_store(tmp_path / "out")
    with pytest.raises(StoreError, match=r"arrived a campaign without series; expected one of a study that keeps some"):
        store.series()


@pytest.mark.parametrize(
    ("keep", "vary", "words"),
    [
        ({"series": ["airspeed"], "series_every_s": 0.015}, [], "keep.series_every_s: arrived 0.015; expected a whole"),
        (
            {"series": ["bank", "gust_u"]},
            [],
            r'keep.series\[1\]: arrived "gust_u"; expected a variable that a flight has',
        ),
        ({"series": ["goal_nis"]}, [], "takes a goal sensor with errors"),
        ({"series": ["heard_from"]}, [], "decentralised"),
        (
            {"series": ["bank"]},
            [{"path": "timing.duration_s", "distribution": "choice", "values": [150.0, 160.0]}],
            "times",
        ),
    ],
)
def test_series_that_no_flight_has_are_refused_before_flying(tmp_path, keep, vary, words):
    (tmp_path / "out").mkdir()
    with pytest.raises(ScenarioError, match=words):
        create_store(tmp_path / "out", study_of(keep=keep, vary=vary), THREE, {})
    assert not any((tmp_path / "out").iterdir())


def test_series_are_kept_where_a_setting_varies_that_leaves_their_times(tmp_path):
    (tmp_path / "out").mkdir()
    freeze = {"path": "timing.freeze_s", "distribution": "choice", "values": [2.0, 3.0]}
    store = create_store(tmp_path / "out", study_of(keep={"series": ["airspeed"]}, vary=[freeze]), THREE, {})
    assert store.series_selection.keys == ("airspeed",)


def test_series_that_some_flights_have_are_kept(tmp_path):
    (tmp_path / "out").mkdir()
    air = {"path": "turbulence.intensity", "distribution": "choice", "values": ["none", "light"]}
    store = create_store(tmp_path / "out", study_of(keep={"series": ["gust_u"]}, vary=[air]), THREE, {})
    assert store.series_selection.keys == ("gust_u",)


def test_the_required_disk_space_includes_series(tmp_path, monkeypatch):
    monkeypatch.setattr(campaigns.store.shutil, "disk_usage", lambda folder: type("Free", (), {"free": 300_000})())
    new_store(tmp_path / "without")
    with pytest.raises(StoreError, match="MB free; expected"):
        new_store(tmp_path / "with", keep=KEEP)
