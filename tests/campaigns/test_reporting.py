"""The report of a campaign with synthetic flights: page, tables, replays and archived flights."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest

from anser.campaigns import Campaign, campaign_report, replay
from anser.campaigns import flights as flying
from anser.campaigns.campaign_report import quantiles_over, write_campaign
from anser.campaigns.flights import create_store, fly_campaign
from anser.campaigns.replay import archive_worst
from anser.results import write_netcdf, write_summary
from campaigns.study_cases import THREE, WIND, made_up, study_of
from support.made_flight import make_flight

FLIGHTS = 60
EVIL = "</script><script>alert(1)</script>"
AIR = {"path": "aircraft[0].bend", "distribution": "choice", "values": ["left", "right"]}


@pytest.fixture(autouse=True)
def made_up_flights(monkeypatch):
    monkeypatch.setattr(flying, "fly_many", made_up)
    monkeypatch.setattr(flying, "BATCH", 20)


@pytest.fixture
def replays(monkeypatch):
    """Replace replays by synthetic flights; return the list of replayed scenarios."""
    numbers, (dataset, summary) = [], make_flight()

    def save(folder):
        folder.mkdir(parents=True)
        write_netcdf(dataset, folder / "flight.nc")
        write_summary(summary, folder / "summary.json")
        return folder

    def run(scenario, precision):
        numbers.append(scenario)
        return SimpleNamespace(dataset=dataset, summary=summary, save=save)

    def fly_many(cases, progress, batch, series, precision):
        numbers.extend(case.scenario for case in cases)
        progress("flying", 0.0)
        return made_up(cases, batch=batch, series=series)

    monkeypatch.setattr(campaign_report, "fly_many", fly_many)
    monkeypatch.setattr(replay, "run", run)
    return numbers


def new_store(folder, **changes):
    folder.mkdir()
    changes = {"sampling": {"flights": FLIGHTS}, "vary": [WIND, AIR], **changes}
    return create_store(folder, study_of(**changes), THREE, {})


def flown(folder, **changes):
    store = new_store(folder, **changes)
    fly_campaign(store)
    return store


def page_of(store):
    return (store.folder / "report.html").read_text(encoding="utf-8")


def data_of(page):
    (text,) = re.findall(r'<script type="application/json" id="campaign">(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def test_the_page_shows_the_estimates(tmp_path):
    store = flown(tmp_path / "out", description=EVIL)
    messages = []
    written = write_campaign(store, worst=0, progress=lambda message, part: messages.append(message))
    names = [
        "report.html",
        "campaign.svg",
        "campaign.png",
        "flights.parquet",
        "aircraft.parquet",
        "answers.parquet",
        "indices.parquet",
    ]
    assert [path.name for path in written] == names
    assert messages == ["writing"]
    page, estimates = page_of(store), Campaign(store).estimates()
    assert f"{estimates.met} of 60 flights met every requirement" in page
    assert f"{100 * estimates.low:.2f} to {100 * estimates.high:.2f} % at 95 % confidence" in page
    assert "could not begin: made up: could not begin" in page
    assert "Partial" not in page
    assert "None was flown again" in page
    assert EVIL not in page
    assert re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", page) is None
    begins = [k for k in estimates.worst if store.dataset()["reason"].values[k] == ""]
    for number in begins:
        assert f"anser run --campaign {store.folder} --flight {number}<" in page
    data = data_of(page)
    assert [item["path"] for item in data["inputs"]] == ["wind.speed_m_s", "aircraft[0].bend"]
    assert data["inputs"][1]["levels"] == ["left", "right"]
    assert data["met"]["n"][-1] == data["drawn"][1] == FLIGHTS
    (miss,) = [item for item in data["quantities"] if item["name"] == "miss_m"]
    assert len(miss["kept"]) == sum(store.dataset()["reason"].values == "")
    assert miss["converging"]["value"][-1] == next(
        item["value"] for item in miss["quantiles"] if item["share"] == miss["share"]
    )


@pytest.mark.usefixtures("undrawn_figures")
def test_a_partial_campaign_is_marked_with_its_number_of_flights(tmp_path):
    store = new_store(tmp_path / "out")
    flying.fly_chunk(store.folder, 1)
    write_campaign(store, worst=0)
    assert "<b>Partial: 20 of 60 flights.</b>" in page_of(store)
    assert data_of(page_of(store))["numbers"] == list(range(20, 40))


@pytest.mark.usefixtures("undrawn_figures")
def test_a_campaign_stopped_by_its_rule_is_not_partial(tmp_path):
    store = flown(tmp_path / "out", until={"width": 0.9, "at_least": 20})
    assert store.flown.size == 20
    write_campaign(store, worst=0)
    assert "Partial" not in page_of(store)
    assert "After 20 of 60 flights the interval was as narrow as the study requires." in page_of(store)


@pytest.mark.usefixtures("undrawn_figures")
def test_the_worst_flights_are_drawn_over_background_flights(tmp_path, replays):
    store = flown(tmp_path / "out")
    messages = []
    write_campaign(store, worst=2, background=4, progress=lambda message, part: messages.append((message, part)))
    data = store.dataset()
    misses = np.where(data["reason"].values == "", data["miss_m"].max("aircraft").values, -np.inf)
    worst = [int(k) for k in np.argsort(-misses)[:2]]
    page = page_of(store)
    assert re.findall(r'class="worst-track" data-flight="(\d+)"', page) == [str(number) for number in worst]
    assert page.count("<title>flight ") == len(replays)
    assert len(replays) == 6
    assert "did not come out as in the campaign" not in page
    assert [scenario.seed for scenario in replays[:2]] == data["seed"].values[worst].tolist()
    assert messages[0] == (f"flying {len(replays)} flights again", 0.0)
    assert messages[-1] == ("writing", None)


@pytest.mark.usefixtures("undrawn_figures")
def test_flights_with_different_replays_are_listed(tmp_path, monkeypatch):
    def otherwise(cases, progress, batch, series, precision):
        flight_rows = made_up(cases, batch=batch, series=series)
        flight_rows[1].aircraft[0]["miss_m"] += 1.0
        return flight_rows

    monkeypatch.setattr(campaign_report, "fly_many", otherwise)
    store = flown(tmp_path / "out")
    write_campaign(store, worst=2, background=1)
    second_worst = re.findall(r'class="worst-track" data-flight="(\d+)"', page_of(store))[1]
    assert f"Flown again, these did not come out as in the campaign: {second_worst}." in page_of(store)


@pytest.mark.usefixtures("undrawn_figures")
def test_stored_series_are_drawn_as_bands(tmp_path):
    store = flown(tmp_path / "out", keep={"series": ["position_error", "course", "phase"], "series_every_s": 2.0})
    write_campaign(store, worst=0)
    page, series, data = page_of(store), store.series(), store.dataset()
    assert "the band from 5 to 95 % of them" in page
    plotted = data_of(page)["series"]
    assert [item["name"] for item in plotted] == ["position_error_m", "course_deg"]  # a phase has no quantiles
    assert [item["unit"] for item in plotted] == ["m", "°"]
    assert plotted[0]["time"] == series["time"].values.tolist()
    began = data["reason"].values == ""
    assert 0 < began.sum() < FLIGHTS
    for k, item in enumerate(plotted[0]["aircraft"]):
        assert item["name"] == data["aircraft"].values[k]
        values = series["position_error_m"].values[began, k].astype(float)
        for share, end in ((0.05, "low"), (0.5, "middle"), (0.95, "high")):
            np.testing.assert_allclose(item[end], np.quantile(values, share, axis=0), rtol=1e-5)
    write_campaign(flown(tmp_path / "none"), worst=0)
    assert '<section id="series">' not in (tmp_path / "none" / "report.html").read_text(encoding="utf-8")


def test_bands_of_angles_are_continuous_at_the_wrap():
    around = np.array([178.0, 179.0, -180.0, -179.0, -178.0])
    angles = np.stack([around, around - 178.0], axis=1)[:, None, :] % 360.0
    low, middle, high = quantiles_over((angles + 180.0) % 360.0 - 180.0, circular=True)
    np.testing.assert_allclose(middle[0] % 360.0, [180.0, 2.0], atol=1e-9)
    np.testing.assert_allclose((high - low)[0], [3.6, 3.6])
    none = quantiles_over(np.full((3, 1, 2), np.nan), circular=False)
    assert np.isnan(none).all()


@pytest.mark.usefixtures("undrawn_figures")
def test_an_interrupted_report_has_no_map(tmp_path, monkeypatch):
    def interrupted(cases, progress, batch, series, precision):
        raise KeyboardInterrupt

    monkeypatch.setattr(campaign_report, "fly_many", interrupted)
    store = flown(tmp_path / "out")
    with pytest.raises(KeyboardInterrupt):
        write_campaign(store, worst=2)
    assert "None was flown again" in page_of(store)


@pytest.mark.usefixtures("undrawn_figures")
def test_the_tables_hold_every_flight_and_estimate(tmp_path):
    store = flown(tmp_path / "out")
    write_campaign(store, worst=0)
    data, estimates = store.dataset(), Campaign(store).estimates()
    flights = pq.read_table(store.folder / "flights.parquet")
    assert flights.num_rows == FLIGHTS
    np.testing.assert_array_equal(flights["wind.speed_m_s"], data["wind.speed_m_s"].values)
    np.testing.assert_array_equal(flights["met"], data["met"].values)
    assert np.isinf(np.array(flights["worst_miss_m"])[data["reason"].values != ""]).all()
    assert flights.schema.field("worst_miss_m").metadata[b"units"] == b"m"
    aircraft = pq.read_table(store.folder / "aircraft.parquet")
    assert aircraft.num_rows == 3 * FLIGHTS
    np.testing.assert_array_equal(aircraft["miss_m"], data["miss_m"].values.ravel())
    assert aircraft["aircraft"][:3].to_pylist() == data["aircraft"].values.tolist()
    answers = pq.read_table(store.folder / "answers.parquet").to_pylist()
    assert answers[0]["value"] == estimates.probability
    assert len(answers) == 1 + len(estimates.quantiles)
    assert json.loads(pq.read_schema(store.folder / "answers.parquet").metadata[b"causes"]) == estimates.causes
    indices = pq.read_table(store.folder / "indices.parquet").to_pylist()
    assert {record["path"] for record in indices} == {"wind.speed_m_s", "aircraft[0].bend"}
    assert {record["measure"] for record in indices} == {"rank"}


@pytest.mark.usefixtures("undrawn_figures")
def test_the_page_is_written_without_pyarrow(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign_report, "has_parquet", lambda: False)
    store = flown(tmp_path / "out", vary=[])
    assert [path.name for path in write_campaign(store, worst=0)] == ["report.html", "campaign.svg", "campaign.png"]


@pytest.mark.usefixtures("undrawn_figures")
def test_a_saltelli_campaign_reports_its_independent_flights(tmp_path):
    store = flown(tmp_path / "out", sampling={"method": "saltelli", "flights": 16})
    estimates = Campaign(store).estimates()
    assert (estimates.flown, estimates.independent) == (64, 32)
    alone = store.dataset()["met"].values.reshape(16, 4)[:, [0, 3]]
    assert estimates.probability == alone.mean()
    write_campaign(store, worst=0)
    page = page_of(store)
    assert "from the 32 flights that are independent of each other" in page
    assert "first index (narrow), total index (wide)" in page
    assert "one in its place would be made up" in page


@pytest.mark.usefixtures("undrawn_figures")
def test_a_partial_campaign_without_an_independent_flight_has_no_share(tmp_path, monkeypatch):
    monkeypatch.setattr(flying, "BATCH", 1)
    store = new_store(tmp_path / "out", sampling={"method": "saltelli", "flights": 16})
    flying.fly_chunk(store.folder, 1)  # of two workers, the second was faster
    assert Campaign(store).estimates().probability is None
    write_campaign(store, worst=0)
    assert "of 1 flights met every requirement" in page_of(store)
    assert "of the flights; " not in page_of(store)


@pytest.mark.usefixtures("undrawn_figures")
def test_the_worst_flights_are_archived_once(tmp_path, replays):
    store = flown(tmp_path / "out", keep={"worst": 3})
    folders = archive_worst(store)
    data = store.dataset()
    misses = np.where(data["reason"].values == "", data["miss_m"].max("aircraft").values, -np.inf)
    assert [folder.name for folder in folders] == [f"flight-{k:06d}" for k in np.argsort(-misses)[:3]]
    assert len(replays) == 3
    assert archive_worst(store) == folders
    assert len(replays) == 3
    write_campaign(store, worst=3, background=0)  # those kept are read, none is flown again
    assert len(replays) == 3
    assert page_of(store).count('class="worst-track"') == 3
    assert archive_worst(flown(tmp_path / "none")) == ()
