"""Numbers of processes and of flights per batch limited by memory, with a single message."""

from pathlib import Path

import pytest

from anser.campaigns import flights, processes
from anser.campaigns.flights import create_store
from anser.missions.series import SeriesSelection
from campaigns.study_cases import THREE, made_up, study_of, text_of

GB = 10**9


@pytest.fixture
def set_machine(monkeypatch):
    """A machine with the given free memory and number of cores."""

    def set_limits(free_bytes, cores=8):
        monkeypatch.setattr(processes, "available_memory", lambda: free_bytes)
        monkeypatch.setattr(processes, "usable_cores", lambda: cores)

    return set_limits


def test_enough_memory_gives_one_process_per_core_silently(set_machine):
    set_machine(64 * GB)
    assert processes.process_limit(THREE, 128) == processes.ProcessLimit(8, "")


def test_cores_are_the_limit_if_the_memory_is_unknown(set_machine):
    set_machine(None)
    assert processes.process_limit(THREE, 128) == processes.ProcessLimit(8, "")
    assert processes.batch_size_for(128, THREE) == 128


def test_scarce_memory_reduces_the_number_of_processes(set_machine):
    set_machine(4 * GB)
    room = processes.process_limit(THREE, 128)
    assert room.processes == 2
    assert room.message.startswith(
        "memory: 4,000 MB are free, and a process that flies 128 flights at a time takes 1,5"
    )
    assert room.message.endswith(": 2 fly, not one for each of 8 cores")


def test_one_process_flies_even_without_enough_memory(set_machine):
    set_machine(GB)
    room = processes.process_limit(THREE, 128)
    assert room.processes == 1
    assert "may be killed for want of memory" in room.message
    assert processes.batch_size_for(128, THREE) == 1


def test_a_batch_fits_the_memory_of_one_process(set_machine):
    twenty = SeriesSelection(tuple("abcdefgh"), 1)  # every step of 150 s
    set_machine(int(2.5 * GB))
    small = processes.batch_size_for(128, THREE, twenty)
    assert 1 < small < 128
    assert processes.batch_size_for(128, THREE) == 128
    assert processes.process_limit(THREE, small, twenty).processes == 1
    assert "may be killed" not in processes.process_limit(THREE, small, twenty).message
    assert "may be killed" in processes.process_limit(THREE, small + 1, twenty).message


def test_the_chunk_size_is_set_by_memory_and_remains(set_machine, tmp_path, monkeypatch):
    monkeypatch.setattr(flights, "fly_many", made_up)
    keep = {"series": ["north", "east", "altitude", "airspeed", "bank", "alpha", "course"], "series_every_s": 0.01}
    set_machine(int(2.2 * GB))
    study = study_of(sampling={"flights": 300}, keep=keep)
    store = create_store(tmp_path, study, THREE, {})
    assert 1 < store.chunk < 128
    set_machine(64 * GB)
    assert flights.campaign_process_limit(store).processes == 8
    flights.fly_chunk(tmp_path, 0)
    assert store.flown.size == store.chunk


def test_the_command_reports_the_memory_limit_in_one_line(set_machine, anser, tmp_path, monkeypatch):
    monkeypatch.setattr(flights, "fly_many", made_up)
    monkeypatch.setattr(
        "anser.campaigns.campaign_report.write_campaign", lambda store, worst: []
    )  # the report takes three seconds
    set_machine(2 * GB)
    (tmp_path / "three.toml").write_text((Path(__file__).parents[2] / "scenarios/three-aircraft.toml").read_text())
    (tmp_path / "study.toml").write_text(text_of(flights=4))
    _, _, said = anser("campaign", tmp_path / "study.toml", "--out", tmp_path / "out")
    (line,) = [text for text in said.splitlines() if text.startswith("memory: ")]
    assert "2,000 MB are free" in line
    _, _, said = anser("campaign", tmp_path / "study.toml", "--out", tmp_path / "other", "--processes", 1)
    assert "memory: " not in said
