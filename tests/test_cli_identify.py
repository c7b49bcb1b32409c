"""The command identify: table, files, JSON, and refusals with exit code 2."""

import json

import pandas as pd
import pytest

from support.manoeuvres import flight, noisy_record


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    flight("multisine").save(folder / "run")
    record = noisy_record("doublet")
    names = {"alpha_deg": "AOA", "pitch_rate_deg_s": "Q", "elevator_deg": "DE", "airspeed_m_s": "VT"}
    names |= {name: name for name in ("roll_deg", "pitch_deg", "roll_rate_deg_s", "yaw_rate_deg_s", "altitude_m")}
    frame = pd.DataFrame({column: record.dataset[name] for name, column in names.items()} | {"t": record.time_s})
    frame.to_csv(folder / "stick.csv", index=False)
    lines = [f'{name} = "{column}"' for name, column in names.items() if name != column]
    (folder / "map.toml").write_text("\n".join(['time_s = "t"', *lines, "\n"]))
    (folder / "radians.toml").write_text(
        "\n".join(['time_s = "t"', *lines[1:], 'alpha_deg = { column = "AOA", unit = "rad" }\n'])
    )
    return folder


def test_derivatives_of_a_run_are_written_with_an_aircraft_file_that_passes_the_check(anser, recordings, tmp_path):
    out = tmp_path / "estimate"
    code, printed, err = anser("identify", recordings / "run", "--out", out)
    assert code == 0, err
    assert "Cm_elevator" in printed
    assert "aircraft.toml written" in err
    assert json.loads((out / "identification.json").read_text())["model"] == "derivatives"
    code, _, _ = anser("aircraft", "check", out / "aircraft.toml")
    assert code == 0
    code, _, err = anser("identify", recordings / "run", "--out", out)
    assert code == 2
    assert "which exists" in err


def test_an_existing_folder_is_refused_before_the_estimation(anser, recordings, tmp_path, monkeypatch):
    monkeypatch.setattr("anser.identification.identify.identify", lambda *_, **__: pytest.fail("computed first"))
    code, _, err = anser("identify", recordings / "run", "--out", tmp_path)
    assert code == 2
    assert "which exists" in err


def test_a_table_with_a_map_gives_the_short_period(anser, recordings, tmp_path):
    arguments = ("identify", recordings / "stick.csv", "--map", recordings / "map.toml", "--model", "short-period")
    code, printed, err = anser(*arguments, "--aircraft", "f16", "--json", "--out", tmp_path / "estimate")
    assert code == 0, err
    parameters = {row["name"]: row for row in json.loads(printed)["parameters"]}
    assert parameters["M_elevator"]["low"] < -9.1 < parameters["M_elevator"]["high"]
    assert not (tmp_path / "estimate" / "aircraft.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("absent.csv",), "no file"),
        (("stick.csv",), "expected a column time_s"),
        (("stick.csv", "--map", "map.toml"), "expected an aircraft with known mass"),
        (("stick.csv", "--map", "map.toml", "--aircraft", "f16"), "without specific_force_x_m_s2"),
        (("stick.csv", "--map", "radians.toml", "--model", "short-period"), "kinematics multiplies by"),
        (("stick.csv", "--map", "absent.toml"), "absent.toml"),
        (("run", "--window-s", "1"), "--window-s: arrived '1'; expected 2 numbers"),
        (("run", "--window-s", "1,1.2"), "window: arrived 1 to 1.2 s"),
        (("run", "--aircraft", "f61"), "--aircraft: arrived 'f61'"),
    ],
)
def test_bad_input_has_one_message_and_exit_code_2(anser, recordings, tmp_path, monkeypatch, arguments, text):
    monkeypatch.chdir(recordings)
    code, printed, err = anser("identify", *arguments, "--out", tmp_path / "estimate")
    assert code == 2
    assert text in err
    assert printed == ""
    assert not (tmp_path / "estimate").exists()
