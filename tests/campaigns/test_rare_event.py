"""Rare events with synthetic flights: known probabilities, bit-identical resumption, and refusals."""

import json

import numpy as np
import pytest

from anser.campaigns import StoreError, campaign, load_study, rare, rare_flights, read_rare
from anser.campaigns.rare_events import open_rare_store
from anser.campaigns.rare_flights import RareFlights, RareStore
from anser.campaigns.subset import SubsetPlan
from anser.config import ScenarioError
from anser.results.flight_rows import FlightRow
from anser.simulation.closed_loop import OUTSIDE_WIND, STATUS_MESSAGES
from campaigns.rare_cases import ABOVE, BELOW, RARE_TEXT, made_up, rare_study
from campaigns.study_cases import STUDIES, THREE


@pytest.fixture(autouse=True)
def made_up_flights(monkeypatch):
    monkeypatch.setattr(rare_flights, "fly_many", made_up)


@pytest.fixture
def study(tmp_path):
    (tmp_path / "three.toml").write_text((STUDIES.parent / "scenarios" / "three-aircraft.toml").read_text())
    (tmp_path / "study.toml").write_text(RARE_TEXT)
    return tmp_path / "study.toml"


def test_the_shipped_study_is_valid():
    study, scenario, _ = load_study(STUDIES / "how-rarely.toml")
    flights = RareFlights(study, scenario)
    assert flights.plan == SubsetPlan(points=200, share=0.1, levels_max=10, repetitions=5)
    assert flights.batch == 50
    assert flights.threshold == 2.0
    flights.refuse_early()


def test_a_known_probability_is_estimated_and_documented(study, tmp_path):
    messages = []
    event = rare(study, tmp_path / "out", processes=1, progress=lambda message, part: messages.append((message, part)))
    assert event.estimate.low < 1e-2 < event.estimate.high
    assert event.probability_of(4.5).probability == pytest.approx(0.5, abs=0.1)
    threshold = event.flights.config.threshold
    for extreme in (threshold + 0.1, np.nan):
        with pytest.raises(
            ValueError, match=rf"threshold: arrived {extreme}; expected at most {threshold:g}, the study"
        ):
            event.probability_of(extreme)
    document = json.loads((tmp_path / "out" / "rare.json").read_text())
    assert document == json.loads(json.dumps(event.document))
    assert document["probability"] == event.estimate.probability
    assert document["seed"] == 1
    assert document["scenario_hash"] == THREE.hash
    assert document["levels"][0] == {
        "flights": 300,
        "bounds": [None] * 3,
        "shares": document["levels"][0]["shares"],
        "acceptances": [None] * 3,
    }
    assert document["levels"][1]["flights"] == 270
    assert all(7.5 < bound < 8.5 for bound in document["levels"][1]["bounds"])
    assert document["flights"] == event.store.flown
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"rare.json", "rare.svg", "rare.png"}
    assert messages[0] == ("level 1: 30 of 300 flights", 0.1)
    assert ("level 2: 270 of 270 flights", 1.0) in messages
    # the worst again: the same flight
    worst = document["worst"][0]
    assert worst["miss_m"] > 8.91
    (flight_row,) = made_up([event.worst()])
    assert max(result["miss_m"] for result in flight_row.aircraft) == pytest.approx(worst["miss_m"], rel=1e-12)
    with pytest.raises(ValueError, match="rank: arrived 10; expected one from 0 to 9"):
        event.worst(10)
    assert read_rare(tmp_path / "out").document == event.document


