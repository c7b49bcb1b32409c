"""The command linearize end to end: output, files, exit codes."""

import json
import sys

import numpy as np
import pytest

import anser as package
from anser.cli import main
from anser.results import read_netcdf

AT = ("--speed-m-s", "153.0096", "--altitude-m", "0", "--x-cg", "0.3")


@pytest.fixture
def anser(monkeypatch, capsys):
    """Run the command line in this process: exit code, standard output, standard error."""

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["anser", "linearize", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "100")
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call


def test_tables_of_modes_and_matrices(anser):
    code, printed, _ = anser(*AT)
    assert code == 0
    lines = printed.splitlines()
    assert lines[0] == "f16 (textbook, centre of mass 0.3) at 153.01 m/s, 0 m: open loop"
    assert lines[1].startswith("SI units and radians")
    linearization = package.linearize(speed_m_s=153.0096, altitude_m=0.0, x_cg_over_c=0.3)
    for mode in linearization.modes:
        (line,) = [line for line in lines if line.startswith(f"{mode.name}  ")][:1]
        assert f"{mode.eigenvalue.real:.5g}" in line
        assert f"{mode.natural_frequency:.4g}" in line
    # Every entry stands in the row and under the column of its names, in as many pieces as the screen asks for.
    for name, columns, matrix in (
        ("A", linearization.model.states, linearization.model.A),
        ("B", linearization.model.inputs, linearization.model.B),
    ):
        read = {}
        for start in [k for k, line in enumerate(lines) if line.split()[:1] == [name]]:
            head = lines[start].split()[1:]
            for line in lines[start + 1 : start + 1 + len(linearization.model.states)]:
                state, *values = line.split()
                read |= {(state, column): float(value) for column, value in zip(head, values, strict=True)}
        assert len(read) == matrix.size
        for (state, column), value in read.items():
            exact = float(matrix[linearization.model.states.index(state), columns.index(column)])
            assert value == pytest.approx(exact, rel=5e-5, abs=1e-12)


def test_json_is_the_only_output(anser):
    code, printed, _ = anser(*AT, "--json", "--actuators")
    assert code == 0
    document = json.loads(printed)
    assert document["condition"]["actuators"] == 1
    assert [signal["name"] for signal in document["inputs"]][1] == "elevator_command"
    assert np.shape(document["A"]) == (14, 14)


def test_out_writes_a_new_file(anser, tmp_path):
    for name in ("model.nc", "model.json"):
        path = tmp_path / name
        code, printed, err = anser(*AT, "--out", path)
        assert code == 0
        assert "mode" in printed
        assert f"{path}: written" in err.replace("\n", "")
        original = path.read_bytes()
        code, _, err = anser(*AT, "--out", path)
        assert code == 2
        assert "which exists; expected a new file" in err
        assert path.read_bytes() == original
    dataset = read_netcdf(tmp_path / "model.nc")
    document = json.loads((tmp_path / "model.json").read_text())
    np.testing.assert_array_equal(dataset.A, document["A"])
    assert dataset.attrs["x_cg_over_c"] == 0.3


def test_a_pull_up_by_pitch_rate(anser):
    code, printed, _ = anser(*AT[:-2], "--cg", "0.3", "--pitch-rate-deg-s", "10", "--json")
    assert code == 0
    document = json.loads(printed)
    assert (document["condition"]["pitch_rate_deg_s"], document["condition"]["x_cg_over_c"]) == (10.0, 0.3)
    states = {state["name"]: state["value"] for state in document["states"]}
    assert (states["P"], states["R"]) == (0.0, 0.0)
    assert states["Q"] == pytest.approx(np.deg2rad(10.0), rel=1e-14)


@pytest.mark.long
def test_an_untrimmable_condition_ends_with_1_and_the_diagnosis(anser):
    code, printed, err = anser(*AT, "--path-rate-deg-s", "17.188733853924695")
    assert (code, printed) == (1, "")
    assert "engine power: 105.1 percent; available 0 to 100" in err
    assert "the slowest trimmable speed is" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--aircraft", "f17"), "--aircraft: arrived 'f17'; expected perhaps \"f16\"; one of f16"),
        (("--variant", "none"), "--variant: arrived 'none'; expected one of textbook, s119, founding"),
        (("--speed-m-s", "nan"), "--speed-m-s: arrived nan; expected a number from 1 to 1000"),
        (("--x-cg", "30"), "--x-cg: arrived 30; expected a number from 0.1 to 0.5"),
        (("--path-rate-deg-s", "90"), "--path-rate-deg-s: arrived 90; expected a number from -60 to 60"),
        (("--pitch-rate-deg-s", "nan"), "--pitch-rate-deg-s: arrived nan; expected a number from -60 to 60"),
        (
            ("--pitch-rate-deg-s", "4", "--path-rate-deg-s", "4"),
            "--pitch-rate-deg-s: arrived 4 with --path-rate-deg-s 4; expected one of them 0",
        ),
        (("--step-s", "1"), "--step-s: arrived 1; expected a number from 0.001 to 0.05"),
        (("--loop", "rates", "--actuators"), "--actuators: arrived with --loop rates, which always has them"),
        (("--loop", "inner"), "--loop: arrived 'inner'; expected one of 'open', 'rates', 'attitude', 'velocity'"),
        (("--out", "model.csv"), "--out: arrived model.csv; expected a name that ends with .nc or .json"),
        (("--out", "no/such/model.nc"), "expected a file in a folder that exists"),
    ],
)
def test_bad_input_ends_with_2(anser, arguments, message):
    code, printed, err = anser(*AT, *arguments)
    assert (code, printed) == (2, "")
    assert message in " ".join(err.replace("│", " ").split())
