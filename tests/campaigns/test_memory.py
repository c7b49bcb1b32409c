"""As many processes and flights of a batch as memory holds, said in one line where it limits them."""

from pathlib import Path

import pytest

from anser.campaigns import flights
from anser.campaigns.flights import create_store
from anser.missions.series import SeriesSelection
from campaigns.study_cases import THREE, made_up, study_of, text_of

GB = 10**9


@pytest.fixture
def has(monkeypatch):
    """A machine of so much free memory and so many cores."""

    def made(free, cores=8):
        monkeypatch.setattr(flights, "available_memory", lambda: free)
        monkeypatch.setattr(flights, "usable_cores", lambda: cores)

    return made


def test_enough_memory_gives_a_process_for_each_core_and_nothing_is_said(has):
    has(64 * GB)
    assert flights.process_limit(THREE, 128) == flights.ProcessLimit(8, "")


def test_where_nothing_is_known_of_the_memory_cores_count(has):
    has(None)
    assert flights.process_limit(THREE, 128) == flights.ProcessLimit(8, "")
    assert flights.batch_size_for(128, THREE) == 128


def test_fewer_processes_where_memory_is_short(has):
    has(4 * GB)
    room = flights.process_limit(THREE, 128)
    assert room.processes == 2
    assert room.message.startswith(
        "memory: 4,000 MB are free, and a process that flies 128 flights at a time takes 1,5"
    )
    assert room.message.endswith(": 2 fly, not one for each of 8 cores")


def test_one_flies_where_not_even_one_has_room(has):
    has(GB)
    room = flights.process_limit(THREE, 128)
    assert room.processes == 1
    assert "may be killed for want of memory" in room.message
    assert flights.batch_size_for(128, THREE) == 1


def test_a_batch_is_no_larger_than_one_process_has_room_for(has):
    twenty = SeriesSelection(tuple("abcdefgh"), 1)  # every step of 150 s
    has(int(2.5 * GB))
    small = flights.batch_size_for(128, THREE, twenty)
    assert 1 < small < 128
    assert flights.batch_size_for(128, THREE) == 128
    assert flights.process_limit(THREE, small, twenty).processes == 1
    assert "may be killed" not in flights.process_limit(THREE, small, twenty).message
    assert "may be killed" in flights.process_limit(THREE, small + 1, twenty).message


def test_the_chunk_of_a_campaign_is_what_memory_holds_and_stays(has, tmp_path, monkeypatch):
    monkeypatch.setattr(flights, "fly_many", made_up)
    keep = {"series": ["north", "east", "altitude", "airspeed", "bank", "alpha", "course"], "series_every_s": 0.01}
    has(int(2.2 * GB))
    study = study_of(sampling={"flights": 300}, keep=keep)
    store = create_store(tmp_path, study, THREE, {})
    assert 1 < store.chunk < 128
    has(64 * GB)
    assert flights.campaign_process_limit(store).processes == 8
    flights.fly_chunk(tmp_path, 0)
    assert store.flown.size == store.chunk


def test_the_command_says_it_in_one_line(has, anser, tmp_path, monkeypatch):
    monkeypatch.setattr(flights, "fly_many", made_up)
    monkeypatch.setattr(
        "anser.campaigns.campaign_report.write_campaign", lambda store, worst: []
    )  # the report takes three seconds
    has(2 * GB)
    (tmp_path / "three.toml").write_text((Path(__file__).parents[2] / "scenarios/three-aircraft.toml").read_text())
    (tmp_path / "study.toml").write_text(text_of(flights=4))
    _, _, said = anser("campaign", tmp_path / "study.toml", "--out", tmp_path / "out")
    (line,) = [one for one in said.splitlines() if one.startswith("memory: ")]
    assert "2,000 MB are free" in line
    _, _, said = anser("campaign", tmp_path / "study.toml", "--out", tmp_path / "other", "--processes", 1)
    assert "memory: " not in said