@pytest.mark.long
@pytest.mark.usefixtures("undrawn_figures")
def test_an_interrupted_analysis_is_resumed_bit_identically(study, tmp_path, monkeypatch):
    whole = rare(study, tmp_path / "whole", processes=1)
    flown = 0

    def sometimes(cases, batch=None, precision="float64"):
        nonlocal flown
        flown += 1
        if flown % 7 == 0:
            raise KeyboardInterrupt
        return made_up(cases)

    monkeypatch.setattr(rare_flights, "fly_many", sometimes)
    interrupted, event = 0, None
    while event is None:
        try:
            event = rare(study, tmp_path / "parts", processes=1, resume=interrupted > 0)
        except KeyboardInterrupt:
            interrupted += 1
    assert interrupted > 2
    assert event.document == whole.document
    # none was flown twice: what was interrupted counts once more
    assert flown - interrupted == whole.store.flown // whole.flights.batch
    (tmp_path / "parts" / "flown" / "000000030.npy").unlink()
    with pytest.raises(StoreError, match=r"arrived the batch from flight 30 on of which .*/000000030\.npy is missing"):
        read_rare(tmp_path / "parts")
    (tmp_path / "parts" / "checksums" / "30.json").unlink()
    with pytest.raises(StoreError, match="arrived no batch from flight 30 on"):
        read_rare(tmp_path / "parts")


def test_an_unsuitable_store_is_not_resumed(study, tmp_path, monkeypatch):
    open_rare_store(study, tmp_path / "out", resume=False)
    with pytest.raises(FileExistsError):
        rare(study, tmp_path / "out", processes=1)
    with pytest.raises(StoreError, match="a folder without flown; expected that of a rare event"):
        rare(study, tmp_path, processes=1, resume=True)
    study.write_text(RARE_TEXT.replace("seed = 1", "seed = 2"))
    with pytest.raises(StoreError, match="a rare event with the study hash"):
        rare(study, tmp_path / "out", processes=1, resume=True)
    study.write_text(RARE_TEXT)
    monkeypatch.setattr("anser.campaigns.store_integrity.version_attributes", lambda: {"version_anser": "9.9"})
    with pytest.raises(StoreError, match=r"version anser .*; expected 9\.9, to go on with it"):
        rare(study, tmp_path / "out", processes=1, resume=True)
    RareStore.open(tmp_path / "out").write(0, np.zeros(2))
    with pytest.raises(StoreError, match="arrived 2 flights; expected 30"):
        read_rare(tmp_path / "out")


@pytest.mark.usefixtures("undrawn_figures")
def test_a_breach_below_the_threshold_is_estimated(study, tmp_path):
    text = RARE_TEXT.replace("miss_m", "separation_min_m").replace("8.91", "500.09")
    study.write_text(text)
    event = rare(study, tmp_path / "out", processes=1)
    assert event.estimate.low < 1e-2 < event.estimate.high
    assert event.document["breached"] == "below"
    thresholds = event.dataset["threshold"].values
    assert thresholds[0] > 503.0
    assert thresholds[-1] == 500.09
    assert np.all(np.diff(event.dataset["probability"].values) <= 1e-12)


@pytest.mark.usefixtures("undrawn_figures")
def test_an_event_rarer_than_the_levels_gives_an_upper_bound(study, tmp_path):
    study.write_text(RARE_TEXT.replace("8.91", "20.0").replace("repetitions", "levels_max = 2\nrepetitions"))
    event = rare(study, tmp_path / "out", processes=1)
    assert event.estimate.probability is None
    assert event.estimate.low == 0.0
    assert 0.05 < event.estimate.high < 0.3
    assert event.document["probability"] is None
    assert np.isfinite(event.dataset["probability"].values[:-1]).all()


def test_failed_flights_count_as_the_event():
    flights = RareFlights(
        rare_study(vary=[{"path": "wind.speed_m_s", "distribution": "normal", "mean": 0.0, "sigma": 3.0}]), THREE
    )
    points = flights.space.sample(np.arange(20))
    values, winds = flights.fly(points), 3.0 * flights.space.dispersions(points, 1)[:, 0]
    assert 3 < np.sum(winds < 0.0) < 17
    np.testing.assert_array_equal(np.isinf(values), winds < 0.0)
    np.testing.assert_allclose(values[winds >= 0.0], winds[winds >= 0.0], rtol=1e-9)
    assert flights.limit_state_value(FlightRow.failed_start("no plan")) == np.inf
    (flight_row,) = made_up([flights.case(points[int(np.argmax(winds))])])
    assert np.isfinite(flights.limit_state_value(flight_row))
    flight_row.aircraft[1]["status"] = "the aircraft reached the ground; later samples repeat the last state"
    assert flights.limit_state_value(flight_row) == np.inf
    flight_row.aircraft[1]["status"] = STATUS_MESSAGES[OUTSIDE_WIND]
    assert flights.limit_state_value(flight_row) == np.inf
    flight_row.aircraft[1].update(status="arrived", miss_m=None)
    assert flights.limit_state_value(flight_row) == np.inf


