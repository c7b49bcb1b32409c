"""The command campaign end to end, with synthetic flights; with real flights in the long test."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray as xr

from anser.campaigns import StoreError, cluster
from anser.campaigns import flights as flying
from anser.campaigns.campaign_report import write_campaign
from anser.campaigns.estimates import QuantileEstimate
from anser.campaigns.store import CampaignStore
from anser.campaigns.store_integrity import StoreChecksums, folder_lock
from anser.cli.campaigns import _bound_cells
from campaigns.study_cases import STUDIES, made_up, text_of

KEPT = '[keep]\nseries = ["position_error", "airspeed", "phase"]\nseries_every_s = 0.7\n'
THREE = STUDIES.parent / "scenarios" / "three-aircraft.toml"


def start_command(chunk, study, folder, out, *options):
    """Start the command in a separate process, with a chunk size."""
    program = folder / "fly.py"
    program.write_text(
        f"import sys\nfrom anser.campaigns import flights\nflights.BATCH = {chunk}\n"
        "from anser.cli import main\nif __name__ == '__main__':\n    sys.argv[0] = 'anser'\n    main()\n"
    )
    command = [sys.executable, program, "campaign", study, "--out", folder / out, *options]
    return subprocess.Popen([*map(str, command)], stdout=subprocess.DEVNULL)


def assert_bit_equal(folder, other_folder, flights):
    """Compare rows and series of two campaigns."""
    first_store, second_store = CampaignStore.open(folder), CampaignStore.open(other_folder)
    assert first_store.flown.size == flights
    xr.testing.assert_identical(first_store.dataset(), second_store.dataset())
    series = first_store.series().load()
    assert np.isfinite(series["position_error_m"].values).all()
    assert series["airspeed_m_s"].values.std() > 0.1
    xr.testing.assert_identical(series, second_store.series().load())


@pytest.fixture
def study(tmp_path):
    (tmp_path / "three.toml").write_text(THREE.read_text())
    (tmp_path / "study.toml").write_text(text_of(flights=20))
    return tmp_path / "study.toml"


@pytest.mark.usefixtures("undrawn_figures")
def test_a_campaign_prints_its_estimates_and_is_resumed(anser, study, tmp_path, monkeypatch):
    monkeypatch.setattr(flying, "fly_many", made_up)
    monkeypatch.setattr(flying, "BATCH", 8)
    out = tmp_path / "out"
    code, printed, said = anser("campaign", study, "--out", out, "--processes", 1)
    assert code == 1  # some of those made up fail
    assert "of 20 flights meet every requirement" in printed
    assert "greatest miss" in printed
    assert "flights did not meet every requirement, or could not begin" in said
    code, _, said = anser("campaign", study, "--out", out)
    assert code == 2
    assert "expected a new folder, or --resume" in said
    code, printed, _ = anser("campaign", study, "--out", out, "--resume", "--json")
    assert code == 1
    document = json.loads(printed)
    assert document["flown"] == document["flights"] == 20
    assert 0.0 < document["low"] < document["probability"] < document["high"] < 1.0
    study.write_text(text_of(flights=20).replace("seed = 1", "seed = 2"))
    code, _, said = anser("campaign", study, "--out", out, "--resume")
    assert code == 2
    assert "to go on with it" in said


def test_a_campaign_is_reported_and_compared(anser, study, tmp_path, monkeypatch):
    monkeypatch.setattr(flying, "fly_many", made_up)
    out, second = tmp_path / "out", tmp_path / "other"
    anser("campaign", "fly", study, "--out", out, "--processes", 1)
    assert (out / "report.html").is_file()
    (out / "report.html").unlink()
    code, printed, _ = anser("campaign", "report", out, "--worst", 0)
    assert code == 0
    assert "report.html: written" in printed
    assert (out / "report.html").is_file()
    assert (out / "flights.parquet").is_file()
    code, printed, _ = anser("campaign", "report", out, "--worst", 0, "--json")
    assert json.loads(printed)["flown"] == 20
    code, _, said = anser("campaign", "report", tmp_path)
    assert (code, "FOLDER: " in said, "a folder without flights.zarr" in said) == (2, True, True)

    study.write_text(text_of(flights=20).replace("high = 9.0", "high = 6.0"))
    anser("campaign", study, "--out", second, "--processes", 1)
    code, printed, said = anser("campaign", "compare", out, second, "--out", tmp_path / "compared")
    assert code == 0
    assert "20 pairs" in printed
    assert "McNemar, exact: p =" in printed
    assert "applied otherwise in 20 of 20 pairs: wind.speed_m_s" in printed
    assert (tmp_path / "compared" / "comparison.svg").is_file()
    code, printed, _ = anser("campaign", "compare", out, second, "--json")
    document = json.loads(printed)
    assert (code, document["flights"], document["applied"]) == (0, 20, {"wind.speed_m_s": 20})
    study.write_text(text_of(flights=20).replace("seed = 1", "seed = 2"))
    anser("campaign", study, "--out", tmp_path / "third", "--processes", 1)
    code, _, said = anser("campaign", "compare", out, tmp_path / "third")
    assert code == 2
    assert "expected the same seed for the same flight" in said


@pytest.mark.usefixtures("undrawn_figures")
def test_a_damaged_campaign_is_refused_and_resumed_by_one_process_at_a_time(anser, study, tmp_path, monkeypatch):
    monkeypatch.setattr(flying, "fly_many", made_up)
    monkeypatch.setattr(flying, "BATCH", 8)
    out = tmp_path / "out"
    anser("campaign", study, "--out", out, "--processes", 1)
    (out / "flights.zarr" / "met" / "1").unlink()
    for arguments in (
        ("campaign", "report", out),
        ("campaign", "compare", out, out),
        ("run", "--campaign", out, "--flight", 0),
    ):
        code, _, said = anser(*arguments)
        assert (code, said.count("\n")) == (2, 1)
        assert "arrived chunk 1 (flights 8 to 15) of which" in said
    with folder_lock(out):
        code, _, said = anser("campaign", study, "--out", out, "--resume")
    assert (code, "a folder into which another process flies" in said) == (2, True)
    code, printed, said = anser("campaign", study, "--out", out, "--resume", "--processes", 1)
    assert code == 1
    assert "chunk 1 (flights 8 to 15) is flown again" in said
    assert "of 20 flights meet every requirement" in printed
    assert anser("campaign", "report", out, "--worst", 0)[0] == 0


@pytest.mark.usefixtures("undrawn_figures")
def test_an_unfinished_chunk_at_ctrl_c_is_not_counted(anser, study, tmp_path, monkeypatch):
    def stopped(self, chunk, files):
        raise KeyboardInterrupt

    monkeypatch.setattr(flying, "fly_many", made_up)
    monkeypatch.setattr(flying, "BATCH", 8)
    with monkeypatch.context() as patch:
        patch.setattr(StoreChecksums, "record_chunk", stopped)
        code, printed, said = anser("campaign", study, "--out", tmp_path / "out", "--processes", 1)
    assert (code, "no flight so far" in printed, "0 of 20 flights" in said) == (130, True, True)
    assert CampaignStore.open(tmp_path / "out").flown.size == 0
    code, _, said = anser("campaign", study, "--out", tmp_path / "out", "--resume", "--processes", 1)
    assert (code, "is flown again" in said) == (1, False)  # the chunk was incomplete, not damaged


@pytest.mark.usefixtures("undrawn_figures")
def test_a_report_with_flights_stays_without_new_flights(anser, study, tmp_path, monkeypatch):
    monkeypatch.setattr(flying, "fly_many", made_up)
    page = tmp_path / "out" / "report.html"
    anser("campaign", study, "--out", tmp_path / "out", "--processes", 1)
    page.write_text("with a map")
    anser("campaign", study, "--out", tmp_path / "out", "--resume")
    assert page.read_text() == "with a map"


@pytest.mark.usefixtures("undrawn_figures")
def test_ctrl_c_leaves_estimates_and_report_of_the_flights(anser, study, tmp_path, monkeypatch):
    remaining = 1

    def once(cases, progress=None, batch=None, series=None, precision="float64", outputs=None):
        nonlocal remaining
        if remaining == 0:
            raise KeyboardInterrupt
        remaining -= 1
        return made_up(cases)

    monkeypatch.setattr(flying, "fly_many", once)
    monkeypatch.setattr(flying, "BATCH", 8)
    code, printed, said = anser("campaign", study, "--out", tmp_path / "out", "--processes", 1)
    assert code == 130
    assert "of 8 flights meet every requirement" in printed
    assert "8 of 20 flights; --resume flies the others" in said
    assert "<b>Partial: 8 of 20 flights.</b>" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.usefixtures("undrawn_figures")
def test_ctrl_c_before_the_first_chunk_leaves_a_resumable_campaign(anser, study, tmp_path, monkeypatch):
    def stopped(cases, progress=None, batch=None, series=None, precision="float64", outputs=None):
        raise KeyboardInterrupt

    monkeypatch.setattr(flying, "fly_many", stopped)
    code, printed, said = anser("campaign", study, "--out", tmp_path / "out", "--processes", 1)
    assert (code, said.count("stopped")) == (130, 1)
    assert "no flight so far" in printed
    assert "0 of 20 flights; --resume flies the others" in said
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"checksums", "flights.zarr", "lock"}
    with pytest.raises(StoreError, match="no flight"):
        write_campaign(CampaignStore.open(tmp_path / "out"))
    monkeypatch.setattr(flying, "fly_many", made_up)
    assert anser("campaign", study, "--out", tmp_path / "out", "--resume", "--processes", 1)[0] == 1
    assert CampaignStore.open(tmp_path / "out").flown.size == 20


def test_a_closed_standard_output_loses_no_report(anser, study, tmp_path, monkeypatch):
    """Like `anser campaign ... | head -3`, which closes the pipe."""
    monkeypatch.setattr(flying, "fly_many", made_up)
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as closed:
        monkeypatch.setattr(sys, "stdout", closed)
        code, _, _ = anser("campaign", study, "--out", tmp_path / "out", "--processes", 1)
    assert code == 1  # some of those made up fail
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written >= {"flights.zarr", "report.html", "campaign.png", "flights.parquet", "answers.parquet"}


@pytest.mark.usefixtures("undrawn_figures")
def test_a_lost_cluster_leaves_the_flights_and_one_message(anser, study, tmp_path, monkeypatch):
    def lost(address, fly, folder, chunks):
        yield fly(folder, chunks[0])
        raise StoreError(f"cluster {address}: arrived a scheduler that broke the connection")

    monkeypatch.setattr(flying, "fly_on_cluster", lost)
    monkeypatch.setattr(flying, "fly_many", made_up)
    monkeypatch.setattr(flying, "BATCH", 8)
    code, _, said = anser("campaign", study, "--out", tmp_path / "out", "--cluster", "tcp://10.0.0.1:8786")
    assert code == 2
    assert "cluster tcp://10.0.0.1:8786: arrived a scheduler that broke the connection" in said
    assert "8 of 20 flights; --resume flies the others" in said
    assert "Traceback" not in said
    assert "<b>Partial: 8 of 20 flights.</b>" in (tmp_path / "out" / "report.html").read_text()
    code, _, _ = anser("campaign", study, "--out", tmp_path / "out", "--resume", "--processes", 1)
    assert code == 1
    assert CampaignStore.open(tmp_path / "out").flown.size == 20


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--flight", 1), "expected either a scenario file, or both"),
        (("--campaign", "nowhere"), "expected either a scenario file, or both"),
        (("--campaign", "nowhere", "--flight", 1), "--campaign: nowhere: arrived a folder without flights.zarr"),
        ((), "arrived no scenario"),
    ],
)
def test_run_needs_a_valid_campaign_and_flight(anser, arguments, said):
    code, _, err = anser("run", *arguments)
    assert code == 2
    assert said in err


@pytest.mark.long
def test_a_killed_campaign_is_resumed_bit_equal_in_one_process_and_in_two(study, tmp_path):
    """Real flights in chunks of four; killed within a chunk, resumed, and flown by two processes."""

    def begin(out, *options):
        return start_command(4, study, tmp_path, out, *options)

    study.write_text(text_of(flights=20) + KEPT)
    assert begin("whole", "--processes", "1").wait() == 0
    assert begin("two", "--processes", "2").wait() == 0
    killed = begin("killed", "--processes", "1")
    while not (tmp_path / "killed" / "checksums" / "1.json").exists():
        time.sleep(0.05)
        assert killed.poll() is None
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert CampaignStore.open(tmp_path / "killed").flown.size < 20
    assert begin("killed", "--processes", "1", "--resume").wait() == 0
    assert_bit_equal(tmp_path / "killed", tmp_path / "whole", 20)
    assert_bit_equal(tmp_path / "two", tmp_path / "whole", 20)


@pytest.mark.long
def test_ctrl_c_stops_processes_that_fly_and_leaves_a_report(study, tmp_path):
    process = start_command(4, study, tmp_path, "out", "--processes", "2")
    checksums = tmp_path / "out" / "checksums"
    while not any((checksums / f"{k}.json").exists() for k in range(5)):
        time.sleep(0.05)
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert process.wait() == 130
    flown = CampaignStore.open(tmp_path / "out").flown.size
    assert 4 <= flown < 20
    assert f"<b>Partial: {flown} of 20 flights.</b>" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.long
def test_any_flight_is_replayed_as_in_the_campaign(anser, study, tmp_path):
    study.write_text(text_of(flights=3))
    code, _, _ = anser("campaign", study, "--out", tmp_path / "out", "--processes", 1)
    assert code == 0
    code, _, said = anser("run", "--campaign", tmp_path / "out", "--flight", 1, "--out", tmp_path / "again")
    assert code == 0
    assert "flight 1: as in the campaign" in said
    assert (tmp_path / "again" / "report.html").is_file()
    code, _, said = anser("run", "--campaign", tmp_path / "out", "--flight", 3)
    assert code == 2
    assert "--flight: arrived 3; expected one from 0 to 2" in said


@pytest.mark.long
def test_a_saltelli_study_is_flown_archived_and_reported(anser, study, tmp_path):
    text = text_of(flights=2).replace("[sampling]", '[keep]\nworst = 1\n[sampling]\nmethod = "saltelli"')
    study.write_text(text)
    out = tmp_path / "out"
    code, printed, _ = anser("campaign", study, "--out", out, "--processes", 1)
    assert code == 0
    assert "6 of 6 flights" in printed
    (archived,) = (out / "worst").iterdir()
    assert {path.name for path in archived.iterdir()} == {"flight.nc", "summary.json", "report.html"}
    code, _, _ = anser("campaign", "report", out, "--worst", 2, "--others", 3)
    assert code == 0
    page = (out / "report.html").read_text()
    assert page.count('class="worst-track"') == 2
    assert f'data-flight="{int(archived.name[-6:])}"' in page
    assert "Sobol indices" in page


def test_a_missing_cluster_is_refused_and_the_store_is_resumable(anser, study, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECT", "1s")
    code, _, said = anser("campaign", study, "--out", tmp_path / "out", "--cluster", "tcp://127.0.0.1:9")
    assert code == 2
    assert "cluster: arrived tcp://127.0.0.1:9; expected the address of a running scheduler" in said


@pytest.mark.long
def test_a_cluster_flies_bit_equal_despite_a_killed_worker(study, tmp_path):
    from distributed import LocalCluster

    text = study.read_text()
    study.write_text(text.replace("flights = 20", "flights = 6") + KEPT)
    flying_alone = start_command(4, study, tmp_path, "whole", "--processes", "1")
    assert flying_alone.wait() == 0
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as local:
        process = start_command(4, study, tmp_path, "spread", "--cluster", local.scheduler_address)
        while not (tmp_path / "spread" / "checksums" / "store.json").exists():
            time.sleep(0.05)
        time.sleep(8.0)
        worker = next(iter(local.workers.values()))
        os.kill(worker.process.pid, signal.SIGKILL)
        assert process.wait() == 0
    assert_bit_equal(tmp_path / "spread", tmp_path / "whole", 6)


def test_the_usage_omits_an_implied_command(anser, tmp_path):
    for written in (("campaign",), ("campaign", "fly")):
        code, _, err = anser(*written, tmp_path / "study.toml")
        assert code == 2
        assert f" {' '.join(written)} [OPTIONS]" in err


@pytest.mark.parametrize(
    ("unit", "value", "high", "cells"),
    [
        ("s", 2.31e-5, None, ["0.023", "0.012", "-", "ms"]),
        ("s", 0.25, 0.5, ["0.250", "0.125", "0.500", "s"]),
        ("s", None, None, ["-", "-", "-", "s"]),
        ("m", 0.004, 0.005, ["0.004", "0.002", "0.005", "m"]),
        ("1", 2.5, 3.0, ["2.500", "1.250", "3.000", ""]),
    ],
)
def test_short_times_are_in_milliseconds_and_a_ratio_has_no_unit(unit, value, high, cells):
    low = None if value is None else value / 2.0
    assert _bound_cells(QuantileEstimate("any", "words", unit, 0.95, True, value, low, high)) == cells
