"""Compilation ahead of need: one process for each kind of fleet, ended with the server."""

import json
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from anser.config.shipped_files import shipped_files
from anser.live import preparation

DOCUMENT = tomllib.loads(shipped_files()["storm-sampling"].read_text(encoding="utf-8"))
KEEP_OUT = {"name": "cell", "north_m": 0.0, "east_m": 0.0, "radius_m": 300.0}


def with_aircraft(count):
    return DOCUMENT | {"aircraft": [*DOCUMENT["aircraft"], *DOCUMENT["aircraft"]][:count]}


def moved():
    return json.loads(json.dumps(DOCUMENT).replace("12500.0", "12400.0").replace('"core"', '"centre"'))


@pytest.mark.parametrize(
    ("document", "last_s", "starts"),
    [
        (moved(), 90.0, 1),  # other numbers and names: the same programs
        (with_aircraft(3), 90.0, 1),  # padded to four
        (with_aircraft(5), 90.0, 2),
        (DOCUMENT | {"keep_out": [KEEP_OUT]}, 90.0, 2),
        (DOCUMENT | {"arrival": {"rule": "earliest"}}, 90.0, 2),
        (DOCUMENT, 300.0, 2),  # paths of more intervals
        (DOCUMENT | {"parts": {"controller": "mine:Controller"}}, 90.0, 1),
    ],
)
def test_a_fleet_of_another_kind_starts_another_process(monkeypatch, tmp_path, document, last_s, starts):
    monkeypatch.setattr(preparation, "cache_folder", lambda: tmp_path)
    waiting, started = "import sys; sys.stdin.read()", []

    def start(task):
        assert task["folder"] == str(tmp_path)
        started.append(subprocess.Popen([sys.executable, "-c", waiting], stdin=subprocess.PIPE, text=True))
        return started[-1]

    monkeypatch.setattr(preparation, "_start", start)
    ahead = preparation.Preparation(tmp_path)
    try:
        ahead.request(DOCUMENT, 80.0)
        ahead.request(document, last_s)
        assert len(started) == starts
        assert [process.poll() is None for process in started] == [*[False] * (starts - 1), True]  # one at a time
    finally:
        ahead.close()
    assert all(process.poll() is not None for process in started)


@pytest.mark.skipif(not Path("/proc/self/stat").is_file(), reason="no Linux: the state of a process is not read")
def test_the_process_stands_still_while_plans_are_asked_for(monkeypatch, tmp_path):
    monkeypatch.setattr(preparation, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(preparation, "_PAUSE_S", 0.3)
    waiting = [sys.executable, "-c", "import sys; sys.stdin.read()"]
    monkeypatch.setattr(preparation, "_start", lambda task: subprocess.Popen(waiting, stdin=subprocess.PIPE, text=True))
    ahead = preparation.Preparation(tmp_path)
    ahead.pause()  # without a process
    ahead.request(DOCUMENT, 80.0)

    def stands():
        state = Path(f"/proc/{ahead._process.pid}/stat")
        return state.read_text(encoding="ascii").rpartition(")")[2].split()[0] == "T"

    def comes_to_a_stand():  # within the pause: the signal is delivered a little later on a machine at work
        return any(stands() or time.sleep(0.005) for _ in range(1000))

    begin = time.monotonic()
    ahead.pause()
    time.sleep(0.2)
    ahead.pause()
    assert comes_to_a_stand()
    while stands():
        assert time.monotonic() < begin + 5.0
        time.sleep(0.01)
    assert time.monotonic() > begin + 0.45  # 0.3 s after the last plan
    ahead.pause()
    ahead.request(with_aircraft(5), 80.0)  # a process that stands still ends too
    assert not stands()
    ahead.pause()
    assert comes_to_a_stand()
    ahead.close()
    time.sleep(0.5)


def test_nothing_is_compiled_ahead_without_a_store(monkeypatch, tmp_path):
    monkeypatch.setattr(preparation, "cache_folder", lambda: None)
    monkeypatch.setattr(preparation, "_start", lambda task: pytest.fail("a process was started"))
    preparation.Preparation(tmp_path).request(DOCUMENT, 80.0)


def test_the_process_ends_with_its_input(tmp_path):
    process = preparation._start({"folder": str(tmp_path), "document": DOCUMENT})
    process.communicate(timeout=60.0)
    assert process.returncode == 0
