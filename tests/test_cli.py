"""The command line end to end: output, files, exit codes."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlparse

import pytest
import xarray as xr

from anser.cli.console import InputError
from anser.cli.folders import make_next_folder
from anser.scenario import load, validate
from anser.scenario.files import SCENARIO_SCHEMA
from anser.simulation import STATUS_MESSAGES
from anser.simulation.closed_loop import AT_GROUND
from anser.version import source_version
from support.made_flight import make_flight

SCENARIOS = Path(__file__).parents[1] / "scenarios"
THREE = (SCENARIOS / "three-aircraft.toml").read_text()
BRIEFLY = ("--set", "timing.duration_s=65", "--set", "timing.step_s=0.02")  # all arrive at 60 s


def _scenario(tmp_path, *changes):
    text = THREE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "scenario.toml"
    path.write_text(text)
    return path


def test_run_writes_the_files_and_a_table(anser, tmp_path):
    out = tmp_path / "deep" / "run"
    code, printed, _ = anser("run", SCENARIOS / "three-aircraft.toml", "--out", out, *BRIEFLY)
    assert code == 0
    assert sorted(p.name for p in out.iterdir()) == ["flight.nc", "report.html", "summary.json"]
    for name in ("aircraft-1", "aircraft-2", "aircraft-3"):
        assert name in printed
    assert printed.count("arrived") == 3
    summary = json.loads((out / "summary.json").read_text())
    assert [aircraft["status"] for aircraft in summary["aircraft"]] == ["arrived"] * 3
    page = (out / "report.html").read_text()
    assert "<html" in page
    assert 'src="http' not in page  # self-contained

    original = {p.name: p.read_bytes() for p in out.iterdir()}
    code, _, err = anser("run", SCENARIOS / "three-aircraft.toml", "--out", out)
    assert code == 2
    assert "exists" in err
    assert str(out) in err
    assert original == {p.name: p.read_bytes() for p in out.iterdir()}


def test_the_default_folder_is_the_next_free_one(tmp_path):
    existing = tmp_path / "runs" / "patrol"
    for expected in ("patrol", "patrol-2", "patrol-3"):
        assert make_next_folder(existing) == tmp_path / "runs" / expected
        assert (tmp_path / "runs" / expected).is_dir()
    (tmp_path / "file").write_text("")
    for impossible in (tmp_path / "file" / "patrol", tmp_path / "file" / "deep" / "patrol"):
        with pytest.raises(InputError, match=r"--out: arrived nothing, and .* cannot be made"):
            make_next_folder(impossible)


def test_a_run_without_out_leaves_the_earlier_run_unchanged(anser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    earlier = tmp_path / "runs" / "three-aircraft"
    earlier.mkdir(parents=True)
    values = ("--set", "wind.speed_m_s=2", "--set", "wind.from_deg=240")
    code, _, err = anser("run", SCENARIOS / "three-aircraft.toml", *BRIEFLY, *values)
    assert code == 0
    assert "runs/three-aircraft-2: flight.nc, summary.json, report.html written" in err
    assert (tmp_path / "runs" / "three-aircraft-2" / "summary.json").is_file()
    assert not list(earlier.iterdir())
    meant = load(SCENARIOS / "three-aircraft.toml").replace(
        "wind.speed_m_s", 2, "wind.from_deg", 240, "timing.duration_s", 65, "timing.step_s", 0.02
    )
    with xr.open_dataset(tmp_path / "runs" / "three-aircraft-2" / "flight.nc", engine="netcdf4") as flight:
        assert validate(json.loads(flight.attrs["scenario"])) == meant
        assert flight.attrs["scenario_hash"] == meant.hash


def test_the_time_of_an_aircraft_s_stop_is_printed(anser, tmp_path, monkeypatch):
    dataset, summary = make_flight()
    dataset["status"][dataset["time"].values >= 75.2 - 1e-6, 1] = AT_GROUND
    summary["aircraft"][1]["status"] = STATUS_MESSAGES[AT_GROUND]
    planned = SimpleNamespace(problems=tuple, notes=tuple)
    flown = SimpleNamespace(
        dataset=dataset, summary=summary, met=False, planned=planned, write_into=lambda folder: (folder / "x").touch()
    )
    monkeypatch.setattr("anser.missions.runs.run", lambda *arguments: flown)
    code, printed, err = anser("run", SCENARIOS / "three-aircraft.toml", "--out", tmp_path / "run")
    assert code == 1
    assert "at 75.2 s: the aircraft reached the ground" in printed
    assert 'aircraft "bert": at 75.2 s: the aircraft reached the ground; later samples repeat the last state' in err
    assert err.count(" s: the aircraft") == 1


def test_an_unmet_requirement_is_named_and_ends_with_1(anser, tmp_path):
    shorter = ("duration_s = 150.0", "duration_s = 65.0\nstep_s = 0.02")
    path = _scenario(tmp_path, ("[requirements]", "[requirements]\nmiss_max_m = 0.0001"), shorter)
    code, printed, err = anser("run", path, "--out", tmp_path / "run", "--json")
    assert code == 1
    assert "not met: miss_max_m" in err
    saved = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert len(saved.pop("sha256")) == 64
    assert json.loads(printed) == saved


def test_plan_prints_one_arrival_time_and_shows_its_picture_without_a_folder(anser, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda uri: opened.append(Path(urlparse(uri).path)) or True)
    monkeypatch.chdir(tmp_path)
    code, printed, _ = anser("plan", SCENARIOS / "three-aircraft.toml", "--open")
    assert code == 0
    (picture,) = opened
    assert picture.name == "plan.svg"
    assert "<svg" in picture.read_text()
    assert not list(tmp_path.iterdir())
    assert "all arrive at 60.36 s" in printed
    assert printed.count("9054.1") == 4  # one nominal length, three planned ones


def test_plan_that_breaks_a_limit_ends_with_1(anser, tmp_path):
    path = _scenario(tmp_path, ("bank_max_deg = 70.0", "bank_max_deg = 40.0"))
    code, printed, err = anser("plan", path, "--json", "--quiet")
    assert code == 1
    assert json.loads(printed)["status"] == "not flyable"
    assert "aircraft-3" in err
    assert "turns faster" in err


def test_check_is_quick_and_plain(anser):
    code, printed, _ = anser("check", SCENARIOS / "storm-sampling.toml")
    assert code == 0
    assert "4 aircraft, 4 goals" in printed
    assert f"Next: anser plan {SCENARIOS / 'storm-sampling.toml'}" in printed


def test_check_reads_the_wind_field(anser, tmp_path):
    path = tmp_path / "windy.toml"
    path.write_text((SCENARIOS / "climb-and-turn.toml").read_text() + '\n[wind]\nfield = "wind.nc"\n')
    (tmp_path / "wind.nc").write_text("no NetCDF")
    code, _, err = anser("check", path)
    assert code == 2
    assert "wind.field: arrived wind.nc with a file that cannot be read" in err


def test_new_writes_a_scenario_that_checks_and_does_not_overwrite(anser, tmp_path):
    path = tmp_path / "mine.toml"
    assert anser("new", path)[0] == 0
    assert anser("check", path)[0] == 0
    path.write_text("kept")
    code, _, err = anser("new", path)
    assert code == 2
    assert str(path) in err
    assert path.read_text() == "kept"


def test_new_copies_what_comes_with_anser(anser, tmp_path):
    path = tmp_path / "mine.toml"
    code, printed, err = anser("new", path, "--from", "three-aircraft")
    assert code == 0
    assert f"Next: anser check {path}" in printed
    assert str(tmp_path / SCENARIO_SCHEMA) in err
    assert path.read_text().startswith(f"#:schema ./{SCENARIO_SCHEMA}\n")
    assert load(path).hash == load(SCENARIOS / "three-aircraft.toml").hash
    code, printed, err = anser("new", tmp_path / "study.toml", "--from", "how-surely")
    assert f"Next: anser campaign {tmp_path / 'study.toml'}" in printed
    assert str(tmp_path / "uncertain-world.toml") in err
    code, printed, err = anser("new", tmp_path / "other.toml", "--from", "four-aircraft")
    assert code == 2
    assert '--from: arrived "four-aircraft"; expected one of' in err
    assert "three-aircraft" in err


def test_the_demo_flies_without_a_file_and_says_how_to_see_the_flight(anser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, printed, err = anser("demo")
    assert code == 0
    assert "three-aircraft: 150 s flown" in printed
    assert "open runs/three-aircraft/report.html in a browser" in err.replace("\n", " ")
    assert (tmp_path / "runs" / "three-aircraft" / "report.html").is_file()


@pytest.mark.long
def test_trim_and_its_diagnosis(anser):
    arguments = ("trim", "--aircraft", "f16", "--speed-m-s", "150", "--altitude-m", "1000")
    code, printed, _ = anser(*arguments)
    assert code == 0
    assert "angle of attack" in printed
    assert "throttle" in printed
    code, as_json, _ = anser(*arguments, "--json")
    assert code == 0
    for quantity in json.loads(as_json)["quantities"]:
        assert f"{quantity['value']:.4f}" in next(
            line for line in printed.splitlines() if f" {quantity['name']} " in line
        )
    code, as_json, err = anser("trim", "--speed-m-s", "30", "--altitude-m", "1000", "--json", "--quiet")
    assert code == 1
    assert "angle of attack" in err
    assert "slowest trimmable speed" in err
    document = json.loads(as_json)
    assert document["status"] == "no steady flight"
    assert document["reasons"] == [err.rstrip("\n")]


_BAD = {
    "misspelt key": (("speed_m_s = 150.0\n", "sped_m_s = 150.0\n"), ("fleet.sped_m_s", "speed_m_s")),
    "wrong type": (("duration_s = 150.0", 'duration_s = "long"'), ("timing.duration_s", "long", "number")),
    "not a number": (("duration_s = 150.0", "duration_s = nan"), ("timing.duration_s", "nan")),
    "syntax": (("duration_s = 150.0", "duration_s = = 150.0"), ("line",)),
    "duplicate names": (('name = "aircraft-2"', 'name = "aircraft-1"'), ("aircraft[1].name", "aircraft-1")),
    "outside the envelope": (
        ("altitude_m = 1000.0", "altitude_m = 20000.0"),
        ("aircraft[0].start.altitude_m", "20000"),
    ),
    "stand-off": (("stand_off_up_m = 300.0", "stand_off_up_m = 100.0"), ("aircraft[0].rendezvous", "100", "150")),
    "goal outruns": (("speed_m_s = 25.0", "speed_m_s = 160.0"), ("boat-north", "160", "150")),
}


@pytest.mark.parametrize("command", ["run", "plan", "check"])
@pytest.mark.parametrize("kind", list(_BAD))
def test_bad_input_is_one_message_with_code_2(anser, tmp_path, kind, command):
    change, expected = _BAD[kind]
    path = _scenario(tmp_path, change)
    out = tmp_path / "run"
    options = ["--out", out] if command == "run" else []
    code, printed, err = anser(command, path, *options)
    assert code == 2
    assert printed == ""
    for part in (*expected, str(path)):
        assert part in err
    assert "Traceback" not in err
    assert not out.exists()


def test_no_aircraft_and_missing_file(anser, tmp_path):
    path = tmp_path / "empty.toml"
    path.write_text(THREE[: THREE.index("[[aircraft]]")] + THREE[THREE.index("[[goal]]") :])
    code, _, err = anser("check", path)
    assert code == 2
    assert "aircraft" in err
    code, _, err = anser("run", tmp_path / "nowhere.toml")
    assert code == 2
    assert "nowhere.toml" in err


def test_an_impossible_folder_is_refused(anser, tmp_path):
    (tmp_path / "file").write_text("")
    code, _, err = anser("run", SCENARIOS / "three-aircraft.toml", "--out", tmp_path / "file" / "run")
    assert code == 2
    assert "--out" in err


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("trim", "--speed-m-s", "nan", "--altitude-m", "0"), "--speed-m-s"),
        (("trim", "--speed-m-s", "150", "--altitude-m", "1e9"), "--altitude-m"),
        (("trim", "--aircraft", "f17", "--speed-m-s", "150", "--altitude-m", "0"), "f16"),
        (("trim", "--variant", "best", "--speed-m-s", "150", "--altitude-m", "0"), "textbook"),
        (("fly",), "fly"),
    ],
)
def test_invalid_arguments_end_with_2(anser, arguments, part):
    code, _, err = anser(*arguments)
    assert code == 2
    assert part in err
    assert "Traceback" not in err


def test_the_installed_command_prints_its_version():
    program = Path(sys.executable).with_name("anser")
    completed = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    assert completed.stdout == "anser {} (commit {})\n".format(*source_version())
