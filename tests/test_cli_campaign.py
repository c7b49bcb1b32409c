"""The command campaign end to end, with made-up flights; with flown ones in the long test."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray as xr

from anser.campaigns import CampaignStore, flying
from campaigns.study_cases import STUDIES, made_up, text_of

THREE = STUDIES.parent / "scenarios" / "three-aircraft.toml"


@pytest.fixture
def study(tmp_path):
    (tmp_path / "three.toml").write_text(THREE.read_text())
    (tmp_path / "study.toml").write_text(text_of(flights=20))
    return tmp_path / "study.toml"


def test_campaign_prints_its_answers_and_goes_on(anser, study, tmp_path, monkeypatch):
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


def test_ctrl_c_leaves_answers_of_what_was_flown(anser, study, tmp_path, monkeypatch):
    left = 1

    def once(cases, batch=None):
        nonlocal left
        if left == 0:
            raise KeyboardInterrupt
        left -= 1
        return made_up(cases)

    monkeypatch.setattr(flying, "fly_many", once)
    monkeypatch.setattr(flying, "BATCH", 8)
    code, printed, said = anser("campaign", study, "--out", tmp_path / "out", "--processes", 1)
    assert code == 130
    assert "of 8 flights meet every requirement" in printed
    assert "8 of 20 flights; --resume flies the others" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--flight", 1), "expected either a scenario file, or both"),
        (("--campaign", "nowhere"), "expected either a scenario file, or both"),
        (("--campaign", "nowhere", "--flight", 1), "--campaign: nowhere: arrived a folder without flights.zarr"),
        ((), "arrived no scenario"),
    ],
)
def test_run_says_what_it_needs_of_a_campaign(anser, words, said):
    code, _, err = anser("run", *words)
    assert code == 2
    assert said in err


@pytest.mark.long
def test_a_killed_campaign_goes_on_to_the_last_bit_in_one_process_and_in_two(study, tmp_path):
    """Chunks of four flights that are really flown; killed in the midst of one, resumed, and flown by two processes."""
    program = (
        "import sys\nfrom anser.campaigns import flying\nflying.BATCH = 4\n"
        "from anser.cli import main\nif __name__ == '__main__':\n    sys.argv[0] = 'anser'\n    main()\n"
    )
    (tmp_path / "fly.py").write_text(program)

    def begin(out, *more):
        command = [sys.executable, tmp_path / "fly.py", "campaign", study, "--out", out, *more]
        return subprocess.Popen([*map(str, command)], env={**os.environ}, stdout=subprocess.DEVNULL)

    def flown(out):
        return CampaignStore.open(Path(out)).dataset()

    assert begin(tmp_path / "whole", "--processes", "1").wait() == 0
    assert begin(tmp_path / "two", "--processes", "2").wait() == 0
    killed = begin(tmp_path / "killed", "--processes", "1")
    while not (tmp_path / "killed" / "flights.zarr" / "chunk_done" / "1").exists():
        time.sleep(0.05)
        assert killed.poll() is None
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert flown(tmp_path / "killed").sizes["flight"] < 20
    assert begin(tmp_path / "killed", "--processes", "1", "--resume").wait() == 0
    whole = flown(tmp_path / "whole")
    assert whole.sizes["flight"] == 20
    xr.testing.assert_identical(flown(tmp_path / "killed"), whole)
    xr.testing.assert_identical(flown(tmp_path / "two"), whole)


@pytest.mark.long
def test_any_flight_is_flown_again_as_in_the_campaign(anser, study, tmp_path):
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
