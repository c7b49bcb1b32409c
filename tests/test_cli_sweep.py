"""The command sweep end to end: output, files, exit codes."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from anser.cli.console import InputError
from anser.cli.sweeps import _print_sweep, parse_sweep_values
from support.plain_files import read_alone

SCENARIOS = Path(__file__).parents[1] / "scenarios"
SINGLE = SCENARIOS / "single-aircraft.toml"


def test_sweep_prints_a_table_writes_and_draws(anser, tmp_path):
    # the program of the flights is that of tests/missions/test_flight_batches.py
    out, settings = tmp_path / "sweep", ("--set", "timing.step_s=0.02", "--set", "timing.duration_s=45")
    code, printed, said = anser("sweep", SINGLE, "--set", "wind.speed_m_s=0:8:8", *settings, "--out", out)
    assert code == 0
    assert "wind.speed_m_s" in printed
    assert "sweep.nc and figure written" in said
    data = read_alone(out / "sweep.nc")
    assert data["wind.speed_m_s"].values.tolist() == [0.0, 8.0]
    assert data["met"].values.all()
    assert {path.name for path in out.iterdir()} == {"sweep.nc", "sweep.svg", "sweep.png"}
    code, _, said = anser("sweep", SINGLE, "--set", "wind.speed_m_s=0,5", "--out", out)
    assert code == 2
    assert "exists" in said


def test_brackets_and_colons_in_names_are_printed(capsys):
    paths = [f"aircraft[aircraft-{k}].start.altitude_m" for k in (1, 2)]
    swept = {paths[0]: [500.0], paths[1]: [":boat:", "[red]"]}
    shape, texts = (1, 2), np.array([["", "[bold]of [aircraft-1]"]])
    data = xr.Dataset(
        {"met": (paths, np.ones(shape, bool)), "unmet": (paths, texts), "reason": (paths, texts)},
        attrs={"title": "three [of] :airplane:"},
    )
    _print_sweep(data, swept)
    printed = capsys.readouterr().out
    for text in (*paths, ":boat:", "[red]", "[bold]of [aircraft-1]", "three [of] :airplane:"):
        assert text in printed


@pytest.mark.long
def test_sweep_prints_json_and_ends_with_1_for_a_failed_flight(anser, tmp_path):
    options = ("--set", "aircraft[aircraft-2].start.altitude_m=1500,15000", "--json", "--out", tmp_path / "sweep")
    code, printed, said = anser("sweep", SCENARIOS / "three-aircraft.toml", *options)
    assert code == 1
    assert "1 of 2 flights" in said
    document = json.loads(printed)
    good, bad = document["flights"]
    assert good["met"]
    assert good["reason"] == ""
    assert bad["miss_max_m"] is None
    assert "aircraft-2" in bad["reason"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("wind.speed_m_s", "PATH=VALUES"),
        ("=5", "PATH=VALUES"),
        ("wind.speed_m_s=0:20:0", "step that leads"),
        ("wind.speed_m_s=0:20:-5", "step that leads"),
        ("wind.speed_m_s=0:a:5", "three numbers"),
        ("wind.speed_m_s=0:1:1e-9", "10000 at most"),
        ("wind.sped_m_s=5", "wind.sped_m_s"),
        ("wind.speed_m_s=-5", "wind.speed_m_s"),
        ("wind.speed_m_s=5,5.0", "a value twice"),
    ],
)
def test_an_invalid_sweep_ends_with_2(anser, tmp_path, text, said):
    code, _, err = anser("sweep", SINGLE, "--set", text, "--out", tmp_path / "sweep")
    assert code == 2
    assert said in err
    assert not (tmp_path / "sweep").exists()


def test_a_repeated_path_ends_with_2(anser, tmp_path):
    twice = ("--set", "wind.speed_m_s=5", "--set", "wind.speed_m_s=6")
    code, _, said = anser("sweep", SINGLE, *twice, "--out", tmp_path / "sweep")
    assert code == 2
    assert "twice" in said


def test_values_are_read_as_in_a_file():
    values = parse_sweep_values(["a=0:0.3:0.1", "b=1,2.5,left,true", "c=2:-2:-2"])
    assert values == {"a": [0, 0.1, 0.2, 0.3], "b": [1, 2.5, "left", True], "c": [2, 0, -2]}
    with pytest.raises(InputError, match="arrived 1000000 combinations; expected 10000 at most"):
        parse_sweep_values(["a=0:999:1", "b=0:999:1"])
