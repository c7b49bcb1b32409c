"""The command rare end to end, with synthetic flights; with real flights in the long test."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from anser.campaigns import rare_flights, read_rare
from campaigns.rare_cases import RARE_TEXT, made_up
from campaigns.study_cases import STUDIES

SCENARIOS = STUDIES.parent / "scenarios"


@pytest.fixture
def study(tmp_path):
    (tmp_path / "three.toml").write_text((SCENARIOS / "three-aircraft.toml").read_text())
    (tmp_path / "study.toml").write_text(RARE_TEXT)
    return tmp_path / "study.toml"


def test_rare_prints_its_probability_and_is_resumed(anser, study, tmp_path, monkeypatch):
    remaining = 12

    def until_then(cases, batch=None, precision="float64"):
        nonlocal remaining
        if remaining == 0:
            raise KeyboardInterrupt
        remaining -= 1
        return made_up(cases)

    monkeypatch.setattr(rare_flights, "fly_many", until_then)
    out = tmp_path / "out"
    code, printed, said = anser("rare", study, "--out", out, "--processes", 1)
    assert code == 130
    assert f"{out}: 360 flights; --resume goes on" in said
    remaining = 1000
    code, _, said = anser("rare", study, "--out", out, "--processes", 1)
    assert code == 2
    assert "expected a new folder, or --resume" in said
    code, printed, said = anser("rare", study, "--out", out, "--processes", 1, "--resume")
    assert code == 0
    assert "test: miss_m above 8.91: probability 0.0" in printed
    assert "at 95 % confidence" in printed
    assert "levels of 3 repetitions" in printed
    assert "rare.json and figure written" in said
    code, printed, _ = anser("rare", study, "--out", out, "--processes", 1, "--resume", "--json")
    assert code == 0
    assert json.loads(printed) == json.loads((out / "rare.json").read_text())


def test_the_help_names_the_table_of_the_study(anser):
    code, printed, _ = anser("rare", "--help")
    assert (code, "a table [rare]" in " ".join(printed.split())) == (0, True)


def test_the_table_of_levels_has_medians(anser, study, tmp_path, monkeypatch):
    """Of an even number of repetitions, the median is the mean of the two values in the middle."""
    monkeypatch.setattr(rare_flights, "fly_many", made_up)
    study.write_text(RARE_TEXT.replace("flights = 300\nrepetitions = 3", "flights = 400\nrepetitions = 4"))
    code, printed, said = anser("rare", study, "--out", tmp_path / "out", "--processes", 1)
    assert code == 0, said
    levels = json.loads((tmp_path / "out" / "rare.json").read_text())["levels"]
    columns = [[value for value in level["bounds"] if value is not None] for level in levels]
    between = [np.median(values) for values in columns if values and np.median(values) not in values]
    assert between
    assert all(f"{median:.3f}" in printed.split() for median in between)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (RARE_TEXT.replace("8.91", "-1.0"), "rare.threshold: arrived -1.0; expected"),
        (RARE_TEXT.replace("miss_m", "miss"), 'rare.statistic: arrived "miss"; expected "separation_min_m" or'),
        (RARE_TEXT.replace("wind.speed", "wind.sped"), 'arrived the unknown key "sped_m_s"'),
        (RARE_TEXT.replace("[rare]", "[rarer]"), 'rarer: arrived the unknown key "rarer"'),
    ],
)
def test_bad_input_is_refused_before_any_flight(anser, study, tmp_path, text, said):
    study.write_text(text)
    code, _, err = anser("rare", study, "--out", tmp_path / "out")
    assert code == 2
    assert said in err
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn_figures")
def test_a_too_rare_event_ends_with_a_bound(anser, study, tmp_path, monkeypatch):
    monkeypatch.setattr(rare_flights, "fly_many", made_up)
    study.write_text(RARE_TEXT.replace("8.91", "20.0").replace("repetitions", "levels_max = 2\nrepetitions"))
    code, printed, err = anser("rare", study, "--out", tmp_path / "out", "--processes", 1)
    assert code == 1
    assert "test: miss_m above 20: probability below 0.1" in printed
    assert "expected more levels than 2, or a threshold that is nearer" in err


@pytest.mark.long
def test_a_killed_estimation_is_resumed_bit_equal_in_one_process_and_in_two(study, tmp_path):
    """Real flights; killed within a level, resumed, and flown by two processes."""
    (tmp_path / "three.toml").write_text((STUDIES / "short-approach.toml").read_text())
    study.write_text(RARE_TEXT.replace("8.91", "1.2"))

    def begin(out, *options):
        command = [sys.executable, "-m", "anser", "rare", study, "--out", tmp_path / out, *options]
        return subprocess.Popen([*map(str, command)], stdout=subprocess.DEVNULL)

    assert begin("two", "--processes", "2").wait() == 0
    killed = begin("killed", "--processes", "1")
    while len(list((tmp_path / "killed").glob("flown/*.npy"))) < 12:  # ten are the first level
        time.sleep(0.05)
        assert killed.poll() is None
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    assert begin("killed", "--processes", "1", "--resume").wait() == 0
    assert read_rare(tmp_path / "killed").document == read_rare(tmp_path / "two").document