def test_correlated_parameters_stay_correlated():
    course = {"path": "wind.from_deg", "distribution": "normal", "mean": 180.0, "sigma": 5.0}
    speed = {"path": "wind.speed_m_s", "distribution": "normal", "mean": 50.0, "sigma": 1.0}
    group = {"paths": ["wind.speed_m_s", "wind.from_deg"], "coefficients": [[1.0, 0.8], [0.8, 1.0]]}
    flights = RareFlights(rare_study(vary=[speed, course], correlated=[group]), THREE)
    applied = flights._applied(flights.space.sample(np.arange(4000)))
    assert np.corrcoef(*applied.values())[0, 1] == pytest.approx(0.8, abs=0.03)


@pytest.mark.parametrize(
    ("rare_table", "said"),
    [
        ({**ABOVE, "level_share": 0.3}, "rare.level_share: arrived 0.3; expected one over a whole number"),
        ({**ABOVE, "flights": 310}, "rare.flights: arrived 310; expected a multiple of 30"),
        ({**ABOVE, "flights": 30}, "300 at least"),
        ({**ABOVE, "repetitions": 1}, "rare.repetitions: arrived 1; expected a whole number from 3 to 100"),
        ({**ABOVE, "statistic": "speed"}, 'rare.statistic: arrived "speed"; expected "separation_min_m" or'),
        ({"statistic": "miss_m"}, "rare.threshold: arrived nothing; expected"),
    ],
)
def test_an_invalid_event_is_refused(rare_table, said):
    with pytest.raises(ScenarioError) as caught:
        rare_study(rare=rare_table)
    assert said in str(caught.value)


def test_an_unsuitable_scenario_is_refused_before_flying(study, tmp_path):
    single = THREE.replace("aircraft", [THREE.aircraft[0].model_dump(exclude_unset=True)])
    with pytest.raises(ScenarioError, match="a statistic of one aircraft, such as miss_m"):
        _ = RareFlights(rare_study(rare=BELOW), single).config
    with pytest.raises(ScenarioError, match="one whose flights can fly together"):
        _ = RareFlights(rare_study(), THREE.replace("fleet.planner", "decentralised")).config
    study.write_text(RARE_TEXT.replace("low = 0.0", "low = -9.0").replace("high = 9.0", "high = -5.0"))
    with pytest.raises(ScenarioError, match=r"toml, every flight: 1 problem\n  line 11, wind.speed_m_s"):
        rare(study, tmp_path / "out")
    study.write_text(RARE_TEXT)
    with pytest.raises(ScenarioError, match=r"sampling: arrived nothing; expected a table \[sampling\], to fly"):
        campaign(study, tmp_path / "out")
    study.write_text(RARE_TEXT[: RARE_TEXT.index("[rare]")] + "[sampling]\nflights = 4\n")
    with pytest.raises(ScenarioError, match=r"rare: arrived nothing; expected a table \[rare\]"):
        rare(study, tmp_path / "out")
    with pytest.raises(ScenarioError, match=r"sampling: arrived nothing; expected a table \[sampling\], or"):
        rare_study(rare=None)
    with pytest.raises(ScenarioError, match="until: arrived a table; expected none without"):
        rare_study(until={"width": 0.1})
    with pytest.raises(ScenarioError, match="keep: arrived a table; expected none without"):
        rare_study(keep={"worst": 3})
    assert not (tmp_path / "out").exists()
